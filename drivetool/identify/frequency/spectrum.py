"""What the step `spectra` returns: a frequency response with its scatter, distortion, peaks and findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from drivetool.finding import Finding
from drivetool.identify.channels import Feedback
from drivetool.identify.estimate import PlotData
from drivetool.identify.frequency.frf import Response
from drivetool.identify.frequency.sections import DistortionSection, PeakSection
from drivetool.logs import Source


@dataclass(frozen=True)
class Spectrum:
    """The outcome of `spectra`.

    input, output, unit  roles and the unit of the response
    mean      all runs together; runs: one response per run, on its own lines
    spread    (n,) std over the runs of |g - mean| at the lines of mean; None for one run
    distortion  levels on empty lines; feedback: from sensor to torque
    settings  in use, as plain numbers; peaks: resonances and anti-resonances found
    """

    input: str
    output: str
    unit: str
    mean: Response
    runs: tuple[tuple[str, Response], ...]
    spread: np.ndarray | None
    distortion: tuple[DistortionSection, ...]
    feedback: Feedback
    settings: Mapping[str, object]
    peaks: tuple[PeakSection, ...]
    findings: tuple[Finding, ...]
    data: tuple[Source, ...]
    exhibits: tuple[PlotData, ...] = ()
    options: Mapping[str, object] = field(default_factory=dict)

    @property
    def outcome(self) -> str:
        """One sentence."""
        m = self.mean
        how = (f"{m.averages:.0f} periods" if m.method == "periodic"
               else f"{m.averages:.3g} independent frames, {m.method}")
        return f"{len(m.frequency)} spectral lines from {m.frequency[0]:.4g} to {m.frequency[-1]:.4g} Hz from {how}"
