"""Trends of each parameter of each machine over the recordings of a site: means, drifts, steps and alarms."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np

from drivetool.files.shapes import trend_shapes as shapes
from drivetool.site.trends.alarm import DEFAULT_ALARM_RATIO
from drivetool.site.trends.change_points import MIN_SERIES_LENGTH, ChangeModel, model_columns, select_model
from drivetool.site.trends.day_means import TestedSeries, tested_series
from drivetool.site.trends.outliers import Outlier, outliers_of
from drivetool.site.trends.random_effects import random_effects
from drivetool.site.trends.regression import WeightedFit, weighted_fit
from drivetool.site.trends.series import SECONDS_PER_DAY, Series
from drivetool.site.trends.weights import robust_weights

MIN_DAYS_FOR_SLOPE = 3  # a line over two days has no residual for its interval
TESTS_PER_SERIES = 3  # a drift, steps, and outliers


class Change(shapes.ChangeSection):
    """A step of a series; place: of the first recording after it, from 0."""

    place: int


@dataclass(frozen=True)
class Trend:
    """A series with its mean, drift and steps.

    series       without its outliers; all other fields are of this series
    outliers     the outlying recordings
    mean         over all recordings; parts: of those between the steps, if there are any
    drift        None if not tested, see `reason`
    changes      its steps in their order
    correlation  of neighbouring residuals of steps and drift; the intervals include it
    sample_count  number of samples: recordings, or days where one has several
    reason       why neither drift nor steps are tested
    """

    series: Series
    outliers: tuple[Outlier, ...]
    mean: shapes.MeanSection
    parts: tuple[shapes.MeanSection, ...]
    drift: shapes.DriftSection | None
    changes: tuple[Change, ...]
    correlation: float
    sample_count: int
    reason: str = ""


def trends(series: Iterable[Series], alarm: float = DEFAULT_ALARM_RATIO) -> tuple[Trend, ...]:
    """The trend of every series of a site.

    series   all of a site: the false-alarm rate is for all of them together
    alarm    size of a change, in standard deviations of the runs before, from which it is an alarm
    returns  one Trend each, in their order. A series of fewer than FEWEST recordings (days, where one of them has
             several), or of equal values, has a mean only.
    """
    tested = [tested_series(each) for each in series]
    tests = TESTS_PER_SERIES * sum(not _no_trend_reason(each) for each in tested)
    return tuple(_trend_of(each, tests, alarm) for each in tested)


def _no_trend_reason(tested: TestedSeries) -> str:
    """Why a series is not tested for a trend; empty if it is."""
    if len(tested.firsts) < MIN_SERIES_LENGTH:
        return f"fewer than {MIN_SERIES_LENGTH} {'days' if tested.days else 'recordings'}"
    return "all values are equal" if tested.series.constant else ""


def _trend_of(tested: TestedSeries, tests: int, alarm: float) -> Trend:
    """The trend of one series; tests: in all of the site."""
    outliers = () if _no_trend_reason(tested) else outliers_of(tested.series, tests, alarm)
    tested = tested_series(tested.series.without([outlier.place for outlier in outliers]))
    series, means = tested.series, tested.means
    if reason := _no_trend_reason(tested):
        return Trend(series, outliers, _mean_between(series), (), None, (), 0.0, len(tested.firsts), reason)
    weights = robust_weights(means.values, means.variances)
    model = select_model(means.values, weights, tests)
    ends = [0, *(tested.firsts[cut] for cut in model.cuts), len(series.values)]
    parts = [_mean_between(series, a, b) for a, b in pairwise(ends)] if model.cuts else []
    return Trend(series, outliers, _mean_between(series), tuple(parts),
                 _drift_of(tested, weights, model, tests, alarm), _changes_of(tested, model, alarm),
                 model.fit.correlation, len(tested.firsts))


def _mean_between(series: Series, a: int = 0, b: int | None = None) -> shapes.MeanSection:
    """The mean of the recordings from place a to before place b."""
    days = None if series.days is None else series.days[a:b]
    return random_effects(series.values[a:b], series.variances[a:b], days)


def _changes_of(tested: TestedSeries, model: ChangeModel, alarm: float) -> tuple[Change, ...]:
    """The steps of a model with their sizes."""
    series, found = tested.series, []
    design = model_columns(len(tested.firsts), model.slope, model.cuts)
    places = [0, *(tested.firsts[cut] for cut in model.cuts)]
    for i, (cut, chance) in enumerate(zip(model.cuts, model.chances, strict=True)):
        size = float(model.fit.coefficients[model.first_step + i])
        after = float(design[cut] @ model.fit.coefficients)
        runs, place = series.values[places[i]:places[i + 1]], places[i + 1]
        std = float(np.std(runs, ddof=1))
        ratio = abs(size) / std if std > 0.0 else float("inf")
        began = None if series.starts is None else tuple(
            datetime.fromtimestamp(float(start), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
            for start in series.starts[place - 1:place + 1])
        found.append(Change(series.recordings[place - 1], series.recordings[place], began, after - size, after, std,
                            len(runs), ratio, chance, ratio >= alarm, place))
    return tuple(found)


def _drift_of(tested: TestedSeries, weights: np.ndarray, model: ChangeModel, tests: int,
              alarm: float) -> shapes.DriftSection:
    """The slope beside the steps of a model, also if the model has none."""
    n, means = len(tested.firsts), tested.means
    design = model_columns(n, True, model.cuts)
    line_fit = model.fit if model.slope else weighted_fit(means.values, weights, design)
    slope = _scaled_slope(line_fit, 1, (n - 1) / (len(tested.series.values) - 1))
    change = float(line_fit.coefficients[1]) * (n - 1)
    before = float(line_fit.coefficients[0]) - 0.5 * change
    ratio = abs(change) / line_fit.residual_std if line_fit.residual_std > 0.0 else float("inf")
    return shapes.DriftSection(slope, _slope_per_day(means, weights, design), before, before + change,
                               line_fit.residual_std,
                 ratio, min(line_fit.chance(1) * tests, 1.0), model.slope, model.slope and ratio >= alarm)


def _slope_per_day(series: Series, weights: np.ndarray, design: np.ndarray) -> shapes.SlopeSection | None:
    """The slope over time; None with fewer than three days, or without dates."""
    if series.starts is None or len(np.unique(series.days)) < MIN_DAYS_FOR_SLOPE:
        return None
    time = (series.starts - series.starts.mean()) / SECONDS_PER_DAY
    return _scaled_slope(weighted_fit(series.values, weights,
                                      np.column_stack([design[:, :1], time, design[:, 2:]])), 1)


def _scaled_slope(found: WeightedFit, j: int, scale: float = 1.0) -> shapes.SlopeSection:
    """A coefficient times a unit."""
    low, high = found.interval(j)
    return shapes.SlopeSection(scale * float(found.coefficients[j]), scale * float(found.std[j]),
                               (scale * low, scale * high))
