"""What a file has of a channel that was inspected; light, for files load it."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from drivetool.results import Number, Shape


class ChannelSection(Shape):
    """One channel of a log."""

    name: str
    unit: str | None
    role: Annotated[str | None, Meta(description="what a step would take it for")]
    samples: int
    missing: Annotated[int, Meta(description="samples without a finite value")]
    start: Annotated[float, Meta(description="s from the origin of the log")]
    duration: Annotated[float, Meta(description="s")]
    rate: Annotated[Number, Meta(description="Hz")]
    jitter: Annotated[float, Meta(description="largest distance from a uniform grid, in steps")]
    range: Annotated[tuple[Number, Number], Meta(description="least and greatest value, in unit")]
    gaps: Annotated[int, Meta(description="interruptions of more than a few samples")]
    longest_gap: Annotated[float, Meta(description="s")]
    lost: Annotated[int, Meta(description="single samples that are missing")]
    quantum: Annotated[float, Meta(description="quantisation step in unit; 0: none")]
    spikes: Annotated[int, Meta(description="samples that stand out of the running median")]
    held: Annotated[int, Meta(description="how often every value is repeated")]
    clock: Annotated[str, Meta(description="what is wrong with its time stamps")]
