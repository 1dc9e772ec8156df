"""The mean of recordings that scatter within a day and between days, with an interval valid for few recordings."""

from __future__ import annotations

import numpy as np
import scipy

from drivetool.files.shapes import trend_shapes as shapes
from drivetool.identify.outcome import mean_of, restricted_variance, variance_between

# Of the scatter of all values: smaller variances give weights so different that sums lose digits by rounding.
MIN_RELATIVE_VARIANCE = 1e-8


def random_effects(values: np.ndarray, variances: np.ndarray,
                   days: np.ndarray | None = None) -> shapes.MeanSection:
    """The random-effects mean with s_r within a day and s_R between days.

    values     (n,) one per recording
    variances  (n,) of each from its stated std, at least 0
    days       (n,) whole days; None: all recordings count as made on one day
    returns    MeanSection in the unit of the values. The variances are estimated by restricted maximum likelihood
               (REML), first within the days, then between their means. The interval is that of Hartung and Knapp
               over the days, or over the recordings of a single day; then it holds for that day.
    source     Patterson and Thompson 1971 (REML); Hartung and Knapp 2001 (interval by Student's t)
    """
    scale = float(np.max(np.abs(values))) or 1.0  # scaled values have squares without overflow or underflow
    found = _scaled_random_effects(values / scale, variances / scale / scale, days)
    within_day, between_days = (None if x is None else x * scale for x in (
        found.std_within_day, found.std_between_days))
    return found.replace(value=found.value * scale, std_within_day=within_day, std_between_days=between_days,
                         ci95=found.ci95 and (found.ci95[0] * scale, found.ci95[1] * scale))


def _scaled_random_effects(values: np.ndarray, variances: np.ndarray,
                           days: np.ndarray | None) -> shapes.MeanSection:
    """`random_effects` for values scaled to a largest one of 1."""
    n = len(values)
    groups = [np.arange(n)] if days is None else [np.flatnonzero(days == day) for day in np.unique(days)]
    count = None if days is None else len(groups)
    if n == 1:
        return shapes.MeanSection(float(values[0]), None, None, None, 1, count)
    scatter = float(np.var(values)) or MIN_RELATIVE_VARIANCE
    variances = np.maximum(variances, MIN_RELATIVE_VARIANCE * scatter)
    within_day = within_day_variance(values, variances, groups) if any(len(group) > 1 for group in groups) else None
    if len(groups) == 1:
        mean = mean_of(values, variances)
        return shapes.MeanSection(mean.value, _student_interval(mean.value, mean.variance, n - 1),
                                  _std_of(within_day), None, n, count)
    weights = 1.0 / (variances + (within_day or 0.0))
    day_weights = np.array([np.sum(weights[group]) for group in groups])
    means = np.array([np.sum(weights[group] * values[group]) for group in groups]) / day_weights
    mean = mean_of(means, 1.0 / day_weights)
    return shapes.MeanSection(mean.value, _student_interval(mean.value, mean.variance, len(groups) - 1),
                              _std_of(within_day), _std_of(variance_between(means, 1.0 / day_weights)), n, count)


def within_day_variance(values: np.ndarray, variances: np.ndarray, groups: list[np.ndarray]) -> float:
    """The variance within groups beyond the stated one, by REML; each group has its own mean.

    values, variances  (n,); groups: places of the recordings of each day
    """
    groups = [group for group in groups if len(group) > 1]
    high = 4.0 * max(float(np.var(values[group])) for group in groups)
    return restricted_variance(values, variances, groups, high)


def _student_interval(value: float, variance: float, degrees: int) -> tuple[float, float]:
    """95 % by Student's t."""
    half_width = float(scipy.special.stdtrit(degrees, 0.975)) * float(np.sqrt(variance))
    return value - half_width, value + half_width


def _std_of(variance: float | None) -> float | None:
    return None if variance is None else float(np.sqrt(variance))
