"""What an estimator returns: the fitted drive with its uncertainty and its report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate.sections import LawSection, ParameterSection, StartsSection, Status
from drivetool.logs import Source
from drivetool.results import Number

Z95 = 1.959963984540054  # normal quantile of a two-sided 95 % interval


class Parameter(ParameterSection, kw_only=True):
    """One line of the result table.

    value, start, std  in `unit`; std and ci95 are None where there is none, and then
                       `reason` says why
    std_noise, std_structure   parts of the std: by noise, and by the disagreement of candidate models; None where
                       the fit does not separate them
    std_between        part of the std by variation from recording to recording; repeatability: the standard
                       deviation of single recordings; None: fewer than two identify the parameter
    """

    name: str
    value: float
    unit: str
    status: Status = "fitted"
    std_noise: Number = None
    std_structure: Number = None
    std_between: Number = None
    repeatability: Number = None

    def with_interval(self, std: float, bounds: tuple[float, float] = (-np.inf, np.inf),
                      half_width: float | None = None, **parts: Number) -> Parameter:
        """The same with a standard deviation and its parts, and an interval that ends at the bounds.

        half_width  of the interval; None: that of a normal distribution
        """
        (low, high), half = bounds, Z95 * std if half_width is None else half_width
        return self.replace(std=std, ci95=(max(self.value - half, low), min(self.value + half, high)), **parts)

    def at_bound(self, distance: float, bounds: tuple[float, float]) -> Parameter:
        """The same where the fit ended at one of the bounds; distance: how far inside the value may lie, 95 %."""
        low, high = bounds
        inside = (low, min(low + distance, high)) if self.value <= low else (max(high - distance, low), high)
        return self.replace(std=None, ci95=inside, status="at-bound",
                            reason=f"the estimate lies at the bound {self.value:g}; the interval is one-sided")

    def beyond_bound(self, low: float, half_width: float | None, reason: str) -> Parameter:
        """The same set to its lower bound, where the estimate itself lies beyond; half_width: of its interval."""
        inside = None if half_width is None else (low, max(low, self.value + half_width))
        return self.replace(value=low, std=None, ci95=inside, status="at-bound", reason=reason)

    def without_interval(self, reason: str, status: Status | None = None) -> Parameter:
        """The same without an interval."""
        return self.replace(std=None, ci95=None, std_noise=None, std_structure=None, std_between=None,
                            repeatability=None, reason=reason, status=status or self.status)


class FoundLaw(LawSection, kw_only=True):
    """A torque that the motion predicts and the drive lacks; std of each factor."""

    std: list[float]

    @classmethod
    def of(cls, name: str, factors: np.ndarray, std: np.ndarray) -> FoundLaw:
        """The law of that name in words, with factors (k,) and their std (k,)."""
        ends = zip((factors - Z95 * std).tolist(), (factors + Z95 * std).tolist(), strict=True)
        return cls(name=name, factors=factors.tolist(), ci95=list(ends), std=std.tolist())


@dataclass(frozen=True)
class Covariance:
    """Covariance of the fitted parameters: names (k,), matrix (k, k) in their units."""

    names: tuple[str, ...]
    matrix: np.ndarray

    def part(self, names: Iterable[str]) -> Covariance | None:
        """That of some of the names, in the order given; None of none."""
        index = [self.names.index(n) for n in names]
        matrix = self.matrix[np.ix_(index, index)]
        return Covariance(tuple(self.names[i] for i in index), matrix) if index else None


def std_by_gradient(gradient: np.ndarray, matrix: np.ndarray) -> float | None:
    """Standard deviation of a figure by its gradient (k,) over parameters with a covariance (k, k).

    None where that has no value, or the figure does not depend on them.
    """
    variance = float(gradient @ matrix @ gradient)
    return float(np.sqrt(variance)) if np.isfinite(variance) and variance > 0.0 else None


@dataclass(frozen=True)
class HeatMap:
    """Values over two axes.

    x, y    edges (n + 1,) and (m + 1,) of the cells
    values  (m, n), NaN where there is none; label: what they are, with unit
    """

    x: np.ndarray
    y: np.ndarray
    values: np.ndarray
    label: str


@dataclass(frozen=True)
class PlotData:
    """Signals that a picture is drawn from.

    kind    which picture (record, steady, impulse ...); title in words
    x, y    axis labels with unit
    curves  label -> (x (n,), y (n,))
    heat    heat map under the curves
    """

    kind: str
    title: str
    x: str
    y: str
    curves: Mapping[str, tuple[np.ndarray, np.ndarray]]
    heat: HeatMap | None = None


@dataclass(frozen=True)
class Estimate:
    """The outcome of one step.

    step        name of the step (steady, blackbox, greybox, backlash)
    drive       the drive with the fitted values
    parameters  one per parameter of the drive that the step knows about
    outcome     one sentence: how the fit ended
    fit         named figures (simulation_fit_percent, one_step_fit_percent, rmse, n, ...)
    noise       sensor_std per output, torque_std, torque_correlation_time ...
    details     further results of the step, as plain numbers, strings, lists and mappings
    data        (file name, sha256) per recording
    starts      how the starts agreed, where there was a choice
    explanation which candidate model of the record was selected, and why, in one sentence
    laws        torques that the motion predicts; no part of the drive
    ratios      figures that are identified beside the parameters, or without them
    repeats     whether one-step prediction errors are still correlated: the model lacks an effect
    """

    step: str
    drive: Drive
    parameters: tuple[Parameter, ...]
    outcome: str
    fit: Mapping[str, float | int | None]
    covariance: Covariance | None = None
    noise: Mapping[str, float] = field(default_factory=dict)
    details: Mapping[str, object] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    data: tuple[Source, ...] = ()
    options: Mapping[str, object] = field(default_factory=dict)
    exhibits: tuple[PlotData, ...] = ()
    starts: StartsSection | None = None
    explanation: str = ""
    laws: tuple[FoundLaw, ...] = ()
    ratios: tuple[Parameter, ...] = ()
    repeats: bool = False

    def line(self, name: str) -> Parameter:
        """The parameter of that name."""
        return next(p for p in self.parameters if p.name == name)
