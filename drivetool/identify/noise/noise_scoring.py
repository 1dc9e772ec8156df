"""Noise parameters by Fisher scoring: Newton's method with the expected curvature of the likelihood.

The likelihood of innovations e (N,) of variances v (N,), that of the first sensor profiled out, has a curvature
that follows from the derivatives of e and v over each noise parameter. So one more pass per parameter gives
gradient and curvature, where a search by values alone takes dozens.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.drive.simulation import Filtered

# Difference step of a log parameter. A choice: 1 % is far above rounding, far below its uncertainty
LOG_DIFFERENCE_STEP = 0.01
MAX_LOG_STEP = 1.5  # longest step of a log parameter, a factor of 4.5. A choice: beyond, the quadratic model fails
# Cuts to a quarter of a step that does not lower the value; after four it is below 1 %, the tolerance
MAX_STEP_CUTS = 4
# Expected gain of log likelihood that ends the scoring: a parameter is then within 0.06 of its std
MIN_EXPECTED_GAIN = 2e-3
# Expected gain below which the scoring ends if the step achieved it to within a half: the next is smaller still.
LAST_EXPECTED_GAIN = 0.05
MAX_SCORING_ROUNDS = 8  # a choice: near a peak Newton's method needs fewer; more only drift on a flat one


@dataclass(frozen=True)
class NoiseLikelihood:
    """The likelihood of a noise, with its innovations.

    value        -log likelihood, to be made small
    innovations  (N,) of all sensors, traces and samples that count
    variance     (N,) theirs, over that of the first sensor
    """

    value: float
    innovations: np.ndarray
    variance: np.ndarray


def likelihood_of_passes(value: float, passes: Sequence[Filtered]) -> NoiseLikelihood:
    """A value with the innovations; those that are NaN do not count."""
    e = np.concatenate([f.innovations.ravel() for f in passes])
    v = np.concatenate([f.variance.ravel() for f in passes])
    known = np.isfinite(e)
    return NoiseLikelihood(value, e[known], v[known])


def minimise_by_scoring(evaluate: Callable[[np.ndarray], NoiseLikelihood], start: np.ndarray, low: np.ndarray,
                        high: np.ndarray) -> tuple[np.ndarray, float]:
    """Log parameters (k,) within their bounds that minimise the value near a start, and that value.

    evaluate  log parameters -> their likelihood; its value is infinite where there is none
    source  Fisher scoring: Caines 1988, Linear Stochastic Systems, chapter 7, with one variance profiled out
    """
    at = np.clip(start, low, high)
    here = evaluate(at)
    if not np.isfinite(here.value):
        return at, here.value
    for _ in range(MAX_SCORING_ROUNDS):
        slope, curvature = _gradient_and_curvature(evaluate, at, here, high)
        step = _newton_step(slope, curvature, at, low, high)
        expected_gain = -float(slope @ step) - 0.5 * float(step @ curvature @ step)
        if not expected_gain > MIN_EXPECTED_GAIN:  # or NaN
            break
        found = _line_search(evaluate, at, here, step, low, high)
        if found is None:
            break
        margin, before = 0.5 * expected_gain, here.value
        at, here = found
        if expected_gain < LAST_EXPECTED_GAIN and abs(before - here.value - expected_gain) < margin:
            break
    return at, here.value


def _gradient_and_curvature(evaluate: Callable[[np.ndarray], NoiseLikelihood], at: np.ndarray,
                            here: NoiseLikelihood,
                            high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(k,) gradient of the value by differences, and (k, k) expected curvature of the innovations' likelihood.

    NaN where a filter diverges.
    """
    count, e, v = len(here.innovations), here.innovations, here.variance
    variance = float(np.mean(e**2 / v))
    slope, ahead, motion, width = np.zeros(len(at)), np.where(
        at + LOG_DIFFERENCE_STEP <= high, LOG_DIFFERENCE_STEP, -LOG_DIFFERENCE_STEP), [], []
    for j in range(len(at)):
        there = at.copy()
        there[j] += ahead[j]
        other = evaluate(there)
        if len(other.innovations) != count or not np.isfinite(other.value):
            return np.full(len(at), np.nan), np.full((len(at), len(at)), np.nan)
        slope[j] = (other.value - here.value) / ahead[j]
        motion.append((other.innovations - e) / (ahead[j] * np.sqrt(v * variance)))
        width.append((other.variance - v) / (ahead[j] * v))
    motion, width = np.array(motion), np.array(width)
    sums = width.sum(axis=1)
    curvature = motion @ motion.T + 0.5 * width @ width.T - 0.5 * np.outer(sums, sums) / count
    return slope - 0.5 * ahead * np.diag(curvature), curvature  # a difference is the slope at mid-step


def _newton_step(slope: np.ndarray, curvature: np.ndarray, at: np.ndarray, low: np.ndarray,
                 high: np.ndarray) -> np.ndarray:
    """Newton's step, no longer than MAX_LOG_STEP; parameters on a bound that they would cross stay."""
    step = np.zeros(len(at))
    free = ~(((at <= low) & (slope > 0.0)) | ((at >= high) & (slope < 0.0)))
    if not free.any() or not np.isfinite(slope).all() or not np.isfinite(curvature).all():
        return step
    size = np.sqrt(np.maximum(np.diag(curvature)[free], 1e-12))
    scaled = curvature[np.ix_(free, free)] / np.outer(size, size) + 1e-6 * np.eye(int(free.sum()))
    step[free] = -np.linalg.solve(scaled, slope[free] / size) / size
    return step * min(1.0, MAX_LOG_STEP / max(float(np.abs(step).max()), 1e-300))


def _line_search(evaluate: Callable[[np.ndarray], NoiseLikelihood], at: np.ndarray, here: NoiseLikelihood,
                 step: np.ndarray,
                 low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, NoiseLikelihood] | None:
    """The step, cut until it lowers the value; None if no cut of it does."""
    for cut in range(MAX_STEP_CUTS):
        there = np.clip(at + 0.25**cut * step, low, high)
        trial = evaluate(there)
        if trial.value < here.value:
            return there, trial
    return None
