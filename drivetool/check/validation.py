"""What validate returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivetool.errors import Finding
from drivetool.identify.estimate import Exhibit


@dataclass(frozen=True)
class RecordCheck:
    """One model on one record it has not seen.

    model                   name of the parameter file, or "-"
    file                    name of the recording
    simulation_fit_percent  100 (1 - |y - y^| / |y - mean y|) of a free run
    one_step_fit_percent    the same of one-step predictions; not a simulation
    rmse                    of the free run, in the unit of `output`; nrmse: over the range
    r2                      1 - residual / total sum of squares
    max_correlation         largest |normalised cross-correlation| of residual and input
    band                    97 % band for one lag, Bartlett-corrected
    lags_outside_percent    share of lags outside the band
    correlation_p           family-wise p-value over all the lags
    whiteness_p             Ljung-Box of the one-step errors, information only
    passed                  whether every bar that was set is met
    """

    model: str
    file: str
    output: str
    unit: str
    simulation_fit_percent: float
    one_step_fit_percent: float | None
    rmse: float
    nrmse: float
    r2: float
    n: int
    max_correlation: float
    band: float
    lags_outside_percent: float
    correlation_p: float
    whiteness_p: float | None
    passed: bool


@dataclass(frozen=True)
class Validation:
    """Every model on every record, in the order given; verdict is one sentence."""

    checks: tuple[RecordCheck, ...]
    verdict: str
    findings: tuple[Finding, ...] = ()
    data: tuple[tuple[str, str], ...] = ()
    options: Mapping[str, object] = field(default_factory=dict)
    exhibits: tuple[Exhibit, ...] = ()
