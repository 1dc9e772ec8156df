"""The options of validate and what it returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from drivetool.errors import Finding
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
class RecordCheck:
    """One model on one record, for one measured output.

    model                   name of the parameter file, or "-"
    file                    name of the recording
    output                  role; unit: of the output and of rmse
    simulation_fit_percent  100 (1 - |y - y^| / |y - mean y|) of a free run with fitted start state
    one_step_fit_percent    the same of one-step predictions; not a simulation
    rmse                    of that free run, in the unit of `output`; nrmse: over the range
    r2                      1 - residual / total sum of squares
    n                       measured values
    max_correlation         largest |normalised cross-correlation| of whitened residual and
                            input, see correlation.py; NaN if no input ever changes, also below
    band                    97 % band for one lag, Bartlett-corrected
    lags_outside_percent    share of lags outside the band; 3 % is chance
    correlation_p           family-wise p-value over all the lags
    whiteness_p             Ljung-Box of the one-step prediction errors, information only
    passed                  whether every limit that was set is met
    measured_start_fit_percent, measured_start_rmse  of the free run from the state measured by the first samples;
                            None for segments, which begin in any motion
    rmse_percent            by inverse dynamics: rmse over the root mean square of the torque
    rmse_counts             of an angle by counts: rmse over count/sqrt(12), which is 1 for quantisation alone
    nrmse_mean              of a coast-down's speed: rmse over its mean
    sensor_rmse             of a coast-down: rmse of the sensor alone, in the unit of `output`
    parameters_rmse         of a coast-down: rmse by the uncertainty of the parameters; None: it is not known
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
    measured_start_fit_percent: float | None = None
    measured_start_rmse: float | None = None
    rmse_percent: float | None = None
    rmse_counts: float | None = None
    nrmse_mean: float | None = None
    sensor_rmse: float | None = None
    parameters_rmse: float | None = None


@dataclass(frozen=True)
class Validation:
    """Every model on every record, in the order given; verdict is one sentence.

    unexplained  whether a residual depends on the torque: the model lacks something
    """

    checks: tuple[RecordCheck, ...]
    verdict: str
    findings: tuple[Finding, ...] = ()
    data: tuple[Source, ...] = ()
    options: Mapping[str, object] = field(default_factory=dict)
    exhibits: tuple[PlotData, ...] = ()
    unexplained: bool = False
