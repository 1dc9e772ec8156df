"""What each parameter of each machine does over the recordings of a site: means, drifts, steps, and alarms."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drivetool.site.trends.change_points import FEWEST, Model, columns, model_of
from drivetool.site.trends.day_means import Units, units_of
from drivetool.site.trends.outliers import Outlier, outliers_of
from drivetool.site.trends.random_effects import RandomEffects, random_effects
from drivetool.site.trends.regression import Fit, fit
from drivetool.site.trends.series import DAY, Series
from drivetool.site.trends.weights import weights_of

# A change of that many standard deviations of the runs before is worth a walk to the machine. Statistics show far
# smaller ones with enough recordings, which no one would go to see.
ALARM = 5.0
FEWEST_DAYS = 3  # a line over two days leaves nothing to tell its interval by
TESTS_PER_SERIES = 3  # a drift, steps, and recordings far from all others


@dataclass(frozen=True)
class Slope:
    """A slope in the unit of the values per recording or per day, its std and its 95 % interval."""

    value: float
    std: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Drift:
    """How a series drifts beside its steps.

    per_recording, per_day  its slopes; per_day None where the days are not known or fewer than three
    before, after  what the line says at the first and at the last recording
    std      of the recordings, or of the means of days, about drift and steps; ratio: whole change over that
    chance   of such a slope without a drift, for all tests of the site
    told     whether the series drifts; alarm: whether it does so by at least the bar of an alarm
    """

    per_recording: Slope
    per_day: Slope | None
    before: float
    after: float
    std: float
    ratio: float
    chance: float
    told: bool
    alarm: bool


@dataclass(frozen=True)
class Change:
    """A step of a series.

    place    of the first recording after it, from 0
    before, after  the level on both sides: means, or beside a drift the line at the step
    std      standard deviation of the runs before, since the step before, their drift included
    runs     their number; ratio: size over std, infinite where they are all equal
    chance   of such a step without one, for all places and tests of the site
    alarm    whether the ratio reaches the bar of an alarm
    """

    place: int
    before: float
    after: float
    std: float
    runs: int
    ratio: float
    chance: float
    alarm: bool


@dataclass(frozen=True)
class Trend:
    """A series and what it does.

    series       without its outliers; all else here is of what is left
    outliers     (name, figures) of the recordings that lie far from all others
    mean         over all recordings; parts: of those between the steps, where there are any
    drift        None where `reason` says why
    changes      its steps in their order
    correlation  of neighbours in what steps and drift leave; the intervals have it in them
    units        how many recordings, or days where one has several, these are told by
    reason       why neither drift nor steps are looked for
    """

    series: Series
    outliers: tuple[tuple[str, Outlier], ...]
    mean: RandomEffects
    parts: tuple[RandomEffects, ...]
    drift: Drift | None
    changes: tuple[Change, ...]
    correlation: float
    units: int
    reason: str = ""


def trends(series: Iterable[Series], alarm: float = ALARM) -> tuple[Trend, ...]:
    """The trend of every series of a site.

    series   all that are looked at: the error budget is for all of them together
    alarm    size of a change, in standard deviations of the runs before, from which on it is an alarm
    returns  one Trend each, in their order. A series of fewer than FEWEST recordings (days, where one of them has
             several), or of equal values, has a mean only.
    """
    units = [units_of(each) for each in series]
    tests = TESTS_PER_SERIES * sum(not _silent(each) for each in units)
    return tuple(_trend(each, tests, alarm) for each in units)


def _silent(units: Units) -> str:
    """Why no trend is looked for; empty if it is."""
    if len(units.firsts) < FEWEST:
        return f"fewer than {FEWEST} {'days' if units.days else 'recordings'}"
    return "all values are equal" if units.series.constant else ""


def _trend(units: Units, tests: int, alarm: float) -> Trend:
    """The trend of one series; tests: in all of the site."""
    if reason := _silent(units):
        return Trend(units.series, (), _mean(units.series), (), None, (), 0.0, len(units.firsts), reason)
    far = outliers_of(units.series.values, units.series.variances, tests, alarm)
    named = tuple((units.series.recordings[outlier.place], outlier) for outlier in far)
    units = units_of(units.series.without([outlier.place for outlier in far]))
    series, means = units.series, units.means
    if reason := _silent(units):
        return Trend(series, named, _mean(series), (), None, (), 0.0, len(units.firsts), reason)
    weights = weights_of(means.values, means.variances)
    model = model_of(means.values, weights, tests)
    ends = [0, *(units.firsts[cut] for cut in model.cuts), len(series.values)]
    parts = [_mean(series, a, b) for a, b in pairwise(ends)] if model.cuts else []
    return Trend(series, named, _mean(series), tuple(parts), _drift(units, weights, model, tests, alarm),
                 _changes(units, model, alarm), model.fit.correlation, len(units.firsts))


def _mean(series: Series, a: int = 0, b: int | None = None) -> RandomEffects:
    """The mean of the recordings from place a on, before place b."""
    days = None if series.days is None else series.days[a:b]
    return random_effects(series.values[a:b], series.variances[a:b], days)


def _changes(units: Units, model: Model, alarm: float) -> tuple[Change, ...]:
    """The steps of a model with their sizes."""
    found = []
    design = columns(len(units.firsts), model.slope, model.cuts)
    places = [0, *(units.firsts[cut] for cut in model.cuts)]
    for i, (cut, chance) in enumerate(zip(model.cuts, model.chances, strict=True)):
        size = float(model.fit.coefficients[model.first_step + i])
        after = float(design[cut] @ model.fit.coefficients)
        runs = units.series.values[places[i]:places[i + 1]]
        std = float(np.std(runs, ddof=1))
        ratio = abs(size) / std if std > 0.0 else float("inf")
        found.append(Change(places[i + 1], after - size, after, std, len(runs), ratio, chance, ratio >= alarm))
    return tuple(found)


def _drift(units: Units, weights: np.ndarray, model: Model, tests: int, alarm: float) -> Drift:
    """The slope beside the steps of a model, whether or not the model has one."""
    n, means = len(units.firsts), units.means
    design = columns(n, True, model.cuts)
    found = model.fit if model.slope else fit(means.values, weights, design)
    slope = _slope(found, 1, (n - 1) / (len(units.series.values) - 1))
    change = float(found.coefficients[1]) * (n - 1)
    before = float(found.coefficients[0]) - 0.5 * change
    ratio = abs(change) / found.std_left if found.std_left > 0.0 else float("inf")
    return Drift(slope, _per_day(means, weights, design), before, before + change, found.std_left, ratio,
                 min(found.chance(1) * tests, 1.0), model.slope, model.slope and ratio >= alarm)


def _per_day(series: Series, weights: np.ndarray, design: np.ndarray) -> Slope | None:
    """The slope over time; None where the days do not tell one."""
    if series.starts is None or len(np.unique(series.days)) < FEWEST_DAYS:
        return None
    time = (series.starts - series.starts.mean()) / DAY
    return _slope(fit(series.values, weights, np.column_stack([design[:, :1], time, design[:, 2:]])), 1)


def _slope(found: Fit, j: int, unit: float = 1.0) -> Slope:
    """A coefficient times a unit."""
    low, high = found.interval(j)
    return Slope(unit * float(found.coefficients[j]), unit * float(found.std[j]), (unit * low, unit * high))
