"""Delay of a logged speed against the rate of the angle in the same record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivetool.logs import Experiment

# Samples over which speed and rate are averaged; the window of the smallest standard error counts.
DELAY_WINDOWS = (2, 4, 8, 16, 32)
# Windows whose errors are summed before their scatter is taken: neighbours share an edge and are correlated.
WINDOWS_PER_BLOCK = 10
MIN_DELAY_BLOCKS = 20  # a choice: fewer blocks give no standard error to rely on


@dataclass(frozen=True)
class SensorDelay:
    """Delay of the speed and its standard error, both in s."""

    lag: float
    std: float


def speed_delay(e: Experiment) -> SensorDelay | None:
    """The delay of the motor speed behind the rate of the motor angle; None if both are not there.

    speed - rate = - lag * acceleration + (scale - 1) * rate + offset. The acceleration comes from the
    same encoder, whose noise would bias the lag to zero; the motor torque, which causes it, is the
    instrument.

    source  Ljung 1999, sec. 7.6, on instrumental variables; the std is that of block sums of their scores
    """
    if not {"motor_speed", "motor_angle", "motor_torque"} <= set(e.signals):
        return None
    found = [_delay_by_windows(e, length) for length in DELAY_WINDOWS]
    return min((f for f in found if f is not None), key=lambda f: f.std, default=None)


def _delay_by_windows(e: Experiment, length: int) -> SensorDelay | None:
    rows, span = [], length * e.step
    for a, b in e.segments:
        n = (b - a - 1) // length
        if n < 4:
            continue
        rate = np.diff(e.signals["motor_angle"][a:a + n * length + 1:length]) / span
        speed, torque = (np.diff(_trapezoidal_sum(e.signals[role][a:b])[:n * length + 1:length]) / length
                         for role in ("motor_speed", "motor_torque"))
        acceleration = (rate[2:] - rate[:-2]) / (2.0 * span)
        rows.append(np.column_stack((speed[1:-1] - rate[1:-1], acceleration, rate[1:-1], torque[1:-1])))
    table = np.concatenate(rows) if rows else np.empty((0, 4))
    table = table[np.all(np.isfinite(table), axis=1)]
    if len(table) < MIN_DELAY_BLOCKS * WINDOWS_PER_BLOCK:
        return None
    difference, acceleration, rate, torque = (table - table.mean(axis=0)).T
    x, z = np.column_stack((acceleration, rate)), np.column_stack((torque, rate))
    instrument_product, size = z.T @ x, np.outer(np.linalg.norm(z, axis=0), np.linalg.norm(x, axis=0))
    if np.any(size == 0.0) or np.linalg.cond(instrument_product / size) > 1e6:
        return None
    answer = np.linalg.solve(instrument_product, z.T @ difference)
    # Neighbouring windows share an edge of the angle, whose errors cancel in their sum.
    whole = len(difference) // WINDOWS_PER_BLOCK * WINDOWS_PER_BLOCK
    sums = (z * (difference - x @ answer)[:, None])[:whole].reshape(-1, WINDOWS_PER_BLOCK, 2).sum(axis=1)
    inverse = np.linalg.inv(instrument_product)
    covariance = inverse @ (sums.T @ sums) @ inverse.T * len(difference) / whole
    return SensorDelay(float(-answer[0]), float(np.sqrt(covariance[0, 0])))


def _trapezoidal_sum(values: np.ndarray) -> np.ndarray:
    """(n,) trapezoidal sum from the first sample on, per sample."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))))
