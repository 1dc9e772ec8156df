"""What a fit leaves open, within which a record that it has not seen is judged.

The values of a parameter file are estimates, and so is the strength of its torque noise. In another motion an error
well inside an interval may move the drive by more than the sensor's noise, and a torque noise too weak to be seen
in one record shows in the next. Neither says that a law is missing. So the residual is taken about the likeliest
model among those that the fit does not contradict; one that the record contradicts stays as far off as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri, ndtri

from drivetool.drive import Drive
from drivetool.drive.simulation import Trace
from drivetool.identify.estimate import Covariance
from drivetool.identify.noise import (
    FAR,
    Noise,
    by_parabolas,
    excerpt,
    filtered,
    minus_log_likelihood,
    natural_ratio,
)
from drivetool.identify.outcome import KNOWN
from drivetool.identify.problem import Point, Problem, schur
from drivetool.identify.setup import Roles, problem_of, replaced

LEVEL = 0.99  # of the region of the parameters and of the interval of the ratio, that of the test which follows
TENTH = 0.1  # relative standard deviation of a ratio of KNOWN looks
LEAST = 1e-6  # of the natural ratio: no torque noise
LOOKS = 9  # at ratios of an interval, before parabolas
HALVINGS = 40  # of the interval of the weight with which a step ends on the edge of the region


def interval_of(ratio: float, natural: float, count: int) -> tuple[float, float]:
    """(least, largest) ratio of torque to sensor noise that a fit which found `ratio` does not contradict.

    A ratio of so many looks, counted as in `noise_doubt`, has a relative standard deviation that falls with their
    root: where none was found there may be some thirty.

    natural  ratio at which a sample of torque noise moves the first output by its sensor noise; count: of samples
    """
    one_look = natural / max(count, 1)
    # looks = found +- z s sqrt(looks) at the ends
    half = 0.5 * ndtri(0.5 + 0.5 * LEVEL) * TENTH * np.sqrt(KNOWN)
    root = np.sqrt(half**2 + ratio / one_look)
    return max(float((root - half) ** 2 * one_look), LEAST * natural), float((root + half) ** 2 * one_look)


def likeliest(problem: Problem, point: Point, noise: Noise) -> Noise:
    """The likeliest noise of the traces at a point, of a ratio that the one found by a fit leaves possible."""
    ends = interval_of(noise.ratio, natural_ratio(problem, point), problem.count)
    part = excerpt(problem)

    def value(log: float) -> float:
        with np.errstate(over="ignore", invalid="ignore"):
            return min(minus_log_likelihood(filtered(part, point, _louder(noise, log), keep=False)), FAR)

    return _louder(noise, by_parabolas(value, np.linspace(*np.log(ends), LOOKS)))


def _louder(noise: Noise, log: float) -> Noise:
    return replace(noise, ratio=float(np.exp(log)))


def moved(drive: Drive, roles: Roles, traces: Sequence[Trace], point: Point, noise: Noise,
          known: Covariance) -> Drive | None:
    """The drive with the likeliest values inside the region of the fit, by one Gauss-Newton step from these.

    drive  at the values of the fit; point: start states under the noise
    known  covariance of the values; the fit weighs as much as the record does, and more where the region ends
    """
    keep = [i for i, name in enumerate(known.names) if name in drive.values and name in drive.quantities]
    names, matrix = tuple(known.names[i] for i in keep), known.matrix[np.ix_(keep, keep)]
    if not names:
        return None
    problem = problem_of(drive, names, roles, traces).with_memory(noise.memory)
    values = np.array([drive.value(name) for name in names])
    gains = [f.gains for f in filtered(problem, Point(values, point.starts), noise)]
    normal = problem.normal(Point(values, point.starts), gains)
    bend, slope, _ = schur(normal)
    variance = normal.cost / max(problem.count, 1)
    if not np.isfinite(bend).all() or not variance > 0.0:
        return None
    square, axes = np.linalg.eigh(matrix)
    root = axes * np.sqrt(np.maximum(square, 0.0))
    values = values + root @ _inside(root.T @ bend @ root / variance, root.T @ slope / variance)
    return replaced(drive, names, np.clip(values, problem.low, problem.high))


def _inside(bend: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """(k,) step to the minimum of a square form plus half the squared step, or to the edge of the region."""
    limit = float(chdtri(len(slope), 1.0 - LEVEL))
    curve, turn = np.linalg.eigh(bend)
    down = turn.T @ slope

    def step(weight: float) -> np.ndarray:
        return -down / (np.maximum(curve, 0.0) + weight)

    low, high = 1.0, 1.0
    while np.sum(step(high) ** 2) > limit:
        low, high = high, 2.0 * high
    for _ in range(HALVINGS if high > low else 0):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.sum(step(middle) ** 2) > limit else (low, middle)
    return turn @ step(high)
