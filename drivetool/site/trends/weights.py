"""How much each recording of a series counts: by its stated std, by the scatter, and by how far off it lies."""

from __future__ import annotations

import numpy as np

from drivetool.site.trends.regression import ROUNDING

WINDOW = 5  # recordings of the running median: it keeps a step with three recordings on either side, two at an end
# Standard deviations from the running median from which on a recording counts less. Of normal values 3 in 1000
# do; of heavy tails the far ones, which a mean of few recordings would follow.
FAR = 4.0
# A median of absolute normal values over their standard deviation, and the same of squares of differences.
MEDIAN_TO_STD, MEDIAN_OF_CHI2 = 0.6745, 0.4549


def scatter_weights(values: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """(n,) 1 / (stated variance + scatter beyond it), scaled to mean 1.

    values     (n,) in the order of the recordings
    variances  (n,) of each by its stated std
    returns    weights; the scatter is taken from differences of neighbours, so that neither a step nor a drift is
               in it
    source     Rice 1984 (variance by differences)
    """
    size = float(np.max(np.abs(values))) or 1.0
    values, variances = values / size, variances / size / size
    by_differences = float(np.median(np.diff(values) ** 2)) / (2.0 * MEDIAN_OF_CHI2)
    scatter = max(by_differences - float(np.median(variances)), 0.0)
    weights = 1.0 / np.maximum(variances + scatter, ROUNDING**2)
    return weights / weights.mean()


def weights_of(values: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Weights for a regression on the place of the recording, of mean 1.

    values, variances  as of `scatter_weights`
    returns            (n,) those weights; a recording far off the running median counts by the square of its
                       distance less, so that no single one has more to say than one at FAR
    source             Holland and Welsch 1977 (weights that fall by the square); Hampel 1974 (running median)
    """
    weights = scatter_weights(values, variances)
    weights = weights * trust(values, weights)
    return weights / weights.mean()


def trust(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(n,) factors up to 1 by which recordings far off the running median count less; weights (n,) without them."""
    off = np.abs(values - running_median(values)) * np.sqrt(weights)
    scale = float(np.median(off[off > 0.0])) / MEDIAN_TO_STD if np.any(off > 0.0) else 1.0
    return np.minimum(1.0, FAR * scale / np.maximum(off, scale)) ** 2


def running_median(values: np.ndarray) -> np.ndarray:
    """(n,) median over WINDOW recordings, over fewer at the ends."""
    half = WINDOW // 2
    return np.array([np.median(values[max(i - half, 0):i + half + 1]) for i in range(len(values))])
