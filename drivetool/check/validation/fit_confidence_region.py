"""The confidence region of a fit, within which a held-out record is tested.

The values of a parameter file are estimates, and so is the strength of its torque noise. In another motion an error
well inside an interval may move the drive by more than the sensor's noise, and a torque noise too weak to be seen
in one record may appear in the next. Neither means that a law is missing. So the residual is that of the likeliest
model inside the confidence region of the fit; a model that the record contradicts keeps a large residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from drivetool.drive import Drive
from drivetool.drive.simulation import Trace
from drivetool.identify.estimate import Covariance
from drivetool.identify.noise import (
    MAX_MINUS_LOG_LIKELIHOOD,
    Noise,
    filtered,
    first_samples_of,
    minimise_by_parabolas,
    minus_log_likelihood,
    unit_noise_ratio,
)
from drivetool.identify.outcome import MAX_UNCERTAIN_RATIO
from drivetool.identify.problem import Point, Problem, schur
from drivetool.identify.setup import Roles, problem_of, with_trial_values

# Of the region of the parameters and of the interval of the ratio: one less DEPENDENCE_SIGNIFICANCE.
CONFIDENCE_LEVEL = 0.99
RATIO_RELATIVE_STD = 0.1  # relative standard deviation of a ratio of MAX_UNCERTAIN_RATIO looks
MIN_RATIO_TO_NATURAL = 1e-6  # of the natural ratio: below, torque noise moves no output measurably
# Ratios of an interval before parabolas. A choice: they bracket the minimum, each costs a filter pass.
RATIO_GRID_POINTS = 9
# Of the interval of the weight of a step to the edge of the region: an error of 2^-40, rounding.
WEIGHT_HALVINGS = 40


def ratio_interval(ratio: float, natural: float, count: int) -> tuple[float, float]:
    """(least, largest) ratio of torque to sensor noise in the confidence interval of a fit which found `ratio`.

    The relative standard deviation of a ratio falls with the root of its looks, counted as in
    `noise_ratio_uncertainty`: where none was found there may be some thirty.

    natural  ratio at which a sample of torque noise moves the first output by its sensor noise; count: of samples
    """
    one_look = natural / max(count, 1)
    # looks = found +- z s sqrt(looks) at the ends
    half = 0.5 * scipy.special.ndtri(0.5 + 0.5 * CONFIDENCE_LEVEL) * RATIO_RELATIVE_STD * np.sqrt(
        MAX_UNCERTAIN_RATIO)
    root = np.sqrt(half**2 + ratio / one_look)
    return (max(float((root - half) ** 2 * one_look), MIN_RATIO_TO_NATURAL * natural),
            float((root + half) ** 2 * one_look))


def likeliest_noise_in_interval(problem: Problem, point: Point, noise: Noise) -> Noise:
    """The likeliest noise of the traces at a point, with a ratio in the confidence interval of the fit."""
    ends = ratio_interval(noise.ratio, unit_noise_ratio(problem, point), problem.count)
    part = first_samples_of(problem)

    def value(log: float) -> float:
        with np.errstate(over="ignore", invalid="ignore"):
            return min(minus_log_likelihood(filtered(part, point, _with_log_ratio(noise, log), keep=False)),
                       MAX_MINUS_LOG_LIKELIHOOD)

    return _with_log_ratio(noise, minimise_by_parabolas(value, np.linspace(*np.log(ends), RATIO_GRID_POINTS)))


def _with_log_ratio(noise: Noise, log: float) -> Noise:
    return replace(noise, ratio=float(np.exp(log)))


def likeliest_drive_in_region(drive: Drive, roles: Roles, traces: Sequence[Trace], point: Point, noise: Noise,
                              known: Covariance) -> Drive | None:
    """The drive with the likeliest values inside the confidence region of the fit, by one Gauss-Newton step.

    drive  at the values of the fit; point: start states under the noise
    known  covariance of the values; the fit has the weight of the record, and more at the edge of the region
    """
    known = known.part(name for name in known.names if name in drive.values and name in drive.quantities)
    if known is None:
        return None
    names = known.names
    problem = problem_of(drive, names, roles, traces).with_memory(noise.memory)
    values = np.array([drive.value(name) for name in names])
    gains = [f.gains for f in filtered(problem, Point(values, point.starts), noise)]
    normal = problem.normal(Point(values, point.starts), gains)
    hessian, gradient, _ = schur(normal)
    variance = normal.cost / max(problem.count, 1)
    if not np.isfinite(hessian).all() or not variance > 0.0:
        return None
    square, axes = np.linalg.eigh(known.matrix)
    root = axes * np.sqrt(np.maximum(square, 0.0))
    values = values + root @ _step_in_region(root.T @ hessian @ root / variance, root.T @ gradient / variance)
    return with_trial_values(drive, names, np.clip(values, problem.low, problem.high))


def _step_in_region(hessian: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """(k,) step to the minimum of a quadratic form plus half the squared step, or to the edge of the region."""
    limit = float(scipy.special.chdtri(len(gradient), 1.0 - CONFIDENCE_LEVEL))
    curvature, axes = np.linalg.eigh(hessian)
    down = axes.T @ gradient

    def step(weight: float) -> np.ndarray:
        return -down / (np.maximum(curvature, 0.0) + weight)

    low, high = 1.0, 1.0
    while np.sum(step(high) ** 2) > limit:
        low, high = high, 2.0 * high
    for _ in range(WEIGHT_HALVINGS if high > low else 0):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.sum(step(middle) ** 2) > limit else (low, middle)
    return axes @ step(high)
