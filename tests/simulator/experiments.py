"""Torques and references as engineers make them for an experiment; all random ones are seeded.

Every function returns an (n,) array, one value per sample of `step` seconds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def staircase(levels: Sequence[float], dwell: float, ramp: float, step: float) -> np.ndarray:
    """Speed reference that holds each level for `dwell` s, with ramps of `ramp` s between."""
    knots, values, now = [], [], 0.0
    for level in levels:
        knots += [now, now + dwell]
        values += [level, level]
        now += dwell + ramp
    return np.interp(np.arange(round((now - ramp) / step)) * step, knots, values)


def steps(base: float, sizes: Sequence[float], dwell: tuple[float, float], lead: float,
          step: float, seed: int) -> np.ndarray:
    """Torque `base` for `lead` s, then one step after another, each added to those before.

    dwell  shortest and longest time between steps [s]
    """
    rng = np.random.default_rng(seed)
    parts, level = [np.full(round(lead / step), base)], base
    for size in sizes:
        level += size
        parts.append(np.full(round(rng.uniform(*dwell) / step), level))
    return np.concatenate(parts)


def alternating(base: float, amplitude: tuple[float, float], half_period: tuple[float, float],
                pairs: int, lead: float, step: float, seed: int) -> np.ndarray:
    """Torque steps above and below `base`, in pairs of equal area so that the speed stays put.

    The first and the last half period are half as long: the speed swings evenly about its mean.
    """
    rng = np.random.default_rng(seed)
    parts = [np.full(round(lead / step), base)]
    for _ in range(pairs):
        size, half = rng.uniform(*amplitude), round(rng.uniform(*half_period) / step / 2)
        parts += [np.full(half, base + size), np.full(2 * half, base - size), np.full(half, base + size)]
    return np.concatenate([*parts, np.full(round(lead / step), base)])


def multisine(frequencies: Sequence[float], amplitude: float, duration: float, step: float,
              seed: int) -> np.ndarray:
    """Sines of equal amplitude at `frequencies` [Hz] with random phases."""
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(frequencies))
    time = np.arange(round(duration / step)) * step
    return amplitude * np.cos(2.0 * np.pi * np.outer(time, frequencies) + phases).sum(axis=1)


def chirp(first: float, last: float, amplitude: float, duration: float, step: float) -> np.ndarray:
    """Sine whose frequency goes from `first` to `last` [Hz] at a constant rate per octave."""
    time = np.arange(round(duration / step)) * step
    growth = np.log(last / first) / duration
    return amplitude * np.sin(2.0 * np.pi * first * np.expm1(growth * time) / growth)


def trapezoids(largest: float, period: float, ramp: float, duration: float, step: float,
               seed: int, rest_every: int = 8) -> np.ndarray:
    """Levels drawn from +-`largest`, ramped to within `ramp` s of every `period` s.

    rest_every  every so many levels one is zero, the first too
    """
    count = int(np.ceil(duration / period)) + 1
    levels = np.random.default_rng(seed).uniform(-largest, largest, count)
    levels[::rest_every] = 0.0
    starts = np.arange(count) * period
    # Level i is reached `ramp` s after its period begins and held to the next.
    knots = np.column_stack([starts + ramp, starts + period]).ravel()
    return np.interp(np.arange(round(duration / step)) * step, knots, np.repeat(levels, 2))


def moves(distance: float, speed: float, acceleration: float, rest: float, duration: float,
          step: float, seed: int) -> np.ndarray:
    """Position reference of point-to-point moves, out and back, trapezoidal in speed.

    distance, speed, acceleration  largest values; every move draws 30 to 100 % of each
    rest                           standstill between moves [s]
    """
    rng = np.random.default_rng(seed)
    size, rates, way = round(duration / step), [], 1.0
    while len(rates) < size:
        length, top, gain = np.array([distance, speed, acceleration]) * rng.uniform(0.3, 1.0, 3)
        top = min(top, np.sqrt(length * gain))
        time = np.arange(0.0, length / top + top / gain, step)
        end = length / top + top / gain
        rates += list(way * np.clip(np.minimum(time, end - time) * gain, 0.0, top))
        rates += [0.0] * round(rest / step)
        way = -way
    # Out and back may differ in length: the position wanders but stays within a few lengths.
    return np.concatenate([[0.0], np.cumsum(rates[:size - 1]) * step])
