"""A model beside a measured run-down: errors of its angle and of its speed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.identify.coast_down import NOTHING, UNIFORM, Fitted, Stretch, fit, run_of, simulated
from drivetool.identify.estimate import Covariance
from drivetool.logs import Experiment

PARTS = 40  # of a run-down: a model errs smoothly, so that its error has one slope in each
FEWEST = 10  # readings of a part, by which a slope is known to a tenth of what two of them tell
BEGINNING = 0.1  # of the readings, by which the start state is measured
ENOUGH = 60  # readings at least for that, of counts that change


@dataclass(frozen=True)
class Signal:
    """One output of a run-down.

    measured   (n,), NaN where there is none
    simulated  (n,) with the start state fitted to all of the run-down; begun: to its beginning alone
    sensor     rmse that the sensor alone leaves; unsure: what the uncertainty of the parameters makes
    count      step of the sensor, 0 where it does not count
    """

    measured: np.ndarray
    simulated: np.ndarray
    begun: np.ndarray
    sensor: float
    count: float = 0.0
    unsure: float | None = None


@dataclass(frozen=True)
class RunDown:
    """A run-down beside its simulation: time (n,) [s], the angle where it was measured, and the speed."""

    time: np.ndarray
    angle: Signal | None
    speed: Signal


def beside(experiment: Experiment, stretch: Stretch, drive: Drive, encoder: float) -> RunDown:
    """Simulate a run-down by a model as it is; only the start state is fitted.

    The speed of a run-down by counts is not their difference, which steps by a count per sample: the slope of the
    angle's error over each of 40 parts is the error of the simulated speed.

    experiment  motor_angle or motor_speed; stretch: where the drive runs down without torque
    drive       all that a simulation needs has a value
    encoder     standard deviation of what the encoder errs by beyond its counts, as known beforehand
    raises      BadRecording: too few counts
    """
    whole = run_of(experiment, stretch)
    fitted = fit(drive, (), [whole], NOTHING)
    at = fitted.readings[0].known
    cut = min(max(int(BEGINNING * len(at)), ENOUGH), len(at) - 1)
    early = run_of(experiment, replace(stretch, last=stretch.first + int(at[cut]) + 1))
    begun = fit(drive, (), [early], NOTHING).starts[0]
    seen = slice(int(at[0]), int(at[-1]) + 1)  # beyond the last change of counts nothing is told
    (out, speed), (early_out, early_speed) = (
        [values[seen] for values in simulated(drive, whole, start)] for start in (fitted.starts[0], begun))
    reading, time = whole.reading, experiment.time[stretch.first:stretch.last][seen]
    if reading.role == "motor_speed":
        noise = float(np.nanmedian(reading.std))
        return RunDown(time, None, Signal(reading.values[seen], out, early_out, noise))
    if reading.counted is None:
        angle = Signal(reading.values[seen], out, early_out, float(np.nanmedian(reading.std)))
    else:  # a count is the angle's floor
        angle = Signal(reading.counted[seen] + 0.5 * reading.count, out, early_out,
                       float(np.hypot(UNIFORM * reading.count, encoder)), reading.count)
    error, floor = _speed_error(fitted, encoder)
    measured = speed - error[seen]
    return RunDown(time, angle, Signal(measured, speed, early_speed, floor))


def unsure(experiment: Experiment, stretch: Stretch, drive: Drive, run: RunDown, spread: Covariance) -> RunDown:
    """The same with the rmse that the uncertainty of the parameters makes.

    The parameters are moved along each principal axis of their correlation by its standard deviation, and the start
    state is fitted anew. A common factor of inertia and friction, which moves nothing, is such an axis.
    """
    whole = run_of(experiment, stretch)
    seen = round((run.time[0] - experiment.time[stretch.first]) / experiment.step)
    angle, speed = 0.0, 0.0
    for values in _moved(drive, spread):
        other = drive.with_values(values)
        out = simulated(other, whole, fit(other, (), [whole], NOTHING).starts[0])
        turned, fast = (part[seen:seen + len(run.time)] for part in out)
        speed += float(np.mean((fast - run.speed.simulated) ** 2))
        angle += float(np.mean((turned - run.angle.simulated) ** 2)) if run.angle else 0.0
    return replace(run, angle=run.angle and replace(run.angle, unsure=float(np.sqrt(angle))),
                   speed=replace(run.speed, unsure=float(np.sqrt(speed))))


def _moved(drive: Drive, spread: Covariance) -> list[dict[str, float]]:
    """The values of each move, inside the bounds of what a parameter may be."""
    variance = np.diag(spread.matrix)
    at = np.flatnonzero(variance > 0.0)
    std = np.sqrt(variance[at])
    sizes, axes = np.linalg.eigh(spread.matrix[np.ix_(at, at)] / np.outer(std, std))
    found = []
    for size, axis in zip(sizes, axes.T, strict=True):
        away = std * axis * np.sqrt(max(size, 0.0))
        found.append({n: float(np.clip(drive.values[n] + d, *drive.quantity(n).bounds))
                      for n, d in zip((spread.names[i] for i in at), away, strict=True)})
    return found


def _speed_error(fitted: Fitted, encoder: float) -> tuple[np.ndarray, float]:
    """(simulated less measured speed (n,), rmse of it that the sensor alone leaves), by an angle."""
    reading = fitted.readings[0]
    at = reading.known
    error = fitted.left * reading.std[at]
    # An error of the model is none of the encoder, which the fit takes it for.
    std = np.sqrt(np.maximum(reading.std[at] ** 2 - reading.error**2, 0.0) + encoder**2)
    middles, slopes, squares = [], [], []
    for part in np.array_split(np.arange(len(at)), max(1, min(PARTS, len(at) // FEWEST))):
        time, weight = at[part] * reading.step, std[part] ** -2.0
        away = time - np.average(time, weights=weight)
        moment = float(np.sum(weight * away**2))
        middles.append(time.mean())
        slopes.append(float(np.sum(weight * away * error[part])) / moment)
        squares.append(1.0 / moment)
    every = np.arange(len(reading.values)) * reading.step
    return np.interp(every, middles, slopes), float(np.sqrt(np.mean(squares)))
