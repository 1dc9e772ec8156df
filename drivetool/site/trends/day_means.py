"""What counts in a search for changes: recordings, or days where one of them has several."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.site.trends.random_effects import SMALLEST_VARIANCE, random_effects
from drivetool.site.trends.series import Series


@dataclass(frozen=True)
class Units:
    """A series and what counts in it.

    series  of the recordings; means: of the days, or the same where each recording counts
    firsts  place of the first recording of each unit
    days    whether days count
    """

    series: Series
    means: Series
    firsts: tuple[int, ...]
    days: bool


def units_of(series: Series) -> Units:
    """Days where there are several and one has more than one recording; else recordings.

    What differs from day to day is common to all recordings of a day. Many of them on few days would pass for as
    many witnesses of a change. The mean of a day is weighed as in `random_effects`.
    """
    days = series.days
    if days is None or not 1 < len(np.unique(days)) < len(days) or np.any(np.diff(days) < 0):
        return Units(series, series, tuple(range(len(series.values))), False)
    found = random_effects(series.values, series.variances, days)
    smallest = SMALLEST_VARIANCE * (float(np.var(series.values)) or 1.0)
    weights = 1.0 / np.maximum(series.variances + (found.within_day or 0.0) ** 2, smallest)
    firsts = np.flatnonzero(np.diff(days, prepend=days[0] - 1))
    own, counts = np.add.reduceat(weights, firsts), np.diff([*firsts, len(days)])
    means = replace(
        series, recordings=tuple(series.recordings[i] for i in firsts), stds=own**-0.5,
        starts=None if series.starts is None else np.add.reduceat(series.starts, firsts) / counts,
        values=np.add.reduceat(weights * series.values, firsts) / own)
    return Units(series, means, tuple(int(i) for i in firsts), True)
