"""Ratio of two channels of a motion: from rates over windows, or from the whole travel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

# Independent values that the residual of a travel counts as (a choice: it is correlated as the shaft
# oscillates).
INDEPENDENT_BLOCKS = 20
# s over which a position is averaged. A choice: short against the motion, long against the noise.
TRAVEL_WINDOW = 0.05
# s over which both are averaged; the window of the smallest standard error counts.
RATE_WINDOWS = (0.02, 0.1, 0.5)
MIN_WINDOWS = 20  # a choice: fewer give no standard error to rely on
# Times the residual that one channel must explain of the other. A choice: below, the slope is biased by noise.
MIN_SIGNAL_TO_RESIDUAL = 3.0


def channel_ratio_by_rates(signals: Mapping[str, np.ndarray], one: str, other: str, step: float,
                           segments: Sequence[tuple[int, int]]) -> tuple[float, float]:
    """(slope, its standard error) of the mean rate of a channel over that of another; nan: not identifiable.

    one, other  roles of one body, angles or speeds; of an angle the rate is its difference over the window
    """
    found = [_ratio_over_windows(signals, one, other, step, segments, max(2, round(window / step)))
             for window in RATE_WINDOWS]
    return min(found, key=lambda f: f[1])


def _ratio_over_windows(signals: Mapping[str, np.ndarray], one: str, other: str, step: float,
                        segments: Sequence[tuple[int, int]], length: int) -> tuple[float, float]:
    pairs = [np.array([_rates(signals[role][a:b], role, step, length) for role in (one, other)])
             for a, b in segments if b - a > 5 * length]
    x, y = np.concatenate(pairs, axis=1) if pairs else np.empty((2, 0))
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < MIN_WINDOWS:
        return np.nan, np.inf
    return _regression_slope(x[good] - x[good].mean(), y[good] - y[good].mean(), int(good.sum()))


def _regression_slope(x: np.ndarray, y: np.ndarray, independent: int) -> tuple[float, float]:
    """(slope of y over x, its standard error); independent: number of values that the residual counts as."""
    size = float(x @ x)
    if not size > 0.0 or not np.all(np.isfinite(y)):
        return np.nan, np.inf
    factor = float(x @ y / size)
    left = float(np.linalg.norm(y - factor * x))
    if abs(factor) * np.sqrt(size) <= MIN_SIGNAL_TO_RESIDUAL * left:
        return np.nan, np.inf
    return factor, left / np.sqrt(size * independent)


def _rates(y: np.ndarray, role: str, step: float, length: int) -> np.ndarray:
    """(n,) mean rate of a channel over each window; nan where a value is missing."""
    n = (len(y) - 1) // length
    if role.endswith("angle"):
        return np.diff(y[:n * length + 1:length]) / (length * step)
    # Half weight at both ends: the mean speed over the interval of the angle difference.
    return (0.5 * (y[:-1] + y[1:]))[:n * length].reshape(n, length).mean(axis=1)


def torque_sign_t_value(signals: Mapping[str, np.ndarray], role: str, step: float,
                        segments: Sequence[tuple[int, int]]) -> float:
    """t value of the acceleration by the motor torque; below zero the channel has the wrong sign.

    For the windows of the largest value; the speed as regressor takes up friction. nan: not identifiable.
    """
    found = [np.nan]
    for length in {max(2, round(window / step)) for window in RATE_WINDOWS}:
        rows = []
        for a, b in segments:
            rate = _rates(signals[role][a:b], role, step, length)
            torque = signals["motor_torque"][a:a + len(rate) * length].reshape(-1, length).mean(axis=1)
            pair = np.column_stack([torque, rate])
            rows.append(np.column_stack([pair[:-1] + pair[1:], np.ones(max(len(rate) - 1, 0)), np.diff(rate)]))
        rows = np.concatenate(rows)
        rows = rows[np.isfinite(rows).all(axis=1)]
        if len(rows) >= MIN_WINDOWS:
            found.append(_t_value(rows[:, :-1], rows[:, -1]))
    return float(max(found, key=lambda t: np.nan_to_num(abs(t))))


def _t_value(known: np.ndarray, y: np.ndarray) -> float:
    """Coefficient of the first column in y over its standard error."""
    size = np.maximum(np.linalg.norm(known, axis=0), 1e-300)
    inverse = np.linalg.pinv((known / size).T @ (known / size), rcond=1e-12, hermitian=True)
    slope = inverse @ ((known / size).T @ y)
    left = float(np.sum((y - (known / size) @ slope) ** 2)) / max(len(y) - known.shape[1], 1)
    return float(slope[0] / np.sqrt(max(left * inverse[0, 0], 1e-300)))


def channel_ratio_by_travel(signals: Mapping[str, np.ndarray], one: str, other: str, step: float,
                            segments: Sequence[tuple[int, int]]) -> tuple[float, float]:
    """(slope, its standard error) of the travel of a channel over that of another; nan: not identifiable.

    one, other  roles of two bodies, angles or speeds. The twist between them by friction and inertia is taken up by
                regressors of speed and acceleration; an offset of a speed grows with time
    """
    length, rows = max(2, round(TRAVEL_WINDOW / step)), []
    for a, b in _gapless_segments(signals, (one, other), segments, length):
        n = (b - a) // length
        if n < MIN_WINDOWS:
            continue
        x, y = (_position(signals[role][a:b], role, step)[:n * length].reshape(n, length).mean(axis=1)
                for role in (one, other))
        known = np.column_stack([np.ones(n - 2), np.arange(n - 2), x[2:] - x[:-2], x[2:] - 2.0 * x[1:-1] + x[:-2]])
        known = known / np.maximum(np.linalg.norm(known, axis=0), 1e-300)
        pair = np.column_stack([x, y])[1:-1]
        rows.append(pair - known @ np.linalg.lstsq(known, pair, rcond=None)[0])
    return _regression_slope(*(np.concatenate(rows).T if rows else np.empty((2, 0))), INDEPENDENT_BLOCKS)


def _gapless_segments(signals: Mapping[str, np.ndarray], roles: Sequence[str], segments: Sequence[tuple[int, int]],
                      longest: int) -> list[tuple[int, int]]:
    """The segments cut where a channel has no value for longer than `longest` samples: unknown travel."""
    found = []
    for a, b in segments:
        known = np.flatnonzero(np.all([np.isfinite(signals[r][a:b]) for r in roles], axis=0))
        cuts = np.flatnonzero(np.diff(known) > longest)
        found += [(a + int(piece[0]), a + int(piece[-1]) + 1) for piece in np.split(known, cuts + 1) if len(piece)]
    return found


def _position(y: np.ndarray, role: str, step: float) -> np.ndarray:
    """(n,) position of a body, from its angle or its speed; single missing values are bridged."""
    good = np.isfinite(y)
    if not good.any():
        return np.full(len(y), np.nan)
    y = np.interp(np.arange(len(y)), np.flatnonzero(good), y[good])
    return y if role.endswith("angle") else step * np.concatenate(([0.0], np.cumsum(0.5 * (y[:-1] + y[1:]))))
