"""The sensitivity of the loop, and the gains that keep it below a limit.

L(iw) = Kp Q(iw), with Q fixed by integral time and drive. For one frequency, |1 + Kp Q| < 1/Ms
holds between the two roots of a quadratic in Kp (Astrom, Panagopoulos, Hagglund 1998): the gains
that a limit forbids are the union of these intervals over the frequencies, without a search.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drivetool.drive import Drive, resonances
from drivetool.tune.speed_loop.loop import (
    SHAFT_TORQUE_SHARE,
    Settings,
    Wiring,
    lag_time,
    mechanics,
    path_response,
    sensor_response,
    shaft_torque_row,
)
from drivetool.tune.speed_loop.working_point import at_working_point

# Frequencies of the grid, without those around resonances. A choice: peaks between two of them, 2.6 % apart, are
# refined; a coarser grid could miss a peak, and the time of a search grows with it.
POINTS_PER_DECADE = 90


@dataclass(frozen=True)
class Plant:
    """Frequency responses from the torque commands to the filtered speed of the first motor.

    w      (n,) rising [rad/s]
    chain  (A, B) of the mechanics, computed once
    """

    drive: Drive
    wiring: Wiring
    w: np.ndarray
    chain: tuple[np.ndarray, np.ndarray]

    @cached_property
    def responses(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) of the command that takes Kp, and of the one that takes K Kp, zero if there is none.

        An inner shaft-torque loop is closed.
        """
        drive, wiring, (a, b) = self.drive, self.wiring, self.chain
        s = 1j * self.w
        states = np.linalg.solve(s[:, None, None] * np.eye(len(a)) - a, np.broadcast_to(
            b[:, :-1].astype(complex), (len(s), len(a), b.shape[1] - 1)))
        path = path_response(drive, wiring, s)
        read = path * sensor_response(drive, wiring, s)
        speeds = states[:, 0, :]
        if wiring.configuration == "siso":
            return read * speeds.sum(axis=1), np.zeros_like(s)
        if wiring.configuration == "miso":
            return read * speeds[:, 0], read * speeds[:, 1]
        shaft = states.transpose(0, 2, 1) @ shaft_torque_row(drive)
        back = SHAFT_TORQUE_SHARE * path
        inner = speeds[:, 1] * back * shaft[:, 0] / (1.0 - back * shaft[:, 1])
        return read * (speeds[:, 0] + inner), np.zeros_like(s)

    def at(self, w: np.ndarray) -> Plant:
        """The same on other frequencies."""
        return Plant(self.drive, self.wiring, w, self.chain)

    def shape(self, integral_time: float, second: float = 1.0) -> np.ndarray:
        """(n,) Q, the loop gain at Kp = 1."""
        first, other = self.responses
        integral = 1.0 / (1j * self.w * integral_time)
        return (1.0 + integral) * first + (second + integral) * other

    def loop_gain(self, settings: Settings) -> np.ndarray:
        """(n,) L."""
        return settings.gain * self.shape(settings.integral_time, settings.second)

    def sensitivity(self, settings: Settings) -> np.ndarray:
        """(n,) |1/(1 + L)|."""
        return 1.0 / np.abs(1.0 + self.loop_gain(settings))


def rate_range(drive: Drive, wiring: Wiring) -> tuple[float, float]:
    """(slowest, fastest) rate [rad/s] that is relevant to a speed loop.

    The fastest follows from all lags in the loop, or the highest resonance; the slowest from the
    lowest resonance, or the lags if there is none.
    """
    lag = lag_time(drive, wiring)
    ringing = [2.0 * np.pi * mode.frequency_hz for mode in resonances(drive)]
    rates = ringing + ([1.0 / lag] if lag > 0.0 else [])
    return min(rates, default=1.0), max(rates, default=1.0)


def plant(drive: Drive, wiring: Wiring) -> Plant:
    """The plant at its working point, on a grid that is fine around resonances and anti-resonances."""
    drive = at_working_point(drive, wiring.speed)
    slow, fast = rate_range(drive, wiring)
    low, high = slow / 3e3, fast * 60.0
    grid = [np.geomspace(low, high, int(POINTS_PER_DECADE * np.log10(high / low)))]
    for mode in resonances(drive):
        width = np.clip(mode.damping_ratio, 1e-5, 0.5)
        # Not the pole itself: without damping there is no response there.
        offsets = width * np.sinh(np.linspace(1e-3, np.arcsinh(0.3 / width), 30))
        centre = 2.0 * np.pi * mode.frequency_hz
        grid += [centre * (1.0 + offsets), centre * (1.0 - offsets)]
    return Plant(drive, wiring, _without_duplicates(np.concatenate(grid)), mechanics(drive, wiring))


