"""The options of validate and what it returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from drivetool.check.validation.sections import CheckSection
from drivetool.finding import Finding
from drivetool.identify.estimate import PlotData
from drivetool.identify.setup import KnownStart
from drivetool.logs import Source


@dataclass(frozen=True)
class ValidateOptions:
    """Limits and criterion of a validation.

    min_fit          least simulation fit [%]; None: what a constant explains, which is nothing
    max_correlation  largest |cross-correlation| of residual and input that passes
    segment          length [s] of the free runs; 0: one per uninterrupted stretch of record
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
