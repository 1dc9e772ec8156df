"""Noise coefficients by restricted likelihood (REML): they are not biased by the fit of the dynamics.

Maximum likelihood fits the noise to the residuals of the dynamics, which are too small where the noise matters
most: over a record of few periods of the resonance the stated intervals came out 7 % too short. The restricted
likelihood integrates over the dynamics and the starts. For the noise coefficients alone that adds half the
logarithm of the determinant of their information to the cost.
"""

from __future__ import annotations

import numpy as np

from drivetool.identify.polynomial.pem_model import Prediction
from drivetool.identify.problem import Point

DIFFERENCE_STEP_STDS = 0.05  # of a standard deviation, for differences; a choice between rounding and curvature
# Standard deviations that a shift may have: beyond, the quadratic approximation is not valid.
MAX_RESTRICTED_SHIFT = 1.0


def restricted_shift(problem: Prediction, point: Point, covariance: np.ndarray) -> np.ndarray:
    """(k,) from the maximum of the likelihood to that of the restricted one.

    point       where the determinant is differentiated; covariance (k, k) there
    returns     zeros where there are no noise coefficients, or their covariance is not known
    source      Harville 1977 (restricted likelihood); one Newton step: the Hessian's inverse is the
                covariance, and the determinant's gradient is over the noise coefficients only
    """
    noise = np.concatenate([np.arange(len(problem.names))[problem.structure.part(letter)] for letter in "CD"])
    std = np.sqrt(np.diag(covariance)[noise])
    if not len(noise) or not np.all(np.isfinite(covariance)) or not np.all(std > 0.0):
        return np.zeros(len(problem.names))
    slope = np.zeros(len(noise))
    for i, column in enumerate(noise):
        up, down = (_half_log_determinant(problem, point, noise, column, d)
                    for d in (DIFFERENCE_STEP_STDS * std[i], -DIFFERENCE_STEP_STDS * std[i]))
        slope[i] = (up - down) / (2.0 * DIFFERENCE_STEP_STDS * std[i])
    size = np.sqrt(slope @ covariance[np.ix_(noise, noise)] @ slope)
    if not np.isfinite(size):
        return np.zeros(len(problem.names))
    return -covariance[:, noise] @ slope * min(1.0, MAX_RESTRICTED_SHIFT / max(size, 1e-300))


def _half_log_determinant(problem: Prediction, point: Point, noise: np.ndarray, column: int, shift: float) -> float:
    """Half the log determinant of the information on dynamics and starts, one noise coefficient shifted."""
    values, k = point.values.copy(), len(problem.names)
    values[column] += shift
    dynamics = np.setdiff1d(np.arange(k), noise)
    total, shared = 0.0, []
    for start, stretch in zip(point.starts, problem.stretches, strict=True):
        _, j = problem.jacobian(values, start, stretch)
        q, r = np.linalg.qr(j[:, k:])
        total += float(np.sum(np.log(np.abs(np.diag(r)))))
        j = j[:, dynamics]
        shared.append(np.linalg.qr(j - q @ (q.T @ j), mode="r"))
    return total + float(np.sum(np.log(np.abs(np.diag(np.linalg.qr(np.vstack(shared), mode="r"))))))
