"""Random-effects statistics: the variance between groups beyond the noise within them, and their mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from drivetool.identify.estimate import Z95


@dataclass(frozen=True)
class GroupMean:
    """Mean of groups, each weighted by its noise and the scatter between them: value, variance, group count."""

    value: float
    variance: float
    count: int


def mean_of(y: np.ndarray, variance: np.ndarray) -> GroupMean:
    """The mean of groups (n,) with variances (n,) by noise of their own.

    source  Hartung and Knapp 2001: the variance follows from the scatter of the groups, noise included
    """
    weight = 1.0 / (variance_between(y, variance) + variance)
    whole = float(np.sum(weight))
    value = float(np.sum(weight * y)) / whole
    return GroupMean(value, float(np.sum(weight * (y - value) ** 2)) / ((len(y) - 1) * whole), len(y))


def p_value_of_equality(one: GroupMean, other: GroupMean) -> float:
    """p-value of the hypothesis that two means are equal, by Student's t (Welch 1947)."""
    both = one.variance + other.variance
    if both <= 0.0:
        return float(one.value == other.value)
    degrees = both**2 / sum(m.variance**2 / (m.count - 1) for m in (one, other))
    return float(2.0 * scipy.stats.t.sf(abs(other.value - one.value) / np.sqrt(both), degrees))


def variance_between(y: np.ndarray, variance: np.ndarray) -> float:
    """The variance between groups, by restricted likelihood.

    y         (n,) estimate of each; variance: (n,) of each by noise of its own
    """
    return restricted_variance(y, variance, [slice(None)], 4.0 * float(np.var(y, ddof=1)))


def restricted_variance(y: np.ndarray, variance: np.ndarray, groups: Sequence[np.ndarray | slice],
                        high: float) -> float:
    """The variance beyond a known one, by restricted likelihood; each group has its own mean.

    y       (n,) values; variance: (n,) known of each
    groups  places of the values of each, two or more
    high    where the search begins
    """
    def slope(further: float) -> float:
        found = 0.0
        for group in groups:
            weight = 1.0 / (further + variance[group])
            mean = np.sum(weight * y[group]) / np.sum(weight)
            found += float(np.sum(weight**2 * (y[group] - mean) ** 2) - np.sum(weight)
                           + np.sum(weight**2) / np.sum(weight))
        return found

    if slope(0.0) <= 0.0:
        return 0.0
    while slope(high) > 0.0:
        high *= 4.0
    return float(scipy.optimize.brentq(slope, 0.0, high))


def p_value_of_homogeneity(y: np.ndarray, variance: np.ndarray) -> float:
    """p-value of the hypothesis that the groups do not differ (Cochran 1954)."""
    weight = 1.0 / variance
    mean = np.sum(weight * y) / np.sum(weight)
    return float(scipy.stats.chi2.sf(np.sum(weight * (y - mean) ** 2), len(y) - 1))


def half_width(std: float, between: float, count: float) -> float:
    """Half width of the 95 % interval, where one part of the standard deviation is known from few recordings only.

    std      total; between: the part by the variation between recordings
    count    of the recordings
    source   JCGM 100:2008 (GUM), annex G.4: effective degrees of freedom after Welch and Satterthwaite
    """
    if between <= 0.0:
        return Z95 * std
    degrees = max(count - 1.0, 1.0) * max(std / between, 1.0) ** 4
    return float(scipy.stats.t.ppf(0.975, degrees)) * std
