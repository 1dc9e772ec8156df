"""What not knowing how strong the torque noise is adds to the covariance of the parameters.

A weak torque noise hides behind the sensor's: the likelihood of its ratio is then flat from zero on, its peak is
often at zero, and there the intervals are those of a torque that is known exactly. So the covariance is averaged
over what the ratio may be.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from drivetool.identify.innovations import Fit
from drivetool.identify.least_squares import Solution, marquardt_step
from drivetool.identify.noise import integrated, natural_ratio
from drivetool.identify.problem import Problem
from drivetool.identify.results import covariance_of

KNOWN = 400.0  # looks at the torque noise from which its strength is known to a tenth
UNLIKELY = 8.0  # log likelihood below the best at which a ratio counts no more
DOUBLINGS = 24  # of the ratio, at most


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
    ratios, values, squares = (np.array(column) for column in zip(*found, strict=True))
    # Evenly spaced in the logarithm, so each stands for a stretch as long as itself.
    average = np.average(squares, axis=0, weights=ratios * np.exp(values.min() - values))
    own, _, _ = covariance_of(problem, fit.solution)
    extra = average - own
    return np.where(np.isfinite(extra), extra, 0.0)


def _likely(problem: Problem, fit: Fit, least: float) -> Iterator[tuple[float, float, np.ndarray]]:
    """Per ratio, from the likeliest up, then down: itself, its restricted -log likelihood, mean square (k, k)."""
    first, best = max(fit.noise.ratio, least), np.inf
    for powers in (range(DOUBLINGS), range(-1, -DOUBLINGS, -1)):
        for k in powers:
            ratio = first * 2.0**k
            value, normal = integrated(problem, fit.point, replace(fit.noise, ratio=ratio))
            if ratio < least or not np.isfinite(value) or value > best + UNLIKELY:
                break
            best = min(best, value)
            step, _ = marquardt_step(problem, fit.point, normal, 1e-12)
            covariance, _, _ = covariance_of(problem, Solution(fit.point, normal, 0, True))
            yield ratio, value, covariance + np.outer(step, step)
