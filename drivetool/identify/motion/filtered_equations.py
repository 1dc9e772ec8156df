"""The filtered equations of inverse dynamics: what the motor's torque has over what the motion asks for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.drive import Drive
from drivetool.identify.estimate import Exhibit, fit_percent
from drivetool.identify.motion.motion import ORDER, Motion, Motions
from drivetool.identify.motion.required_torque import Part, asked
from drivetool.logs import Experiment
from drivetool.logs.samples import low_pass

ROUNDED = 1e-9  # of a torque's root mean square: what varies by less is constant
MOST_TURNING = 0.5  # of a recording about reversals, up to which they are left out
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


@dataclass(frozen=True)
class TorqueFit:
    """How well a motion asks for the torque, over the samples that are used.

    fit_percent  100 (1 - error over standard deviation), NaN of a constant torque
    rmse         in the torque's unit; over_rms, over_sd: over the torque's root mean square and standard deviation
    """

    fit_percent: float
    rmse: float
    over_rms: float
    over_sd: float
    n: int


def torque_fit(found: Sequence[Equations]) -> TorqueFit:
    """The figures of recordings together."""
    torque, left = (np.concatenate([v[q.used] for v, q in zip(each, found, strict=True)]) for each in (
        [q.torque for q in found], [q.residual for q in found]))
    error, rms, sd = (float(np.sqrt(np.mean(v**2))) for v in (left, torque, torque - torque.mean()))
    constant = sd <= ROUNDED * rms
    return TorqueFit(fit_percent(torque, torque - left), error, error / rms if rms else np.inf,
                     1.0 if constant else error / sd, len(torque))


def torque_picture(e: Experiment, q: Equations, title: str) -> Exhibit:
    """The torque as logged, and as the motion asks for it."""
    return Exhibit("record", title, "time [s]", f"motor torque [{e.torque_unit}]", {
        "measured": (e.time, q.torque), "simulated": (e.time, np.where(q.used, q.torque - q.residual, np.nan)),
        "residual": (e.time, np.where(q.used, q.residual, np.nan))})


def equations(e: Experiment, drive: Drive, free: tuple[str, ...], seen: Motions, motion: Motion,
              standing: np.ndarray, inputs: Mapping[str, np.ndarray], more: Part | None = None) -> Equations:
    """The equations of a recording at the drive's values.

    drive     of one body; more: what the chain behind it asks for
    seen      of which sensor; motion: that is asked for the torque
    standing  (n,) where the body stands: there friction is whatever holds it
    inputs    role -> (n,) other torques
    source    Gautier, Janot and Vandanjon 2013: zero-phase filters, the same on both sides of the equation
    """
    is_angle = seen.lag > 0
    a = asked(drive, free, motion, e.step, inputs)
    rest = a.rest if more is None else Part(a.rest.value + more.value, a.rest.slopes + more.slopes)

    def low(values: np.ndarray) -> np.ndarray:
        # Acceleration and speed come from a motion that is smooth already; nothing else does.
        return smoothed(values, e, motion, is_angle)

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
    edge = int(1.0 / motion.smoothing.cutoff) + 1
    for first, last in e.segments:  # the filter's own transient
        used[first:first + edge] = used[max(last - edge, first):last] = False
    return Equations(torque, torque - value, slopes, used)


def smoothed(values: np.ndarray, e: Experiment, motion: Motion, is_angle: bool) -> np.ndarray:
    """(n,) torques as the equations have them, for a motion that an angle or a speed shows."""
    found = low_pass(values, e.segments, motion.smoothing.cutoff, ORDER)
    return _weighed(found) if is_angle else found


def turns(motion: Motion) -> np.ndarray:
    """(n,) where the filter has rounded a reversal, at which dry friction is a step: as long as its own transient.

    Nowhere where the body turns so often that most of the record would be left out.
    """
    side = np.sign(np.nan_to_num(motion.speed))
    reach = int(1.0 / motion.smoothing.cutoff) + 1
    turned = np.concatenate([[False], side[1:] * side[:-1] < 0.0])
    found = np.convolve(turned, np.ones(2 * reach + 1), "same") > 0.5
    return found & (np.mean(found) < MOST_TURNING)


def stands(slow: np.ndarray) -> np.ndarray:
    """Where a neighbour is slow as well: a reversal at speed is no standstill."""
    beside = np.concatenate([slow[1:2], slow[:-1]]) | np.concatenate([slow[1:], slow[-1:]])
    return slow & beside


def _weighed(values: np.ndarray) -> np.ndarray:
    """Each with a quarter of its neighbours."""
    found = np.full(len(values), np.nan)
    found[1:-1] = 0.25 * (values[:-2] + values[2:]) + 0.5 * values[1:-1]
    return found
