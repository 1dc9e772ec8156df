"""The mean of recordings that scatter within a day and between days, and an interval that holds for few of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import t as student

from drivetool.identify.outcome import mean_of, restricted

# Of the scatter of all values: a smaller variance of a single one would only spoil the numerics.
SMALLEST_VARIANCE = 1e-8


@dataclass(frozen=True)
class RandomEffects:
    """The mean of a machine over its recordings.

    value         in the unit of the values; ci95: its 95 % interval, None for one recording
    within_day    standard deviation from recording to recording of one day, beyond what the recordings state of
                  themselves (s_r); None where no day has two recordings
    between_days  standard deviation from day to day (s_R); None for one day, or where the days are not known
    recordings    their number; days: number of days, None where they are not known
    """

    value: float
    ci95: tuple[float, float] | None
    within_day: float | None
    between_days: float | None
    recordings: int
    days: int | None


def random_effects(values: np.ndarray, variances: np.ndarray, days: np.ndarray | None = None) -> RandomEffects:
    """The random-effects mean with s_r within a day and s_R between days.

    values     (n,) one per recording
    variances  (n,) of each by its stated std, at least 0
    days       (n,) whole days; None: all recordings count as made on one day
    returns    RandomEffects. The variances are of restricted maximum likelihood (REML), first within the days, then
               between their means. The interval is that of Hartung and Knapp over the days, or over the recordings
               of a single day; then it holds for that day.
    source     Patterson and Thompson 1971 (REML); Hartung and Knapp 2001 (interval by Student's t)
    """
    size = float(np.max(np.abs(values))) or 1.0  # in whose unit no square is too large or too small
    found = _mean(values / size, variances / size / size, days)
    value, inside, between = (None if x is None else x * size for x in (
        found.value, found.within_day, found.between_days))
    ci95 = None if found.ci95 is None else (found.ci95[0] * size, found.ci95[1] * size)
    return RandomEffects(value, ci95, inside, between, found.recordings, found.days)


def _mean(values: np.ndarray, variances: np.ndarray, days: np.ndarray | None) -> RandomEffects:
    """The same of values whose largest one is 1."""
    n = len(values)
    groups = [np.arange(n)] if days is None else [np.flatnonzero(days == day) for day in np.unique(days)]
    count = None if days is None else len(groups)
    if n == 1:
        return RandomEffects(float(values[0]), None, None, None, 1, count)
    scatter = float(np.var(values)) or SMALLEST_VARIANCE
    variances = np.maximum(variances, SMALLEST_VARIANCE * scatter)
    inside = within(values, variances, groups) if any(len(group) > 1 for group in groups) else None
    if len(groups) == 1:
        mean = mean_of(values, variances)
        return RandomEffects(mean.value, _interval(mean.value, mean.variance, n - 1), _root(inside), None, n, count)
    weights = 1.0 / (variances + (inside or 0.0))
    own = np.array([np.sum(weights[group]) for group in groups])
    means = np.array([np.sum(weights[group] * values[group]) for group in groups]) / own
    mean = mean_of(means, 1.0 / own)
    return RandomEffects(mean.value, _interval(mean.value, mean.variance, len(groups) - 1), _root(inside),
                         _root(restricted(means, 1.0 / own)), n, count)


def within(values: np.ndarray, variances: np.ndarray, groups: list[np.ndarray]) -> float:
    """The variance within groups beyond the stated one, by restricted likelihood; each group has its own mean.

    values, variances  (n,); groups: places of the recordings of each day
    """
    groups = [group for group in groups if len(group) > 1]

    def slope(inside: float) -> float:
        found = 0.0
        for group in groups:
            weight = 1.0 / (inside + variances[group])
            mean = np.sum(weight * values[group]) / np.sum(weight)
            found += float(np.sum(weight**2 * (values[group] - mean) ** 2) - np.sum(weight)
                           + np.sum(weight**2) / np.sum(weight))
        return found

    if slope(0.0) <= 0.0:
        return 0.0
    high = 4.0 * max(float(np.var(values[group])) for group in groups)
    while slope(high) > 0.0:
        high *= 4.0
    return float(brentq(slope, 0.0, high))


def _interval(value: float, variance: float, degrees: int) -> tuple[float, float]:
    """95 % by Student's t."""
    far = float(student.ppf(0.975, degrees)) * float(np.sqrt(variance))
    return value - far, value + far


def _root(variance: float | None) -> float | None:
    return None if variance is None else float(np.sqrt(variance))
