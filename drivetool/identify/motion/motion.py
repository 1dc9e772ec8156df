"""The smoothed motion of the motor over the samples' intervals: the regressors of laws and of the regression.

A torque is held from a sample to the next, so each value here is a mean over that interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.errors import NotEnoughData
from drivetool.logs import Experiment, group_by_rate, true_runs
from drivetool.logs.samples import MAX_BRIDGED_SAMPLES, low_pass

# Sensor noise in the acceleration lowers the inertia of a regression by its share of the acceleration's power.
NOISE_SHARE = 3e-3
MAX_CUTOFF, CUTOFF_FACTOR, MIN_CUTOFF = 0.2, 0.7, 2e-3  # cut-offs tried, in cycles per sample
LOW_PASS_ORDER = 3
# Of the Nyquist frequency, above which the spectrum is noise. A choice: a drive hardly moves there
NOISE_BAND_START = 0.8
SIGN_SIGNIFICANCE = 3.0  # standard deviations of the speed's noise below which its sign is not significant (99.7 %)
# Of the top speed, below which a body stands. A choice: below the speed of a slow plateau
MIN_MOVING_SPEED_SHARE = 5e-3
FREQUENCY_GRID = np.linspace(0.0, 0.5, 2049)[1:]  # cycles per sample


@dataclass(frozen=True)
class Smoothing:
    """A low-pass: its cut-off in cycles per sample, and the std of the remaining noise of the speed."""

    cutoff: float
    speed_noise: float

    @property
    def window(self) -> int:
        """Samples of a mean with the bandwidth of the low-pass."""
        return max(round(0.4 / self.cutoff), 1)


@dataclass(frozen=True)
class Motion:
    """Means over the samples' intervals of one experiment, each (n,); NaN outside its segments.

    speed, acceleration, angle, side (of the sign of the speed)
    time     in the middle of the interval [s] from the start of the recording
    slow     whether the sign of the speed is not significant, or the body stands
    known    whether it was measured; elsewhere it is interpolated linearly
    smoothing  the low-pass, as the sensor's noise at that sampling rate allows
    """

    speed: np.ndarray
    acceleration: np.ndarray
    angle: np.ndarray
    side: np.ndarray
    time: np.ndarray
    slow: np.ndarray
    known: np.ndarray
    smoothing: Smoothing


@dataclass(frozen=True)
class Motions:
    """The motion of a body in all experiments, one each; top: the speed that a hundredth of the samples exceeds.

    lag  samples over which an angle's errors are differenced to be those of a speed; 0 of a speed
    """

    each: tuple[Motion, ...]
    top: float
    lag: int

    def all(self, name: str) -> np.ndarray:
        """One signal of all experiments together."""
        return np.concatenate([getattr(m, name) for m in self.each])


def motions_of(experiments: Sequence[Experiment], role: str) -> Motions:
    """The motion of the body with a sensor.

    raises  NotEnoughData: 50 values of the sensor in a row are missing
    """
    smoothings = smoothings_of(experiments, role)
    pairs = list(zip(experiments, smoothings, strict=True))
    top = float(np.nanquantile(np.concatenate([np.abs(motion_of(e, role, s, 0.0).speed) for e, s in pairs]), 0.99))
    each = tuple(motion_of(e, role, s, top) for e, s in pairs)
    return Motions(each, top, min(s.window for s in smoothings) if role.endswith("angle") else 0)


def smoothings_of(experiments: Sequence[Experiment], role: str) -> list[Smoothing]:
    """Of each experiment; one for all of a sampling rate: a cut-off and a noise are per sample.

    raises  NotEnoughData: nowhere is a stretch of 50 samples in a row
    """
    found: dict[int, Smoothing] = {}
    for group in group_by_rate(experiments):
        alike = [experiments[i] for i in group]
        # Recordings that are too short by themselves are smoothed like the others.
        found |= dict.fromkeys(group, smoothing_of(alike if _runs(alike, role) else experiments, role))
    return [found[i] for i in range(len(experiments))]


def smoothing_of(experiments: Sequence[Experiment], role: str) -> Smoothing:
    """The highest cut-off at which noise is a small share of the acceleration.

    raises  NotEnoughData: a stretch of 50 samples in a row is not there
    """
    is_angle = role.endswith("angle")
    level, runs = _noise_level(experiments, role, is_angle)
    difference = (2.0 * np.sin(np.pi * FREQUENCY_GRID)) ** 2 * level  # power of the noise, differenced once
    cutoff = MAX_CUTOFF
    while True:
        passed = 1.0 / (1.0
                        + (np.tan(np.pi * FREQUENCY_GRID) / np.tan(np.pi * cutoff)) ** (2 * LOW_PASS_ORDER)) ** 2
        speed = float(np.mean(passed * (difference if is_angle else level)))
        noise = float(np.mean(
            passed * difference * ((2.0 * np.sin(np.pi * FREQUENCY_GRID)) ** 2 if is_angle else 1.0)))
        smooth = [low_pass(run, [(0, len(run))], cutoff, LOW_PASS_ORDER) for run in runs]
        power = np.mean(np.concatenate([np.diff(s, 2 if is_angle else 1) for s in smooth]) ** 2)
        if noise < NOISE_SHARE * power or CUTOFF_FACTOR * cutoff < MIN_CUTOFF:
            return Smoothing(cutoff, np.sqrt(speed) / (experiments[0].step if is_angle else 1.0))
        cutoff *= CUTOFF_FACTOR


def _noise_level(experiments: Sequence[Experiment], role: str, is_angle: bool) -> tuple[float, list[np.ndarray]]:
    """(power of the sensor's white noise per sample, uninterrupted runs of the sensor)."""
    runs = _runs(experiments, role)
    if not runs:
        raise NotEnoughData("50 values of the sensor in a row", "fewer", "Record longer, or without gaps.")
    order = 3 if is_angle else 2  # differences that leave little of the motion
    powers = []
    for run in runs:
        d = np.diff(run, order)
        spectrum = np.abs(np.fft.rfft(d * np.hanning(len(d)))) ** 2 / np.sum(np.hanning(len(d)) ** 2)
        angular = np.pi * np.arange(len(spectrum)) / (len(spectrum) - 1)
        top = angular > NOISE_BAND_START * np.pi
        powers.append(spectrum[top] / (2.0 * np.sin(0.5 * angular[top])) ** (2 * order))
    return float(np.median(np.concatenate(powers)) / np.log(2.0)), runs


def _runs(experiments: Sequence[Experiment], role: str) -> list[np.ndarray]:
    """Uninterrupted runs of at least 50 values of a sensor."""
    return [e.signals[role][first + a:first + b] for e in experiments for first, last in e.segments
            for a, b in true_runs(np.isfinite(e.signals[role][first:last])) if b - a >= 50]


def motion_of(experiment: Experiment, role: str, smoothing: Smoothing, top: float) -> Motion:
    """The motion of the body with that sensor; top: speed of the fastest recording."""
    e, n = experiment, experiment.size
    smooth = low_pass(e.signals[role], e.segments, smoothing.cutoff, LOW_PASS_ORDER)
    found, known = _empty_motion(n), np.zeros(n, bool)
    for first, last in e.segments:
        part, measured = slice(first, last), np.isfinite(smooth[first:last])
        if measured.sum() < 4:
            continue
        place = np.arange(last - first)
        y = np.interp(place, place[measured], smooth[part][measured])
        known[part] = _bridgeable(measured, MAX_BRIDGED_SAMPLES)
        if role.endswith("angle"):
            mean = _last_repeated(np.diff(y) / e.step)
            ends = np.concatenate([mean[:1], 0.5 * (mean[1:] + mean[:-1])])  # speed at the samples
            _fill_from_speed(found, part, ends, e.step)
            found["speed"][part], found["angle"][part] = mean, _last_repeated(0.5 * (y[1:] + y[:-1]))
        else:
            _fill_from_speed(found, part, y, e.step)
    return _completed_motion(found, e, smoothing, top, known)


def motions_through(experiments: Sequence[Experiment], speeds: Sequence[np.ndarray], measured: Motions) -> Motions:
    """The motion of a body that no sensor is on, by its speed at the samples.

    speeds    per stretch (n,)
    measured  of the motor: what the sensor's noise leaves unknown there is unknown here
    """
    top = float(np.quantile(np.abs(np.concatenate(speeds)), 0.99))
    each, left = [], list(speeds)
    for e, motor in zip(experiments, measured.each, strict=True):
        found, known = _empty_motion(e.size), np.zeros(e.size, bool)
        for first, last in e.segments:
            # A stretch too short for a trace has no state.
            if left and len(left[0]) == last - first:
                part = slice(first, last)
                _fill_from_speed(found, part, left.pop(0), e.step)
                known[part] = True
        each.append(_completed_motion(found, e, motor.smoothing, top, known))
    return replace(measured, each=tuple(each), top=top)


def _empty_motion(n: int) -> dict[str, np.ndarray]:
    return {name: np.full(n, np.nan) for name in ("speed", "acceleration", "angle", "side")}


def _fill_from_speed(found: dict[str, np.ndarray], part: slice, ends: np.ndarray, step: float) -> None:
    """Fill a stretch of a motion by the speed at the samples."""
    mean = _last_repeated(0.5 * (ends[1:] + ends[:-1]))
    found["speed"][part] = mean
    found["angle"][part] = np.cumsum(mean) * step - 0.5 * mean * step
    found["acceleration"][part] = _last_repeated(np.diff(ends) / step)
    found["side"][part] = _last_repeated(_mean_sign(ends))


def _completed_motion(found: dict[str, np.ndarray], e: Experiment, smoothing: Smoothing, top: float,
            known: np.ndarray) -> Motion:
    slow = ~(np.abs(found["speed"]) > max(SIGN_SIGNIFICANCE * smoothing.speed_noise, MIN_MOVING_SPEED_SHARE * top))
    return Motion(**found, time=e.time + 0.5 * e.step, slow=slow, known=known, smoothing=smoothing)


def _bridgeable(measured: np.ndarray, most: int) -> np.ndarray:
    """Whether at most so many values are missing in a row there."""
    place = np.flatnonzero(measured)
    gaps = np.diff(place) - 1
    found = np.zeros(len(measured), bool)
    for a, b in zip(place[:-1][gaps <= most], place[1:][gaps <= most], strict=True):
        found[a:b + 1] = True
    return found


def _last_repeated(values: np.ndarray) -> np.ndarray:
    """One more value: the last interval of a stretch repeats the one before."""
    return np.concatenate([values, values[-1:]])


def _mean_sign(speed: np.ndarray) -> np.ndarray:
    """Mean sign of the speed between samples, where it changes in proportion to time."""
    a, b = speed[:-1], speed[1:]
    span = np.abs(a) + np.abs(b)
    turned = (np.abs(b) - np.abs(a)) * np.sign(b) / np.where(span > 0.0, span, 1.0)
    return np.where(a * b < 0.0, turned, np.sign(a + b))
