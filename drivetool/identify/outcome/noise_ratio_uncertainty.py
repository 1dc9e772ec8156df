"""Covariance of the parameters by the uncertainty of the torque noise ratio.

A weak torque noise is masked by the sensor's. The likelihood of its ratio is then flat from zero on, and its peak
is often at zero, where the intervals assume an exactly known torque. So the intervals are averaged over the
posterior of the ratio.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy

from drivetool.identify.estimate import Z95, covariance_of
from drivetool.identify.noise import Fit, restricted_likelihood, unit_noise_ratio
from drivetool.identify.problem import Problem, Solution, marquardt_step

# Ratio, over that of one visible effect in the record, from which it is known to a tenth: no averaging is needed.
MAX_UNCERTAIN_RATIO = 400.0
# The same up to which a ratio is averaged over. Far beyond, the torque noise of one sample exceeds the sensor's.
# The likelihood is flat to infinity, where the covariance has no limit.
MAX_AVERAGED_RATIO = 10.0 * MAX_UNCERTAIN_RATIO
MAX_LIKELIHOOD_DROP = 8.0  # log likelihood below the best at which a ratio is dropped: its weight is exp(-8) = 3e-4
# Maximum doublings of the ratio: 2^24 spans seven decades, more than from one effect to MAX_AVERAGED_RATIO
MAX_RATIO_DOUBLINGS = 24
INTERVAL_COVERAGE = 0.95  # coverage of an interval, as of every other one
# Standard deviations within which its ends are, at 0.95 below 2 for each part; bisections to rounding (2^-40).
MAX_HALF_WIDTH, BISECTIONS = 3.0, 40


def noise_ratio_covariance(problem: Problem, fit: Fit) -> np.ndarray | None:
    """(k, k) to be added to the covariance of the estimate, about which it is taken; None where the ratio is known.

    The prior of the ratio is uniform from zero on; the posterior is proper, since the restricted likelihood falls.
    A noise with a memory was selected because it is significant, and is not averaged over.

    source  Kackar and Harville 1984, who add the variation of the estimate with estimated variances; averaged here,
            not expanded, since at zero there is no curvature
    """
    # A ratio equal to the natural one is visible in every sample, a hundredth of it in the sum of a hundred.
    visible_ratio = unit_noise_ratio(problem, fit.point) / max(problem.count, 1)
    if fit.noise.memory is not None or not problem.names or fit.noise.ratio > MAX_UNCERTAIN_RATIO * visible_ratio:
        return None
    found = list(_likely_ratios(problem, fit, visible_ratio))
    if not found:
        return None
    ratios, values, steps, covariances = (np.array(column) for column in zip(*found, strict=True))
    # Evenly spaced in the logarithm, so each stands for an interval proportional to itself.
    weights = ratios * np.exp(values.min() - values)
    average = np.average(covariances + steps[:, :, None] * steps[:, None, :], axis=0, weights=weights)
    with np.errstate(invalid="ignore", divide="ignore"):
        stds = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        wider = mixture_half_width(weights, steps, stds) / (Z95 * np.sqrt(np.diag(average)))
    own, _, _ = covariance_of(problem, fit.solution)
    extra = np.outer(wider, wider) * average - own
    return np.where(np.isfinite(extra), extra, 0.0)


def mixture_half_width(weights: np.ndarray, steps: np.ndarray, stds: np.ndarray) -> np.ndarray:
    """(k,) half width about zero of 95 % of a mixture of Gaussians, whose tails are heavier than a Gaussian's.

    weights  (m,) of the parts; steps, spread: (m, k) their means and standard deviations
    """
    weights = weights / weights.sum()
    low, high = np.zeros(steps.shape[1]), np.max(np.abs(steps) + MAX_HALF_WIDTH * stds, axis=0)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        coverage = weights @ (scipy.special.ndtr((middle - steps) / stds)
                              - scipy.special.ndtr((-middle - steps) / stds))
        low, high = (np.where(coverage < INTERVAL_COVERAGE, middle, low),
                     np.where(coverage < INTERVAL_COVERAGE, high, middle))
    return 0.5 * (low + high)


def _likely_ratios(problem: Problem, fit: Fit,
                   visible_ratio: float) -> Iterator[tuple[float, float, np.ndarray, np.ndarray]]:
    """Per ratio, from the likeliest up, then down: itself, its restricted -log likelihood, step and covariance.

    The step (k,) leads from the parameters to their estimate under the ratio; covariance (k, k) of that estimate.
    """
    first, best = max(fit.noise.ratio, visible_ratio), np.inf
    for powers in (range(MAX_RATIO_DOUBLINGS), range(-1, -MAX_RATIO_DOUBLINGS, -1)):
        for k in powers:
            ratio = first * 2.0**k
            value, normal = restricted_likelihood(problem, fit.point, replace(fit.noise, ratio=ratio))
            if (not visible_ratio <= ratio <= max(MAX_AVERAGED_RATIO * visible_ratio, first)
                    or not np.isfinite(value) or value > best + MAX_LIKELIHOOD_DROP):
                break
            best = min(best, value)
            step, _ = marquardt_step(problem, fit.point, normal, 1e-12)
            covariance, _, _ = covariance_of(problem, Solution(fit.point, normal, 0, True))
            yield ratio, value, step, covariance
