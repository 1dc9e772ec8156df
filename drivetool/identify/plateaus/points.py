"""From steady intervals to points of torque over speed, with their standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.identify.plateaus.intervals import SteadyInterval, mean_variances

# Means of speed closer than this share of the fastest are one level. A choice: twice the least of a motion.
SAME_LEVEL_SHARE = 0.02
# Slower than this share of the fastest motion is standstill, a choice: sticking friction takes any torque there,
# and follows no line over the speed.
STANDSTILL_SPEED_SHARE = 0.01


@dataclass(frozen=True)
class SteadyPoints:
    """Steady points of one line: speed, torque and their standard deviations, each (k,).

    intervals  where they come from
    variance   (k,) of torque - c speed, which is what scatters about the line; dof: its degrees of freedom
    """

    intervals: tuple[SteadyInterval, ...]
    speed: np.ndarray
    torque: np.ndarray
    speed_std: np.ndarray
    torque_std: np.ndarray
    variance: np.ndarray
    dof: float

    @property
    def levels(self) -> np.ndarray:
        """(k,) |speed| of the level each point belongs to, the same for both directions."""
        size = np.abs(self.speed)
        order, found = np.argsort(size), np.empty(len(size))
        first = None
        for i in order:
            if first is None or size[i] - first > SAME_LEVEL_SHARE * size.max():
                first = size[i]
            found[i] = first
        return found


def make_points(intervals: Sequence[SteadyInterval], torque: str, speed: str) -> SteadyPoints | None:
    """Points of torque over speed; standstill left out. None if nothing is left.

    What is left of the acceleration in an interval is taken off its torque: the tail of a set-point step
    is far below the noise and would still shift a mean over thousands of samples.

    torque, speed  roles
    """
    w = np.array([i.mean(speed) for i in intervals])
    moving = np.abs(w) > STANDSTILL_SPEED_SHARE * max(i.fastest for i in intervals)
    kept = tuple(i for i, m in zip(intervals, moving, strict=True) if m)
    if not kept:
        return None
    w, steps = w[moving], [i.step for i in kept]
    torques, speeds = [i.signals[torque] for i in kept], [i.signals[speed] for i in kept]
    t = np.array([i.mean(torque) - i.inertia[torque] * i.rise for i in kept])
    viscous = np.linalg.lstsq(np.column_stack([w, np.ones_like(w), np.sign(w)]), t, rcond=None)[0][0]
    drift = np.array([i.inertia[torque] * i.rise_std for i in kept])
    noise, dof = mean_variances([a - viscous * b for a, b in zip(torques, speeds, strict=True)], steps)
    # A noiseless record still rounds.
    variance = np.maximum(noise + drift**2, (1e-9 * np.abs(t).max(initial=0.0))**2 + 1e-300)
    return SteadyPoints(kept, w, t, np.sqrt(mean_variances(speeds, steps)[0]),
                  np.sqrt(mean_variances(torques, steps)[0] + drift**2), variance, dof)
