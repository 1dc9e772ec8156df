"""Noise figures by scoring: Newton's method whose bends are those that the innovations have in the mean.

A likelihood of innovations e (N,) of variances v (N,), that of the first sensor profiled out, bends by what e and v
change by from one figure of the noise to the next; so one more pass per figure tells slope and bend, where a search
by values alone takes dozens.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.drive.simulation import Filtered

STEP = 0.01  # of a figure, all of which are logarithms, over which slopes are taken
LONGEST = 1.5  # step of a figure
BACK = 4  # times that a step which does not lower the value is cut to a quarter
WORTH = 2e-3  # log likelihood below which a step does not pay
SMALL = 0.05  # that of a step whose promise need not be looked at again, if it was kept
ROUNDS = 8


@dataclass(frozen=True)
class Heard:
    """What passes under a noise say.

    value        -log likelihood, to be made small
    innovations  (N,) of all sensors, traces and samples that count
    variance     (N,) theirs, over that of the first sensor
    """

    value: float
    innovations: np.ndarray
    variance: np.ndarray


def heard(value: float, passes: Sequence[Filtered], masks: Sequence[np.ndarray] | None = None) -> Heard:
    """A value with the innovations that count.

    masks  per trace (n,) whether a sample counts; None: all do
    """
    e = np.concatenate([(f.innovations if masks is None else f.innovations[m]).ravel()
                        for f, m in zip(passes, masks or passes, strict=True)])
    v = np.concatenate([(f.variance if masks is None else f.variance[m]).ravel()
                        for f, m in zip(passes, masks or passes, strict=True)])
    known = np.isfinite(e)
    return Heard(value, e[known], v[known])


def scored(listen: Callable[[np.ndarray], Heard], start: np.ndarray, low: np.ndarray, high: np.ndarray,
           rounds: int = ROUNDS) -> tuple[np.ndarray, float]:
    """Figures (k,) within their bounds that make the value smallest near a start, and that value.

    listen  figures -> what passes under them say; its value is infinite where there is none
    source  Fisher scoring: Caines 1988, Linear Stochastic Systems, chapter 7, with one variance profiled out
    """
    at = np.clip(start, low, high)
    here = listen(at)
    if not np.isfinite(here.value):
        return at, here.value
    for _ in range(rounds):
        slope, bend = _slope_and_bend(listen, at, here, high)
        step = _step(slope, bend, at, low, high)
        promise = -float(slope @ step) - 0.5 * float(step @ bend @ step)
        if not promise > WORTH:  # or no number
            break
        found = _downhill(listen, at, here, step, low, high)
        if found is None:
            break
        kept, before = 0.5 * promise, here.value
        at, here = found
        if promise < SMALL and abs(before - here.value - promise) < kept:
            break
    return at, here.value


def _slope_and_bend(listen: Callable[[np.ndarray], Heard], at: np.ndarray, here: Heard,
                    high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(k,) derivative of the value by differences, and (k, k) that of the innovations' likelihood in the mean.

    No numbers where a filter runs away.
    """
    count, e, v = len(here.innovations), here.innovations, here.variance
    variance = float(np.mean(e**2 / v))
    slope, ahead, motion, width = np.zeros(len(at)), np.where(at + STEP <= high, STEP, -STEP), [], []
    for j in range(len(at)):
        there = at.copy()
        there[j] += ahead[j]
        other = listen(there)
        if len(other.innovations) != count or not np.isfinite(other.value):
            return np.full(len(at), np.nan), np.full((len(at), len(at)), np.nan)
        slope[j] = (other.value - here.value) / ahead[j]
        motion.append((other.innovations - e) / (ahead[j] * np.sqrt(v * variance)))
        width.append((other.variance - v) / (ahead[j] * v))
    motion, width = np.array(motion), np.array(width)
    sums = width.sum(axis=1)
    bend = motion @ motion.T + 0.5 * width @ width.T - 0.5 * np.outer(sums, sums) / count
    return slope - 0.5 * ahead * np.diag(bend), bend  # a difference is the slope in the middle of its step


def _step(slope: np.ndarray, bend: np.ndarray, at: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Newton's step, no longer than LONGEST; figures on a bound that they would cross stay."""
    step = np.zeros(len(at))
    free = ~(((at <= low) & (slope > 0.0)) | ((at >= high) & (slope < 0.0)))
    if not free.any() or not np.isfinite(slope).all() or not np.isfinite(bend).all():
        return step
    size = np.sqrt(np.maximum(np.diag(bend)[free], 1e-12))
    scaled = bend[np.ix_(free, free)] / np.outer(size, size) + 1e-6 * np.eye(int(free.sum()))
    step[free] = -np.linalg.solve(scaled, slope[free] / size) / size
    return step * min(1.0, LONGEST / max(float(np.abs(step).max()), 1e-300))


def _downhill(listen: Callable[[np.ndarray], Heard], at: np.ndarray, here: Heard, step: np.ndarray,
              low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, Heard] | None:
    """The step, or what is left of it when it lowers the value; None if nothing of it does."""
    for cut in range(BACK):
        there = np.clip(at + 0.25**cut * step, low, high)
        trial = listen(there)
        if trial.value < here.value:
            return there, trial
    return None
