"""The filtered equations of inverse dynamics: the motor's torque minus the torque that the motion requires."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.drive import Drive
from drivetool.identify.estimate import PlotData, fit_percent
from drivetool.identify.motion.motion import LOW_PASS_ORDER, Motion, Motions
from drivetool.identify.motion.required_torque import TorquePart, required_torque_of
from drivetool.logs import Experiment
from drivetool.logs.samples import low_pass

# Of a torque's root mean square: a smaller variation is rounding, and the torque constant.
CONSTANT_TORQUE_TOLERANCE = 1e-9
# Share of a recording about reversals up to which they are left out. A choice: half must remain
MAX_REVERSAL_SHARE = 0.5
# Share of standstill in a filtered sample from which it is left out. A choice: a twentieth biases friction by less
# than its uncertainty; zero would drop samples a whole filter length around each standstill.
MAX_STANDSTILL_SHARE = 0.05


@dataclass(frozen=True)
class Equations:
    """One equation per sample of a recording, all filtered alike.

    torque    (n,) of the motor; residual: minus the required torque
    slopes    (n, k) derivatives of the required torque over the free parameters
    used      (n,) whether the sample counts: measured, no standstill, no transient of the filter
    """

    torque: np.ndarray
    residual: np.ndarray
    slopes: np.ndarray
    used: np.ndarray


@dataclass(frozen=True)
class TorqueFit:
    """Agreement of the required with the logged torque, over the samples that are used.

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
    torque, residual = (np.concatenate([v[q.used] for v, q in zip(each, found, strict=True)]) for each in (
        [q.torque for q in found], [q.residual for q in found]))
    error, rms, sd = (float(np.sqrt(np.mean(v**2))) for v in (residual, torque, torque - torque.mean()))
    constant = sd <= CONSTANT_TORQUE_TOLERANCE * rms
    return TorqueFit(fit_percent(torque, torque - residual), error, error / rms if rms else np.inf,
                     1.0 if constant else error / sd, len(torque))


def torque_picture(e: Experiment, models: Mapping[str, Equations], title: str) -> PlotData:
    """The torque as logged, and as the motion requires it by each of the models; their names, one may be empty."""
    errors = {name: np.where(q.used, q.residual, np.nan) for name, q in models.items()}
    torque = next(iter(models.values())).torque
    return PlotData("record", title, "time [s]", f"motor torque [{e.torque_unit}]", {
        "measured": (e.time, torque)} | {
        f"{word} {name}".strip(): (e.time, values) for name, error in errors.items()
        for word, values in (("simulated", torque - error), ("residual", error))})


def equations(e: Experiment, drive: Drive, free: tuple[str, ...], seen: Motions, motion: Motion,
              standing: np.ndarray, inputs: Mapping[str, np.ndarray], more: TorquePart | None = None) -> Equations:
    """The equations of a recording at the drive's values.

    drive     of one body; more: the torque that the chain behind it requires
    seen      motion by the sensor; motion: whose required torque is computed
    standing  (n,) where the body stands: there friction takes any value that holds it
    inputs    role -> (n,) other torques
    source    Gautier, Janot and Vandanjon 2013: zero-phase filters, the same on both sides of the equation
    """
    is_angle = seen.lag > 0
    required = required_torque_of(drive, free, motion, e.step, inputs)
    rest = required.rest if more is None else TorquePart(
        required.rest.value + more.value, required.rest.slopes + more.slopes)

    def low(values: np.ndarray) -> np.ndarray:
        # Acceleration and speed come from a motion that is already smoothed; other torques do not.
        return smoothed(values, e, motion, is_angle)

    def weighed(values: np.ndarray) -> np.ndarray:
        # A second difference of the angle weights three torques in this way.
        return _three_point_mean(values) if is_angle else values

    # Where the motion is interpolated between measured samples, it has no information on the torque.
    torque, share = (low(np.where(motion.known, v, np.nan)) for v in (e.signals["motor_torque"], standing))
    value = required.accelerating.value + weighed(required.sliding.value) + low(rest.value)
    slopes = np.column_stack([np.empty((e.size, 0)), *(
        one + weighed(two) + low(three) for one, two, three in zip(
            required.accelerating.slopes.T, required.sliding.slopes.T, rest.slopes.T, strict=True))])
    used = np.isfinite(torque + value) & np.isfinite(slopes).all(axis=1) & (share < MAX_STANDSTILL_SHARE)
    edge = int(1.0 / motion.smoothing.cutoff) + 1
    for first, last in e.segments:  # the filter's own transient
        used[first:first + edge] = used[max(last - edge, first):last] = False
    return Equations(torque, torque - value, slopes, used)


def smoothed(values: np.ndarray, e: Experiment, motion: Motion, is_angle: bool) -> np.ndarray:
    """(n,) torques filtered as in the equations, for a motion measured by an angle or a speed."""
    found = low_pass(values, e.segments, motion.smoothing.cutoff, LOW_PASS_ORDER)
    return _three_point_mean(found) if is_angle else found


def near_reversal(motion: Motion) -> np.ndarray:
    """(n,) where the filter smooths the step of dry friction at a reversal: as long as its own transient.

    Nowhere if the body reverses so often that most of the record would be left out.
    """
    side = np.sign(np.nan_to_num(motion.speed))
    reach = int(1.0 / motion.smoothing.cutoff) + 1
    turned = np.concatenate([[False], side[1:] * side[:-1] < 0.0])
    found = np.convolve(turned, np.ones(2 * reach + 1), "same") > 0.5
    return found & (np.mean(found) < MAX_REVERSAL_SHARE)


def at_standstill(slow: np.ndarray) -> np.ndarray:
    """Where a neighbour is slow as well: a fast reversal is no standstill."""
    beside = np.concatenate([slow[1:2], slow[:-1]]) | np.concatenate([slow[1:], slow[-1:]])
    return slow & beside


def _three_point_mean(values: np.ndarray) -> np.ndarray:
    """Half of each sample plus a quarter of each neighbour."""
    found = np.full(len(values), np.nan)
    found[1:-1] = 0.25 * (values[:-2] + values[2:]) + 0.5 * values[1:-1]
    return found
