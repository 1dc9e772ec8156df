"""What a sensor tells of a motion sample by sample: counts tell an angle at the samples where they change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drivetool.errors import BadRecording
from drivetool.identify.setup import white_std
from drivetool.logs import Experiment
from drivetool.logs.samples import quantum

UNIFORM = 1.0 / np.sqrt(12.0)  # standard deviation of what is anywhere in an interval of one
# Changes before and after, over which the speed is taken to place a change: twenty counts tell it to some per cent.
AROUND = 10
# Times the root of the change of the counts per sample: within it the place runs through four counts, and beyond it
# fast enough that errors add up as if by chance; at half of it their sum has up to twice that variance.
LOCKED = 2.0
# Samples that see the same part of a count, from which they are left out: twenty errors that are one have the
# variance of 400, and a run-down has some thousand.
LASTING = 20.0
# White noise below this share of a step is quantisation: rounding alone gives 0.29 of it where a speed is fast, and
# less where it is slow.
COUNTED = 0.5


@dataclass(frozen=True)
class Reading:
    """A stretch of one sensor.

    role    motor_angle or motor_speed
    values  (n,) NaN where a sample tells nothing new
    std     (n,) of each value
    step    sampling interval [s]
    count   the step of the sensor, 0 where it does not count
    error   standard deviation of what the sensor errs by beyond its steps
    counted (n,) as logged, for counts
    """

    role: Literal["motor_angle", "motor_speed"]
    values: np.ndarray
    std: np.ndarray
    step: float
    count: float = 0.0
    error: float = 0.0
    counted: np.ndarray | None = None

    @property
    def known(self) -> np.ndarray:
        """(m,) index of the samples that tell something."""
        return np.flatnonzero(np.isfinite(self.values))


def reading_of(experiment: Experiment, first: int, last: int) -> Reading:
    """A stretch of a recording as a reading; the angle before the speed, which may be made of it.

    raises  BadRecording: neither angle nor speed; BadRecording: it does not move
    """
    role = "motor_angle" if "motor_angle" in experiment.signals else "motor_speed"
    y = experiment.signal(role, "the coast-down")[first:last]
    noise, count = white_std([y]), quantum(y) if role == "motor_angle" else 0.0
    if count > 0.0 and noise < COUNTED * count:
        return placed(Reading(role, y, y, experiment.step, count, 0.0, y), None)
    if noise == 0.0:
        noise = 1e-9 * max(float(np.nanmax(np.abs(y))), 1e-300)
    return Reading(role, y, np.full(len(y), noise), experiment.step)


def placed(reading: Reading, speed: np.ndarray | None) -> Reading:
    """Counts as angles where they change: between two samples the angle passed the edge of a count.

    At the sample after an edge the angle is beyond it by what the motor turns in one sample at most, evenly; where
    it turns by more than a count between samples, anywhere in the count.

    speed  (n,) of the motor; None: from the counts themselves
    """
    y, q = reading.counted, reading.count
    good = np.flatnonzero(np.isfinite(y))
    change = good[1:][np.diff(y[good]) != 0.0]
    if len(change) < 2 * AROUND:
        raise BadRecording(f"at least {2 * AROUND} counts in a coast-down", f"{len(change)}",
                           "Record with more counts per turn, or from a higher speed.")
    if speed is None:
        i = np.arange(len(change))
        low, high = np.maximum(i - AROUND, 0), np.minimum(i + AROUND, len(change) - 1)
        moved = (y[change[high]] - y[change[low]]) / ((change[high] - change[low]) * reading.step)
    else:
        moved = speed[change]
    beyond = np.clip(moved * reading.step / q, -1.0, 1.0)  # in counts
    values, std = np.full(len(y), np.nan), np.full(len(y), np.nan)
    # Counts are the edges below: backwards an edge passed is the upper one.
    values[change] = y[change] + q * np.where(beyond < 0.0, 1.0 + 0.5 * beyond, 0.5 * beyond)
    std[change] = np.hypot(q * UNIFORM * np.abs(beyond), reading.error)
    keep = np.full(len(y), False)
    keep[change] = np.abs(beyond) > 0.0
    if speed is not None:
        keep &= ~_locked(np.abs(speed) * reading.step / q)
    return replace(reading, values=np.where(keep, values, np.nan), std=np.where(keep, std, np.nan))


def _locked(rate: np.ndarray) -> np.ndarray:
    """(n,) where counts per sample (n,) stay a whole or a half number: samples see the same part of a count.

    From there the place in the count runs through a square of the time: it stays for one over the root of the
    change of the rate. Errors of these samples are one error, which the weights would take for many.
    """
    halves, root = np.round(2.0 * rate), np.sqrt(np.abs(np.gradient(rate)))
    return (halves > 0.0) & (root < 1.0 / LASTING) & (np.abs(rate - 0.5 * halves) < LOCKED * root)


def with_error(reading: Reading, left: np.ndarray) -> Reading:
    """Counts with the error of their edges that residuals (m,) show beyond their steps."""
    inside = reading.std[reading.known] ** 2 - reading.error**2
    # Weighted so that the sharp edges, which an error of the encoder blurs, say how large it is.
    weight = 1.0 / (inside + reading.error**2) ** 2
    error = float(np.sum(weight * (left**2 - inside)) / np.sum(weight))
    return replace(reading, error=float(np.sqrt(max(error, 0.0))))
