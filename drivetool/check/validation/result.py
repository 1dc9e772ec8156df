"""The options of validate and what it returns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from drivetool.check.validation.sections import CheckSection
from drivetool.errors import NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.estimate import PlotData
from drivetool.identify.setup import KnownStart
from drivetool.logs import Experiment, Source, number_duplicates


@dataclass(frozen=True)
class ValidateOptions:
    """Limits and criterion of a validation.

    min_fit          least simulation fit [%]; None: what a constant explains, which is nothing
    max_correlation  largest |cross-correlation| of residual and input that passes
    segment          length [s] of the free runs; 0: one per uninterrupted stretch of record, or, across a gap, as
                     long as a true model follows
    seed             of the draws behind p-values and behind the fit attainable under noise
    start            what is known of the state in which every recording begins
    criterion        simulation of the motion; inverse: the required torque; coast-down: the motion of coast-downs
                     without torque
    flux_decay       coast-down: time after switching off that is left out [s]
    """

    min_fit: float | None = None
    max_correlation: float = 0.15
    segment: float = 0.0
    seed: int = 1
    start: KnownStart = field(default_factory=KnownStart)
    criterion: Literal["simulation", "inverse", "coast-down"] = "simulation"
    flux_decay: float | None = None


def named_pairs(experiments: Sequence[Experiment], models: Sequence[str], fitted_on: Sequence[Iterable[str]],
                ) -> tuple[list[str], list[tuple[str, frozenset[str]]]]:
    """(a name for each record; a name for each model, with the sha256 of the recordings its fit has seen).

    models     by their names
    fitted_on  per model, the sha256 of these recordings; none: they are not known
    raises     NotEnoughData: no recording, or no model
    """
    if not experiments or not models:
        raise NotEnoughData("at least one recording and one model", f"{len(experiments)} and {len(models)}",
                            "Name a log file, and a parameter file after --params.")
    seen = [frozenset(hashes) for hashes in fitted_on] or [frozenset()] * len(models)
    return number_duplicates([e.name for e in experiments]), list(zip(number_duplicates(models), seen, strict=True))


@dataclass(frozen=True)
class Validation:
    """Every model on every record, in the order given; verdict is one sentence.

    unexplained  whether a residual depends on the torque: the model lacks something
    """

    checks: tuple[CheckSection, ...]
    verdict: str
    findings: tuple[Finding, ...] = ()
    data: tuple[Source, ...] = ()
    options: Mapping[str, object] = field(default_factory=dict)
    exhibits: tuple[PlotData, ...] = ()
    unexplained: bool = False
