"""What a spectra file has of a measured response; light, for files load it."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from drivetool.results import Number, Shape


class PeakSection(Shape):
    """A resonance or anti-resonance that stands out of a measured response."""

    kind: Literal["resonance", "anti-resonance"]
    hz: Annotated[float, Meta(description="of the spectral line")]
    magnitude: float
    resolution_hz: Annotated[float, Meta(description="distance of the lines")]
    prominence_db: float


class DistortionSection(Shape):
    """Output on lines without excitation, as rms over the lines of a kind."""

    kind: Literal["even", "odd"]
    lines: int
    level: float
    noise: float
    signal: float
    below_signal_db: Annotated[Number, Meta(description="null where it does not stand out of the noise")]
