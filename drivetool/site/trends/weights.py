"""Weights of the recordings of a series: from the stated std, the scatter, and the deviation of each."""

from __future__ import annotations

import numpy as np

from drivetool.logs.samples import MAD_PER_STD
from drivetool.site.trends.regression import RELATIVE_ROUNDING

# Recordings of the running median. It preserves a step with three recordings on either side, two at an end.
MEDIAN_RECORDINGS = 5
# Standard deviations from the running median beyond which a recording has less weight. Of normal values 3 in 1000
# are beyond; of heavy tails the extreme ones, which would shift a mean of few recordings.
FULL_WEIGHT_DISTANCE = 4.0
MEDIAN_OF_CHI2 = 0.4549  # median of x^2 for a standard normal x: it turns a median into a variance


def scatter_weights(values: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """(n,) 1 / (stated variance + scatter beyond it), scaled to mean 1.

    values     (n,) in the order of the recordings
    variances  (n,) of each by its stated std
    returns    weights; the scatter is estimated from differences of neighbours, which contain neither steps nor
               drift
    source     Rice 1984 (variance by differences)
    """
    scale = float(np.max(np.abs(values))) or 1.0
    values, variances = values / scale, variances / scale / scale
    by_differences = float(np.median(np.diff(values) ** 2)) / (2.0 * MEDIAN_OF_CHI2)
    scatter = max(by_differences - float(np.median(variances)), 0.0)
    weights = 1.0 / np.maximum(variances + scatter, RELATIVE_ROUNDING**2)
    return weights / weights.mean()


def robust_weights(values: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Weights for a regression on the place of the recording, of mean 1.

    values, variances  as of `scatter_weights`
    returns            (n,) those weights; a recording far off the running median has a weight that falls
                       with the square of its distance: none has more influence than one at FULL_WEIGHT_DISTANCE
    source             Holland and Welsch 1977 (weights that fall by the square); Hampel 1974 (running median)
    """
    weights = scatter_weights(values, variances)
    weights = weights * outlier_factors(values, weights)
    return weights / weights.mean()


def outlier_factors(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(n,) factors up to 1 that reduce the weight of recordings far off the running median; weights (n,) before."""
    deviations = np.abs(values - running_median(values)) * np.sqrt(weights)
    scale = float(np.median(deviations[deviations > 0.0])) / MAD_PER_STD if np.any(deviations > 0.0) else 1.0
    return np.minimum(1.0, FULL_WEIGHT_DISTANCE * scale / np.maximum(deviations, scale)) ** 2


def running_median(values: np.ndarray) -> np.ndarray:
    """(n,) median over MEDIAN_RECORDINGS recordings, over fewer at the ends."""
    half = MEDIAN_RECORDINGS // 2
    return np.array([np.median(values[max(i - half, 0):i + half + 1]) for i in range(len(values))])
