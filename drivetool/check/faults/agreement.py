"""By how much one channel of a motion is another one: over windows, or over all of the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

BLOCKS = 20  # independent pieces that what is left over of a way counts for: it goes on as a shaft rings
SHORT = 0.05  # s over which a way is averaged
WINDOWS = (0.02, 0.1, 0.5)  # s over which both are averaged; the one that tells most counts
FEW = 20  # windows below which nothing is said
PLAIN = 3.0  # times what is left over that the one must show in the other


def agreement(signals: Mapping[str, np.ndarray], one: str, other: str, step: float,
              segments: Sequence[tuple[int, int]]) -> tuple[float, float]:
    """(slope, its standard error) of the mean rate of a channel over that of another; nan where nothing is told.

    one, other  roles of one body, angles or speeds; of an angle the rate is what it went through
    """
    found = [_over(signals, one, other, step, segments, max(2, round(window / step))) for window in WINDOWS]
    return min(found, key=lambda f: f[1])


def _over(signals: Mapping[str, np.ndarray], one: str, other: str, step: float,
          segments: Sequence[tuple[int, int]], length: int) -> tuple[float, float]:
    pairs = [np.array([_rates(signals[role][a:b], role, step, length) for role in (one, other)])
             for a, b in segments if b - a > 5 * length]
    x, y = np.concatenate(pairs, axis=1) if pairs else np.empty((2, 0))
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < FEW:
        return np.nan, np.inf
    return _slope(x[good] - x[good].mean(), y[good] - y[good].mean(), int(good.sum()))


def _slope(x: np.ndarray, y: np.ndarray, independent: int) -> tuple[float, float]:
    """(slope of y over x, its standard error); independent: values that what is left over counts for."""
    size = float(x @ x)
    if not size > 0.0 or not np.all(np.isfinite(y)):
        return np.nan, np.inf
    factor = float(x @ y / size)
    left = float(np.linalg.norm(y - factor * x))
    if abs(factor) * np.sqrt(size) <= PLAIN * left:
        return np.nan, np.inf
    return factor, left / np.sqrt(size * independent)


def _rates(y: np.ndarray, role: str, step: float, length: int) -> np.ndarray:
    """(n,) mean rate of a channel over each window; nan where a value is missing."""
    n = (len(y) - 1) // length
    if role.endswith("angle"):
        return np.diff(y[:n * length + 1:length]) / (length * step)
    # Half weight at both ends: the mean of the speed over what the angle goes through.
    return (0.5 * (y[:-1] + y[1:]))[:n * length].reshape(n, length).mean(axis=1)


def pushed(signals: Mapping[str, np.ndarray], role: str, step: float, segments: Sequence[tuple[int, int]]) -> float:
    """Standard errors by which a motion gains speed under the motor torque; below zero it is upside down.

    Over the windows that tell most; the speed itself takes up what friction does. nan where nothing is told.
    """
    found = [np.nan]
    for length in {max(2, round(window / step)) for window in WINDOWS}:
        rows = []
        for a, b in segments:
            rate = _rates(signals[role][a:b], role, step, length)
            torque = signals["motor_torque"][a:a + len(rate) * length].reshape(-1, length).mean(axis=1)
            pair = np.column_stack([torque, rate])
            rows.append(np.column_stack([pair[:-1] + pair[1:], np.ones(max(len(rate) - 1, 0)), np.diff(rate)]))
        rows = np.concatenate(rows)
        rows = rows[np.isfinite(rows).all(axis=1)]
        if len(rows) >= FEW:
            found.append(_t_value(rows[:, :-1], rows[:, -1]))
    return float(max(found, key=lambda t: np.nan_to_num(abs(t))))


def _t_value(known: np.ndarray, y: np.ndarray) -> float:
    """Coefficient of the first column in y over its standard error."""
    size = np.maximum(np.linalg.norm(known, axis=0), 1e-300)
    inverse = np.linalg.pinv((known / size).T @ (known / size), rcond=1e-12, hermitian=True)
    slope = inverse @ ((known / size).T @ y)
    left = float(np.sum((y - (known / size) @ slope) ** 2)) / max(len(y) - known.shape[1], 1)
    return float(slope[0] / np.sqrt(max(left * inverse[0, 0], 1e-300)))


def travelled(signals: Mapping[str, np.ndarray], one: str, other: str, step: float,
              segments: Sequence[tuple[int, int]]) -> tuple[float, float]:
    """(slope, its standard error) of the way of a channel over that of another; nan where nothing is told.

    one, other  roles of two bodies, angles or speeds. What is between them twists as it drags and accelerates what
                is behind, which speed and acceleration take up; an offset of a speed grows with time
    """
    length, rows = max(2, round(SHORT / step)), []
    for a, b in _unbroken(signals, (one, other), segments, length):
        n = (b - a) // length
        if n < FEW:
            continue
        x, y = (_way(signals[role][a:b], role, step)[:n * length].reshape(n, length).mean(axis=1)
                for role in (one, other))
        known = np.column_stack([np.ones(n - 2), np.arange(n - 2), x[2:] - x[:-2], x[2:] - 2.0 * x[1:-1] + x[:-2]])
        known = known / np.maximum(np.linalg.norm(known, axis=0), 1e-300)
        pair = np.column_stack([x, y])[1:-1]
        rows.append(pair - known @ np.linalg.lstsq(known, pair, rcond=None)[0])
    return _slope(*(np.concatenate(rows).T if rows else np.empty((2, 0))), BLOCKS)


def _unbroken(signals: Mapping[str, np.ndarray], roles: Sequence[str], segments: Sequence[tuple[int, int]],
              longest: int) -> list[tuple[int, int]]:
    """The segments cut where a channel has no value for longer than so many samples: the way there is unknown."""
    found = []
    for a, b in segments:
        known = np.flatnonzero(np.all([np.isfinite(signals[r][a:b]) for r in roles], axis=0))
        cuts = np.flatnonzero(np.diff(known) > longest)
        found += [(a + int(piece[0]), a + int(piece[-1]) + 1) for piece in np.split(known, cuts + 1) if len(piece)]
    return found


def _way(y: np.ndarray, role: str, step: float) -> np.ndarray:
    """(n,) where a body is, from its angle or its speed; single missing values are bridged."""
    good = np.isfinite(y)
    if not good.any():
        return np.full(len(y), np.nan)
    y = np.interp(np.arange(len(y)), np.flatnonzero(good), y[good])
    return y if role.endswith("angle") else step * np.concatenate(([0.0], np.cumsum(0.5 * (y[:-1] + y[1:]))))
