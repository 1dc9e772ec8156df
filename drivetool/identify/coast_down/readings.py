"""The readings of a sensor sample by sample: counts give an angle at the samples where they change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drivetool.errors import BadRecording
from drivetool.identify.setup import white_std
from drivetool.logs import Experiment
from drivetool.logs.samples import quantisation_step

UNIFORM_STD = 1.0 / np.sqrt(12.0)  # standard deviation of a uniform distribution over an interval of one
# Changes before and after, over which the speed that places a change is taken: twenty counts give it to some per
# cent.
COUNTS_AROUND = 10
# Times the root of the change of the counts per sample: within it the place runs through four counts, and beyond it
# fast enough that errors add up as independent ones; at half of it their sum has up to twice that variance.
LOCKED_RANGE = 2.0
# Samples that see the same part of a count, from which they are left out: twenty equal errors have the variance of
# 400 independent ones, and a coast-down has some thousand.
MIN_LOCKED_SAMPLES = 20.0
# White noise below this share of a step is quantisation: rounding alone gives 0.29 of it at a high speed, and less
# at a low one.
MAX_QUANTISED_NOISE = 0.5


@dataclass(frozen=True)
class Reading:
    """A stretch of one sensor.

    role    motor_angle or motor_speed
    values  (n,) NaN where a sample has no new information
    std     (n,) of each value
    step    sampling interval [s]
    count   quantisation step of the sensor, 0 where it has none
    error   standard deviation of the sensor's error beyond quantisation
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
        """(m,) index of the samples with information."""
        return np.flatnonzero(np.isfinite(self.values))


def reading_of(experiment: Experiment, first: int, last: int) -> Reading:
    """A stretch of a recording as a reading; the angle rather than the speed, which may be computed from it.

    raises  BadRecording: neither angle nor speed; BadRecording: it does not move
    """
    role = "motor_angle" if "motor_angle" in experiment.signals else "motor_speed"
    y = experiment.signal(role, "the coast-down")[first:last]
    noise, count = white_std([y]), quantisation_step(y) if role == "motor_angle" else 0.0
    if count > 0.0 and noise < MAX_QUANTISED_NOISE * count:
        return with_placed_counts(Reading(role, y, y, experiment.step, count, 0.0, y), None)
    if noise == 0.0:
        noise = 1e-9 * max(float(np.nanmax(np.abs(y))), 1e-300)
    return Reading(role, y, np.full(len(y), noise), experiment.step)


def with_placed_counts(reading: Reading, speed: np.ndarray | None) -> Reading:
    """Counts as angles where they change: between two samples the angle passed the edge of a count.

    At the sample after an edge the angle is beyond it by at most the motion of one sample, uniformly distributed;
    where the motor turns by more than a count between samples, it is anywhere in the count.

    speed  (n,) of the motor; None: from the counts themselves
    """
    y, q = reading.counted, reading.count
    good = np.flatnonzero(np.isfinite(y))
    change = good[1:][np.diff(y[good]) != 0.0]
    if len(change) < 2 * COUNTS_AROUND:
        raise BadRecording(f"at least {2 * COUNTS_AROUND} counts in a coast-down", f"{len(change)}",
                           "Record with more counts per turn, or from a higher speed.")
    if speed is None:
        i = np.arange(len(change))
        low, high = np.maximum(i - COUNTS_AROUND, 0), np.minimum(i + COUNTS_AROUND, len(change) - 1)
        rate = (y[change[high]] - y[change[low]]) / ((change[high] - change[low]) * reading.step)
    else:
        rate = speed[change]
    beyond = np.clip(rate * reading.step / q, -1.0, 1.0)  # in counts
    values, std = np.full(len(y), np.nan), np.full(len(y), np.nan)
    # Counts are the edges below: backwards an edge passed is the upper one.
    values[change] = y[change] + q * np.where(beyond < 0.0, 1.0 + 0.5 * beyond, 0.5 * beyond)
    std[change] = np.hypot(q * UNIFORM_STD * np.abs(beyond), reading.error)
    keep = np.full(len(y), False)
    keep[change] = np.abs(beyond) > 0.0
    if speed is not None:
        keep &= ~_phase_locked(np.abs(speed) * reading.step / q)
    return replace(reading, values=np.where(keep, values, np.nan), std=np.where(keep, std, np.nan))


def _phase_locked(rate: np.ndarray) -> np.ndarray:
    """(n,) where counts per sample (n,) stay near a whole or a half number: samples see the same part of a count.

    The place in the count changes with the square of time: it stays for one over the root of the change of the
    rate. The errors of these samples are equal, and the weights would take them for independent ones.
    """
    halves, root = np.round(2.0 * rate), np.sqrt(np.abs(np.gradient(rate)))
    return (halves > 0.0) & (root < 1.0 / MIN_LOCKED_SAMPLES) & (np.abs(rate - 0.5 * halves) < LOCKED_RANGE * root)


def with_encoder_error(reading: Reading, residuals: np.ndarray) -> Reading:
    """Counts with the error of their edges beyond quantisation, estimated from residuals (m,)."""
    quantisation = reading.std[reading.known] ** 2 - reading.error**2
    # Weighted by the precise edges: they determine the error of the encoder best.
    weight = 1.0 / (quantisation + reading.error**2) ** 2
    error = float(np.sum(weight * (residuals**2 - quantisation)) / np.sum(weight))
    return replace(reading, error=float(np.sqrt(max(error, 0.0))))