def max_sensitivity(plant: Plant, settings: Settings) -> tuple[float, float]:
    """(Ms = max |1/(1 + L)|, the frequency [rad/s] at which it is reached), to about 1e-9."""
    on_grid = plant.sensitivity(settings)
    inner = np.flatnonzero((on_grid[1:-1] >= on_grid[:-2]) & (on_grid[1:-1] >= on_grid[2:])) + 1
    best = max(((on_grid[0], plant.w[0]), (on_grid[-1], plant.w[-1])))
    for k in inner[on_grid[inner] > 0.9 * on_grid.max()]:
        best = max(best, _refine_peak(plant, settings, plant.w[k - 1], plant.w[k + 1]))
    return float(best[0]), float(best[1])


def with_fine_peaks(plant: Plant, settings: Settings) -> Plant:
    """The plant with more frequencies around the peaks of a sensitivity."""
    size = plant.sensitivity(settings)
    top = (size[1:-1] >= size[:-2]) & (size[1:-1] >= size[2:]) & (size[1:-1] > 0.8 * size.max())
    peaks = np.flatnonzero(top) + 1
    more = [np.linspace(plant.w[max(k - 2, 0)], plant.w[min(k + 2, len(size) - 1)], 61) for k in peaks]
    return plant.at(_without_duplicates(np.concatenate([plant.w, *more])))


def _without_duplicates(w: np.ndarray) -> np.ndarray:
    """Rising frequencies without duplicates up to rounding."""
    w = np.sort(w)
    return w[np.r_[True, np.diff(w) > 1e-8 * w[1:]]]


def _refine_peak(plant: Plant, settings: Settings, low: float, high: float) -> tuple[float, float]:
    """(largest value, where) in an interval with one peak."""
    for _ in range(6):
        w = np.linspace(low, high, 13)
        found = plant.at(w).sensitivity(settings)
        k = int(np.clip(np.argmax(found), 1, 11))
        low, high = w[k - 1], w[k + 1]
        best = found.max(), w[int(np.argmax(found))]
        if high - low < 1e-7 * high:
            break
    return best


def forbidden_gains(q: np.ndarray, w: np.ndarray, limit: float) -> np.ndarray:
    """(m, 2) gains between which the sensitivity exceeds the limit, rising and disjoint.

    q       (n,) loop gain at Kp = 1 at w (n,) [rad/s]
    limit   Ms, above 1
    source  Astrom, Panagopoulos, Hagglund 1998, Automatica 34, 585
    """
    square, real = np.abs(q) ** 2, q.real
    inside = real**2 - square * (1.0 - 1.0 / limit**2)
    near = (inside > 0.0) & (real < 0.0)
    hit, crossed = np.flatnonzero(near), _crossings(q, near)
    low, high = crossed * (1.0 - 1.0 / limit), crossed * (1.0 + 1.0 / limit)
    if len(hit):
        root = np.sqrt(inside[hit])
        upper = (-real[hit] + root) / square[hit]
        lower = (1.0 - 1.0 / limit**2) / (square[hit] * upper)
        # Over neighbouring frequencies the edges are continuous: no gain between two of them is allowed.
        runs = np.flatnonzero(np.r_[True, np.diff(hit) > 1])
        low = np.r_[low, np.minimum.reduceat(_extrema_between(lower, hit, w, -1.0), runs)]
        high = np.r_[high, np.maximum.reduceat(_extrema_between(upper, hit, w, 1.0), runs)]
    if not len(low):
        return np.zeros((0, 2))
    order = np.argsort(low, kind="stable")
    reach = np.maximum.accumulate(high[order])
    starts = np.r_[True, low[order][1:] > reach[:-1]]
    return np.column_stack([low[order][starts], reach[np.r_[starts[1:], True]]])


def _crossings(q: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Gains at which the loop gain passes -1 between two frequencies of which not both are near it.

    A high limit forbids so small a region around -1 that the grid may miss it, and with it the border of stability.
    """
    turn, size = np.angle(-q), np.log(np.abs(q))  # zero on the negative real axis
    k = np.flatnonzero((turn[:-1] * turn[1:] < 0.0) & (np.abs(np.diff(turn)) < np.pi) & ~(near[:-1] & near[1:]))
    share = turn[k] / (turn[k] - turn[k + 1])
    return np.exp(-(size[k] * (1.0 - share) + size[k + 1] * share))


def _extrema_between(edge: np.ndarray, hit: np.ndarray, w: np.ndarray, sign: float) -> np.ndarray:
    """Every extremum of an edge over the frequencies, by a parabola through its neighbours."""
    edge = edge.copy()
    if len(hit) < 3:
        return edge
    whole = (hit[1:-1] - hit[:-2] == 1) & (hit[2:] - hit[1:-1] == 1)
    y = sign * np.log(edge)
    top = np.flatnonzero(whole & (y[1:-1] > y[:-2]) & (y[1:-1] >= y[2:])) + 1
    if not len(top):
        return edge
    x = np.log(w[hit])
    a, b = x[top] - x[top - 1], x[top + 1] - x[top]
    p, q = (y[top] - y[top - 1]) / a, (y[top + 1] - y[top]) / b
    curve, slope = (q - p) / (a + b), (p * b + q * a) / (a + b)
    edge[top] = np.exp(sign * (y[top] - slope**2 / (4.0 * np.minimum(curve, -1e-300))))
    return edge
