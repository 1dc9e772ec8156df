"""The samples of a search for changes: recordings, or days where one of them has several."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.site.trends.random_effects import MIN_RELATIVE_VARIANCE, random_effects
from drivetool.site.trends.series import Series


@dataclass(frozen=True)
class TestedSeries:
    """A series and its samples.

    series  of the recordings; means: of the days, or the same if recordings are the samples
    firsts  place of the first recording of each sample
    days    whether days are the samples
    """

    series: Series
    means: Series
    firsts: tuple[int, ...]
    days: bool


def tested_series(series: Series) -> TestedSeries:
    """Days if there are several and one has more than one recording; else recordings.

    Effects that differ from day to day are common to all recordings of a day. Many recordings on few days are not
    as many independent samples of a change. The mean of a day is weighted as in `random_effects`.
    """
    days = series.days
    if days is None or not 1 < len(np.unique(days)) < len(days) or np.any(np.diff(days) < 0):
        return TestedSeries(series, series, tuple(range(len(series.values))), False)
    effects = random_effects(series.values, series.variances, days)
    smallest_variance = MIN_RELATIVE_VARIANCE * (float(np.var(series.values)) or 1.0)
    weights = 1.0 / np.maximum(series.variances + (effects.std_within_day or 0.0) ** 2, smallest_variance)
    firsts = np.flatnonzero(np.diff(days, prepend=days[0] - 1))
    day_weights, counts = np.add.reduceat(weights, firsts), np.diff([*firsts, len(days)])
    means = replace(
        series, recordings=tuple(series.recordings[i] for i in firsts), stds=day_weights**-0.5,
        starts=None if series.starts is None else np.add.reduceat(series.starts, firsts) / counts,
        values=np.add.reduceat(weights * series.values, firsts) / day_weights)
    return TestedSeries(series, means, tuple(int(i) for i in firsts), True)
