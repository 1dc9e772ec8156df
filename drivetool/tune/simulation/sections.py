"""What a gains file has of a simulated kick; light, for files load it."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from drivetool.results import Shape


class HuntingSection(Shape):
    """The whole drive, gap and friction included, after a kick of its load."""

    situation: str
    hunts: bool
    amplitude: Annotated[float, Meta(description="of the motor speed")]
    frequency_hz: float
    load_amplitude: float
    torque_amplitude: float
    kick: float
