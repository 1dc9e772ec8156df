"""Weighted regression of a series on its places, with the correlation of what is left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

# Of the largest value: a file has 10 significant digits, and what is left below them is none.
ROUNDING = 1e-10
MOST_CORRELATION = 0.9  # beyond it a series of some tens of recordings has hardly two independent ones


@dataclass(frozen=True)
class Fit:
    """A regression with k columns on n recordings.

    coefficients  (k,) in the unit of the values, per unit of the column
    std           (k,) by what is left, its correlation included
    left          (n,) values less the fit, times the root of the weight
    std_left      standard deviation of one recording of weight 1 about the fit
    degrees       n - k
    correlation   of neighbours in what is left, its bias removed; 0 where it is negative
    """

    coefficients: np.ndarray
    std: np.ndarray
    left: np.ndarray
    std_left: float
    degrees: int
    correlation: float

    @property
    def squares(self) -> float:
        """Sum of the squares of what is left."""
        return float(np.sum(self.left**2))

    def chance(self, j: int) -> float:
        """Chance of a coefficient as large where there is none, by Student's t."""
        if self.std[j] <= 0.0:
            return 0.0 if self.coefficients[j] else 1.0
        return float(2.0 * student.sf(abs(self.coefficients[j]) / self.std[j], self.degrees))

    def interval(self, j: int) -> tuple[float, float]:
        """The 95 % interval of a coefficient."""
        far = float(student.ppf(0.975, self.degrees)) * float(self.std[j])
        return float(self.coefficients[j]) - far, float(self.coefficients[j]) + far


def fit(values: np.ndarray, weights: np.ndarray, columns: np.ndarray) -> Fit:
    """Least squares with weights, scaled by what is left.

    values   (n,); weights (n,) of mean 1; columns (n, k) of full rank, k < n
    returns  Fit. Where neighbours of what is left are correlated by r, a variance is (1 + r) / (1 - r) times that
             of independent ones: the variance of a mean of a first-order autoregression.
    source   Knapp and Hartung 2003 (scale in a random-effects regression); Bayley and Hammersley 1946 (variance
             of a correlated mean)
    """
    root = np.sqrt(weights)
    design = columns * root[:, None]
    q, r = np.linalg.qr(design)
    coefficients = np.linalg.solve(r, q.T @ (root * values))
    left = root * values - design @ coefficients
    degrees = len(values) - columns.shape[1]
    spread = max(float(np.sum(left**2)) / degrees, (ROUNDING * float(np.max(np.abs(values)))) ** 2)
    rho = correlation(left, columns.shape[1])
    inverse = np.linalg.inv(r)
    std = np.sqrt(np.sum(inverse**2, axis=1) * spread * (1.0 + rho) / (1.0 - rho))
    return Fit(coefficients, std, left, float(np.sqrt(spread)), degrees, rho)


def correlation(left: np.ndarray, k: int) -> float:
    """The correlation of neighbours, from 0 to MOST_CORRELATION.

    left    (n,) what a regression with k columns leaves, which pulls the correlation down
    source  Marriott and Pope 1954 for a mean (k = 1) and, to its first order, for the further columns: the
            expectation is r - (k + (k + 2) r) / n
    """
    n, whole = len(left), float(np.sum(left**2))
    if n <= k + 3 or whole <= 0.0:
        return 0.0
    raw = float(np.sum(left[1:] * left[:-1])) / whole
    return float(np.clip((raw * n + k) / (n - k - 2), 0.0, MOST_CORRELATION))
