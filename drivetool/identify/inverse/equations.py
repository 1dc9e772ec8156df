"""The filtered equations of inverse dynamics: what the motor's torque has over what the motion asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivetool.drive.chain import Drive
from drivetool.identify.inverse.asked import Part, asked
from drivetool.identify.inverse.motion import ORDER, Motion, Motions
from drivetool.logs.experiment import Experiment
from drivetool.logs.zero_phase import low_pass

STANDING = 0.05  # of standstill in what the filter mixes into a sample, from which it is left out


@dataclass(frozen=True)
class Equations:
    """One equation per sample of a recording, all filtered alike.

    torque    (n,) of the motor; residual: what is left of it
    slopes    (n, k) of what the motion asks for over the free parameters
    used      (n,) whether the sample tells something: measured, no standstill, no transient of the filter
    """

    torque: np.ndarray
    residual: np.ndarray
    slopes: np.ndarray
    used: np.ndarray


def equations(e: Experiment, drive: Drive, free: tuple[str, ...], seen: Motions, motion: Motion,
              standing: np.ndarray, inputs: Mapping[str, np.ndarray], more: Part | None = None) -> Equations:
    """The equations of a recording at the drive's values.

    drive     of one body; more: what the chain behind it asks for
    seen      how the motion was smoothed; motion: that is asked for the torque
    standing  (n,) where the body stands: there friction is whatever holds it
    inputs    role -> (n,) other torques
    source    Gautier, Janot and Vandanjon 2013: zero-phase filters, the same on both sides of the equation
    """
    cutoff, is_angle = seen.smoothing.cutoff, seen.lag > 0
    a = asked(drive, free, motion, e.step, inputs)
    rest = a.rest if more is None else Part(a.rest.value + more.value, a.rest.slopes + more.slopes)

    def low(values: np.ndarray) -> np.ndarray:
        # Acceleration and speed come from a motion that is smooth already; nothing else does.
        return weighed(low_pass(values, e.segments, cutoff, ORDER))

    def weighed(values: np.ndarray) -> np.ndarray:
        # A second difference of the angle weighs three torques so.
        return _weighed(values) if is_angle else values

    # Where the motion is a straight line between what was measured, it tells nothing of the torque.
    torque, share = (low(np.where(motion.known, v, np.nan)) for v in (e.signals["motor_torque"], standing))
    value = a.accelerating.value + weighed(a.sliding.value) + low(rest.value)
    slopes = np.column_stack([np.empty((e.size, 0)), *(
        one + weighed(two) + low(three) for one, two, three in zip(
            a.accelerating.slopes.T, a.sliding.slopes.T, rest.slopes.T, strict=True))])
    used = np.isfinite(torque + value) & np.isfinite(slopes).all(axis=1) & (share < STANDING)
    edge = int(1.0 / cutoff) + 1
    for first, last in e.segments:  # the filter's own transient
        used[first:first + edge] = used[max(last - edge, first):last] = False
    return Equations(torque, torque - value, slopes, used)


def stands(slow: np.ndarray) -> np.ndarray:
    """Where a neighbour is slow as well: a reversal at speed is no standstill."""
    beside = np.concatenate([slow[1:2], slow[:-1]]) | np.concatenate([slow[1:], slow[-1:]])
    return slow & beside


def _weighed(values: np.ndarray) -> np.ndarray:
    """Each with a quarter of its neighbours."""
    found = np.full(len(values), np.nan)
    found[1:-1] = 0.25 * (values[:-2] + values[2:]) + 0.5 * values[1:-1]
    return found
