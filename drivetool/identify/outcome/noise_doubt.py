"""What not knowing how strong the torque noise is adds to the covariance of the parameters.

A weak torque noise hides behind the sensor's: the likelihood of its ratio is then flat from zero on, its peak is
often at zero, and there the intervals are those of a torque that is known exactly. So the intervals are those of
an estimate averaged over what the ratio may be.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.special import ndtr

from drivetool.identify.estimate import Z95, covariance_of
from drivetool.identify.noise import Fit, integrated, natural_ratio
from drivetool.identify.problem import Problem, Solution, marquardt_step

KNOWN = 400.0  # looks at the torque noise from which its strength is known to a tenth
# Looks up to which a ratio is averaged over. Far beyond, the sensor's noise is lost in what the torque's moves in a
# sample: the likelihood is flat to infinity, where no covariance is one.
MOST = 10.0 * KNOWN
UNLIKELY = 8.0  # log likelihood below the best at which a ratio counts no more
DOUBLINGS = 24  # of the ratio, at most
LEVEL = 0.95  # of an interval
FURTHEST, HALVINGS = 3.0, 40  # standard deviations within which its ends are, and steps to find them


def from_noise_doubt(problem: Problem, fit: Fit) -> np.ndarray | None:
    """(k, k) to be added to the covariance of the estimate, about which it is taken; None where the ratio is known.

    Beforehand the ratio is as likely at any value from zero on, which is proper: the restricted likelihood falls.
    A noise with a memory was chosen because it shows, and is not in doubt.

    source  Kackar and Harville 1984, who add what the estimate varies with estimated variances; averaged here, not
            expanded, since at zero there is no curvature to go by
    """
    # A ratio of the natural one shows in every sample, a hundredth of it in the sum of a hundred.
    one_look = natural_ratio(problem, fit.point) / max(problem.count, 1)
    if fit.noise.memory is not None or not problem.names or fit.noise.ratio > KNOWN * one_look:
        return None
    found = list(_likely(problem, fit, one_look))
    if not found:
        return None
    ratios, values, steps, covariances = (np.array(column) for column in zip(*found, strict=True))
    # Evenly spaced in the logarithm, so each stands for a stretch as long as itself.
    weights = ratios * np.exp(values.min() - values)
    average = np.average(covariances + steps[:, :, None] * steps[:, None, :], axis=0, weights=weights)
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        wider = half_width(weights, steps, spread) / (Z95 * np.sqrt(np.diag(average)))
    own, _, _ = covariance_of(problem, fit.solution)
    extra = np.outer(wider, wider) * average - own
    return np.where(np.isfinite(extra), extra, 0.0)


def half_width(weights: np.ndarray, steps: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """(k,) half width about zero that holds 95 % of a mixture of Gaussians, whose tails are heavier than one's.

    weights  (m,) of the parts; steps, spread: (m, k) their means and standard deviations
    """
    weights = weights / weights.sum()
    low, high = np.zeros(steps.shape[1]), np.max(np.abs(steps) + FURTHEST * spread, axis=0)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        held = weights @ (ndtr((middle - steps) / spread) - ndtr((-middle - steps) / spread))
        low, high = np.where(held < LEVEL, middle, low), np.where(held < LEVEL, high, middle)
    return 0.5 * (low + high)


def _likely(problem: Problem, fit: Fit, least: float) -> Iterator[tuple[float, float, np.ndarray, np.ndarray]]:
    """Per ratio, from the likeliest up, then down: itself, its restricted -log likelihood, estimate and covariance.

    That is where the parameters would be under it, from where they are (k,), and with what covariance (k, k).
    """
    first, best = max(fit.noise.ratio, least), np.inf
    for powers in (range(DOUBLINGS), range(-1, -DOUBLINGS, -1)):
        for k in powers:
            ratio = first * 2.0**k
            value, normal = integrated(problem, fit.point, replace(fit.noise, ratio=ratio))
            if not least <= ratio <= max(MOST * least, first) or not np.isfinite(value) or value > best + UNLIKELY:
                break
            best = min(best, value)
            step, _ = marquardt_step(problem, fit.point, normal, 1e-12)
            covariance, _, _ = covariance_of(problem, Solution(fit.point, normal, 0, True))
            yield ratio, value, step, covariance
