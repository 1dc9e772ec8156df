"""Weighted regression of a series on its places, with correlated residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

# Of the largest value: a file has 10 significant digits, and smaller residuals are rounding.
RELATIVE_ROUNDING = 1e-10
MAX_NEIGHBOUR_CORRELATION = 0.9  # beyond it some tens of recordings hardly contain two independent ones


@dataclass(frozen=True)
class WeightedFit:
    """A regression with k columns on n recordings.

    coefficients  (k,) in the unit of the values, per unit of the column
    std           (k,) from the residuals and their correlation
    weighted_residuals  (n,) residuals times the square root of the weight
    residual_std  standard deviation of one recording of weight 1 about the fit
    degrees       n - k
    correlation   of neighbouring residuals, bias removed; 0 where it is negative
    """

    coefficients: np.ndarray
    std: np.ndarray
    weighted_residuals: np.ndarray
    residual_std: float
    degrees: int
    correlation: float

    @property
    def squares(self) -> float:
        """Sum of the squared residuals."""
        return float(np.sum(self.weighted_residuals**2))

    def chance(self, j: int) -> float:
        """Two-sided p-value of a coefficient, by Student's t."""
        if self.std[j] <= 0.0:
            return 0.0 if self.coefficients[j] else 1.0
        return float(2.0 * scipy.special.stdtr(self.degrees, -abs(self.coefficients[j]) / self.std[j]))

    def interval(self, j: int) -> tuple[float, float]:
        """The 95 % interval of a coefficient."""
        half_width = float(scipy.special.stdtrit(self.degrees, 0.975)) * float(self.std[j])
        return float(self.coefficients[j]) - half_width, float(self.coefficients[j]) + half_width


def weighted_fit(values: np.ndarray, weights: np.ndarray, columns: np.ndarray) -> WeightedFit:
    """Weighted least squares, scaled by the residual variance.

    values   (n,); weights (n,) of mean 1; columns (n, k) of full rank, k < n
    returns  Fit. If neighbouring residuals have the correlation r, a variance is (1 + r) / (1 - r) times that
             of independent ones: the variance of a mean of a first-order autoregression.
    source   Knapp and Hartung 2003 (scale in a random-effects regression); Bayley and Hammersley 1946 (variance
             of a correlated mean)
    """
    root = np.sqrt(weights)
    design = columns * root[:, None]
    q, r = np.linalg.qr(design)
    coefficients = np.linalg.solve(r, q.T @ (root * values))
    residuals = root * values - design @ coefficients
    degrees = len(values) - columns.shape[1]
    residual_variance = max(float(np.sum(residuals**2)) / degrees,
                            (RELATIVE_ROUNDING * float(np.max(np.abs(values)))) ** 2)
    rho = neighbour_correlation(residuals, columns.shape[1])
    inverse = np.linalg.inv(r)
    std = np.sqrt(np.sum(inverse**2, axis=1) * residual_variance * (1.0 + rho) / (1.0 - rho))
    return WeightedFit(coefficients, std, residuals, float(np.sqrt(residual_variance)), degrees, rho)


def neighbour_correlation(residuals: np.ndarray, k: int) -> float:
    """The correlation of neighbouring residuals, from 0 to MAX_NEIGHBOUR_CORRELATION.

    residuals  (n,) of a regression with k columns, which biases the correlation downwards
    source     Marriott and Pope 1954 for a mean (k = 1) and, to its first order, for the further columns: the
               expectation is r - (k + (k + 2) r) / n
    """
    n, sum_of_squares = len(residuals), float(np.sum(residuals**2))
    if n <= k + 3 or sum_of_squares <= 0.0:
        return 0.0
    raw = float(np.sum(residuals[1:] * residuals[:-1])) / sum_of_squares
    return float(np.clip((raw * n + k) / (n - k - 2), 0.0, MAX_NEIGHBOUR_CORRELATION))
