"""A model compared with a measured coast-down: errors of its angle and of its speed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.identify.coast_down import NO_PRIOR, UNIFORM_STD, CoastDownFit, Stretch, fit, run_of, simulated
from drivetool.identify.estimate import Covariance
from drivetool.logs import Experiment

SPEED_ERROR_PARTS = 40  # of a coast-down: the error of a model is smooth, so that it has one slope in each part
# Readings of a part: the standard error of a slope is then a fraction of that by two of them.
MIN_PART_READINGS = 10
# Of the readings, to which the start state is fitted. A choice: fewer leave it uncertain, more hide drift.
START_SHARE = 0.1
# Readings at least for that, of counts that change. A choice: quantisation then averages out.
MIN_START_READINGS = 60


@dataclass(frozen=True)
class Signal:
    """One output of a coast-down.

    measured   (n,), NaN where there is none
    simulated  (n,) with the start state fitted to all of the coast-down; from_beginning: to its beginning alone
    sensor     rmse of the sensor alone; unsure: rmse by the uncertainty of the parameters
    count      quantisation step of the sensor, 0 where it has none
    """

    measured: np.ndarray
    simulated: np.ndarray
    from_beginning: np.ndarray
    sensor: float
    count: float = 0.0
    parameters_rms: float | None = None


@dataclass(frozen=True)
class CoastDownComparison:
    """A coast-down with its simulation: time (n,) [s], the angle where it was measured, and the speed."""

    time: np.ndarray
    angle: Signal | None
    speed: Signal


def compare_coast_down(
        experiment: Experiment, stretch: Stretch, drive: Drive, encoder: float) -> CoastDownComparison:
    """Simulate a coast-down by a model as it is; only the start state is fitted.

    The speed by an encoder is not the difference of its counts, which is quantised: the slope of the angle's error
    over each of 40 parts is the error of the simulated speed.

    experiment  motor_angle or motor_speed; stretch: where the drive coasts down without torque
    drive       all that a simulation needs has a value
    encoder     standard deviation of the encoder's error beyond quantisation, as known beforehand
    raises      BadRecording: too few counts
    """
    whole = run_of(experiment, stretch)
    fitted = fit(drive, (), [whole], NO_PRIOR)
    at = fitted.readings[0].known
    cut = min(max(int(START_SHARE * len(at)), MIN_START_READINGS), len(at) - 1)
    early = run_of(experiment, replace(stretch, last=stretch.first + int(at[cut]) + 1))
    early_start = fit(drive, (), [early], NO_PRIOR).starts[0]
    seen = slice(int(at[0]), int(at[-1]) + 1)  # after the last change of counts there is no information
    (out, speed), (early_out, early_speed) = (
        [values[seen] for values in simulated(drive, whole, start)] for start in (fitted.starts[0], early_start))
    reading, time = whole.reading, experiment.time[stretch.first:stretch.last][seen]
    if reading.role == "motor_speed":
        noise = float(np.nanmedian(reading.std))
        return CoastDownComparison(time, None, Signal(reading.values[seen], out, early_out, noise))
    if reading.counted is None:
        angle = Signal(reading.values[seen], out, early_out, float(np.nanmedian(reading.std)))
    else:  # a count is the angle's floor
        angle = Signal(reading.counted[seen] + 0.5 * reading.count, out, early_out,
                       float(np.hypot(UNIFORM_STD * reading.count, encoder)), reading.count)
    error, floor = _speed_error(fitted, encoder)
    measured = speed - error[seen]
    return CoastDownComparison(time, angle, Signal(measured, speed, early_speed, floor))


def with_parameter_errors(experiment: Experiment, stretch: Stretch, drive: Drive, run: CoastDownComparison,
           covariance: Covariance) -> CoastDownComparison:
    """The same with the rmse by the uncertainty of the parameters.

    The parameters are moved along each principal axis of their correlation by its standard deviation, and the start
    state is refitted. A common factor of inertia and friction is such an axis; it changes no motion.
    """
    whole = run_of(experiment, stretch)
    seen = round((run.time[0] - experiment.time[stretch.first]) / experiment.step)
    angle, speed = 0.0, 0.0
    for values in _principal_moves(drive, covariance):
        other = drive.with_values(values)
        out = simulated(other, whole, fit(other, (), [whole], NO_PRIOR).starts[0])
        turned, fast = (part[seen:seen + len(run.time)] for part in out)
        speed += float(np.mean((fast - run.speed.simulated) ** 2))
        angle += float(np.mean((turned - run.angle.simulated) ** 2)) if run.angle else 0.0
    return replace(run, angle=run.angle and replace(run.angle, parameters_rms=float(np.sqrt(angle))),
                   speed=replace(run.speed, parameters_rms=float(np.sqrt(speed))))


def _principal_moves(drive: Drive, covariance: Covariance) -> list[dict[str, float]]:
    """The values of each move, inside the bounds of the parameters."""
    variance = np.diag(covariance.matrix)
    at = np.flatnonzero(variance > 0.0)
    std = np.sqrt(variance[at])
    sizes, axes = np.linalg.eigh(covariance.matrix[np.ix_(at, at)] / np.outer(std, std))
    found = []
    for size, axis in zip(sizes, axes.T, strict=True):
        shift = std * axis * np.sqrt(max(size, 0.0))
        found.append({n: float(np.clip(drive.values[n] + d, *drive.quantity(n).bounds))
                      for n, d in zip((covariance.names[i] for i in at), shift, strict=True)})
    return found


def _speed_error(fitted: CoastDownFit, encoder: float) -> tuple[np.ndarray, float]:
    """(simulated less measured speed (n,), rmse of it by the sensor alone), from an angle."""
    reading = fitted.readings[0]
    at = reading.known
    error = fitted.weighted_residuals * reading.std[at]
    # The fit attributes an error of the model to the encoder: it is removed from the encoder's variance.
    std = np.sqrt(np.maximum(reading.std[at] ** 2 - reading.error**2, 0.0) + encoder**2)
    middles, slopes, squares = [], [], []
    for part in np.array_split(np.arange(len(at)), max(1, min(SPEED_ERROR_PARTS, len(at) // MIN_PART_READINGS))):
        time, weight = at[part] * reading.step, std[part] ** -2.0
        centred = time - np.average(time, weights=weight)
        moment = float(np.sum(weight * centred**2))
        middles.append(time.mean())
        slopes.append(float(np.sum(weight * centred * error[part])) / moment)
        squares.append(1.0 / moment)
    every = np.arange(len(reading.values)) * reading.step
    return np.interp(every, middles, slopes), float(np.sqrt(np.mean(squares)))
