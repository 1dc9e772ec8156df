"""Plain least squares of torque on acceleration, speed, sign and one, all low-pass filtered alike.

Written for comparison, without a noise model. Every sample interval is an equation of means, which are exact for a
held torque: the change of the speed, the mean speed, and the share of the interval that it is positive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, filtfilt, lfilter
from scipy.stats import t as student

BLOCKS = 16  # of the covariance: contiguous, so that errors may be correlated within (Bester, Conley, Hansen 2011)
# Sensor noise in the acceleration biases the inertia by its share of the power (errors in variables).
NOISE_SHARE = 1e-3
FIRST_CUT_OFF, CUT_OFF_FACTOR = 0.4, 0.7  # in Nyquist frequencies; each cut-off tried over the one before
MIN_CUT_OFF = 2e-3
STANDSTILL_SPEED = 0.005  # of top speed; slower for STANDING_SAMPLES is standstill, where friction is unknown
STANDING_SAMPLES = 2
STANDING_SHARE = 0.05  # of standstill in what the filter mixes into a sample, from which it is left out


@dataclass(frozen=True)
class Fit:
    """Inertia, viscous, coulomb, idle (4,), their covariance (4, 4), and half a 95 % interval over a std."""

    value: np.ndarray
    covariance: np.ndarray
    factor: float


def least_squares(step: float, torque: np.ndarray, measured: np.ndarray, is_angle: bool) -> Fit:
    """The regression.

    step [s]; torque (n,) [N m] held; measured (n,) speed [rad/s] or angle [rad]
    raises  ValueError: the body stands all the time
    """
    torque = np.asarray(torque[:-1], float)
    if is_angle:  # a second difference of the angle is the mean of both torques beside it
        speed = np.diff(measured) / step
        torque = 0.5 * (torque[1:] + torque[:-1])
    else:
        speed = np.asarray(measured, float)
    change = np.diff(speed) / step
    edge = _cut_off(change, is_angle)
    b, a = butter(2, edge)
    # The sign is taken before the low-pass, from a speed that is only smoothed where noise requires it.
    smooth = filtfilt(*butter(2, min(4.0 * edge, 0.8)), speed) if edge < FIRST_CUT_OFF else speed
    slow = np.abs(smooth) < max(STANDSTILL_SPEED * np.quantile(np.abs(smooth), 0.995), 2.0 * np.std(speed - smooth))
    standstill = lfilter(np.ones(STANDING_SAMPLES), 1.0, slow) > STANDING_SAMPLES - 0.5
    columns = [change, 0.5 * (speed[1:] + speed[:-1]), _side(smooth), np.ones(len(change))]
    rows = np.column_stack([filtfilt(b, a, column) for column in columns])
    smooth_torque = filtfilt(b, a, torque)
    used = filtfilt(b, a, standstill[1:].astype(float)) < STANDING_SHARE
    ends = int(1.0 / edge) + 1  # the filter's own transient
    used[:ends] = used[len(used) - ends:] = False
    if used.sum() < 4 * BLOCKS:
        raise ValueError("the body stands nearly all the time")
    return _solve(rows[used], smooth_torque[used])


def _solve(rows: np.ndarray, torque: np.ndarray) -> Fit:
    """Least squares, with a covariance from blocks."""
    scale = np.sqrt(np.mean(rows**2, axis=0))
    scaled = rows / scale
    inverse = np.linalg.inv(scaled.T @ scaled)
    value = inverse @ scaled.T @ torque
    scores = scaled * (torque - scaled @ value)[:, None]
    sums = np.array([part.sum(axis=0) for part in np.array_split(scores, BLOCKS)])
    spread = inverse @ (sums.T @ sums) @ inverse * BLOCKS / (BLOCKS - 1.0)
    return Fit(value / scale, spread / np.outer(scale, scale), float(student.ppf(0.975, BLOCKS - 1)))


def _side(speed: np.ndarray) -> np.ndarray:
    """(n - 1,) mean sign of the speed between samples, for a speed that changes in proportion to time."""
    first, last = speed[:-1], speed[1:]
    span = np.abs(first) + np.abs(last)
    crossing = first * last < 0.0
    return np.where(crossing, (np.abs(last) - np.abs(first)) * np.sign(last) / np.where(span > 0.0, span, 1.0),
                    np.sign(first + last))


def _cut_off(change: np.ndarray, is_angle: bool) -> float:
    """Cut-off, in Nyquist frequencies: the highest that leaves less than NOISE_SHARE of noise in the acceleration.

    change  (n,) accelerations by differences; the sensor's noise is white, and read from the top of their spectrum
    """
    power = np.abs(np.fft.rfft((change - change.mean()) * np.hanning(len(change))))**2
    angular = np.pi * np.arange(len(power)) / (len(power) - 1)
    gain = (2.0 * np.sin(0.5 * angular)) ** (4 if is_angle else 2)  # of the differences
    top = angular > 0.8 * np.pi
    level = np.median(power[top] / gain[top]) / np.log(2.0)
    edge = FIRST_CUT_OFF
    while True:
        b, a = butter(2, edge)
        passed = np.abs(np.polyval(b, np.exp(1j * angular)) / np.polyval(a, np.exp(1j * angular))) ** 4
        if np.sum(level * gain * passed) < NOISE_SHARE * np.sum(power * passed) or edge < MIN_CUT_OFF:
            return edge
        edge *= CUT_OFF_FACTOR
