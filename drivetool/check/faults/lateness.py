"""By how much a logged speed is later than the rate of the angle that is logged beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivetool.logs import Experiment

WINDOWS = (2, 4, 8, 16, 32)  # samples over which speed and rate are averaged; the one that tells most counts
BLOCK = 10  # windows whose errors are summed up before their spread is taken
FEW = 20  # blocks below which nothing is said


@dataclass(frozen=True)
class Lag:
    """Time by which the speed is late, and its standard error, both in s."""

    lag: float
    std: float


def lag_of(e: Experiment) -> Lag | None:
    """The delay of the motor speed behind the rate of the motor angle; None if both are not there.

    speed - rate = - lag * acceleration + (scale - 1) * rate + offset. The acceleration comes from the
    same encoder, whose noise would pull the lag to zero; the motor torque, which makes it, stands
    in as its instrument.

    source  Ljung 1999, sec. 7.6, on instrumental variables; the std is that of block sums of their scores
    """
    if not {"motor_speed", "motor_angle", "motor_torque"} <= set(e.signals):
        return None
    found = [_by_windows(e, length) for length in WINDOWS]
    return min((f for f in found if f is not None), key=lambda f: f.std, default=None)


def _by_windows(e: Experiment, length: int) -> Lag | None:
    rows, span = [], length * e.step
    for a, b in e.segments:
        n = (b - a - 1) // length
        if n < 4:
            continue
        rate = np.diff(e.signals["motor_angle"][a:a + n * length + 1:length]) / span
        speed, torque = (np.diff(_total(e.signals[role][a:b])[:n * length + 1:length]) / length
                         for role in ("motor_speed", "motor_torque"))
        bend = (rate[2:] - rate[:-2]) / (2.0 * span)
        rows.append(np.column_stack((speed[1:-1] - rate[1:-1], bend, rate[1:-1], torque[1:-1])))
    table = np.concatenate(rows) if rows else np.empty((0, 4))
    table = table[np.all(np.isfinite(table), axis=1)]
    if len(table) < FEW * BLOCK:
        return None
    late, bend, rate, torque = (table - table.mean(axis=0)).T
    x, z = np.column_stack((bend, rate)), np.column_stack((torque, rate))
    across, size = z.T @ x, np.outer(np.linalg.norm(z, axis=0), np.linalg.norm(x, axis=0))
    if np.any(size == 0.0) or np.linalg.cond(across / size) > 1e6:
        return None
    answer = np.linalg.solve(across, z.T @ late)
    # Neighbouring windows share an edge of the angle, whose errors cancel in their sum.
    whole = len(late) // BLOCK * BLOCK
    sums = (z * (late - x @ answer)[:, None])[:whole].reshape(-1, BLOCK, 2).sum(axis=1)
    inverse = np.linalg.inv(across)
    covariance = inverse @ (sums.T @ sums) @ inverse.T * len(late) / whole
    return Lag(float(-answer[0]), float(np.sqrt(covariance[0, 0])))


def _total(values: np.ndarray) -> np.ndarray:
    """(n,) trapezoidal sum from the first sample on, per sample."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))))
