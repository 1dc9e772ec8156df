"""Data of polynomial models: torque and motor speed of every recording, at one sample interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from drivetool.errors import BadRecording
from drivetool.identify.frequency import Run, output_role, stretches_of
from drivetool.identify.polynomial.pem_model import Stretch
from drivetool.logs import Experiment


@dataclass(frozen=True)
class PolynomialData:
    """Runs of one sample interval, as stretches of torque and output; which role the output is."""

    runs: tuple[Run, ...]
    role: str
    step: float

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        """All stretches of all runs."""
        return tuple(Stretch(s[:, 0], s[:, 1], r.name) for r in self.runs for s in r.stretches)

    @property
    def extra(self) -> int:
        """Coefficients of B beyond the order."""
        return int(self.role.endswith("angle"))

    def parts(self, share: float) -> tuple[PolynomialData, PolynomialData]:
        """(first `share` of every stretch, the rest)."""
        cut = [[(s[: int(share * len(s))], s[int(share * len(s)):]) for s in r.stretches] for r in self.runs]
        first, rest = (replace(self, runs=tuple(replace(r, stretches=tuple(c[i] for c in cuts))
                                                for r, cuts in zip(self.runs, cut, strict=True))) for i in (0, 1))
        return first, rest


def data_of(experiments: Sequence[Experiment]) -> PolynomialData:
    """Torque and the motor's speed of every recording."""
    role = output_role(experiments, None)
    runs = tuple(stretches_of(e, role) for e in experiments)
    steps = {round(r.step, 12) for r in runs}
    if len(steps) > 1:
        raise BadRecording("recordings of one sample interval for a discrete-time model",
                           ", ".join(f"{r.step:g} s in {r.name}" for r in runs),
                           "Fit them separately, or resample.")
    return PolynomialData(runs, role, runs[0].step)
