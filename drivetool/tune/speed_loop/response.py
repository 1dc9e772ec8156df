"""The step response of a closed loop as a sum of modes, with exact figures.

A decaying signal is sum r exp(l t). Its extrema separate monotone pieces, each piece has at most
one zero, and integrals between zeros are closed: no figure depends on a time grid. A step length
only sets where extrema are searched; it follows from the modes that have not decayed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivetool.drive.compile import cached_in_folder

MAX_EXTREMA = 4096  # stored. A choice: a mode of damping ratio 1e-3 has fewer before it has decayed to 1e-5.
# Steps of one length, and changes of that length. A choice: longer blocks step too finely once fast modes have
# decayed; the number of blocks only ends the search in modes that hardly decay.
BLOCK_STEPS, MAX_BLOCKS = 12, 40000
CANCELLATION_ROUNDING = 1e-10  # of a sum of cancelling terms, relative to them: 1e6 times the rounding of a double
DECAYED_SHARE = 1e-10  # share of the first integral below which the remaining signal is dropped; no figure shows it


def compiled(function: Callable) -> Callable:
    """Compile, with the code in the kernel's folder: Numba's own folders may be read-only or unsafe."""
    return cached_in_folder(function, error_model="numpy")


@compiled
def modal_sum(rates, weights, t):
    """sum of weights exp(rates t)."""
    v = 0.0
    for i in range(rates.size):
        v += (weights[i] * np.exp(rates[i] * t)).real
    return v


@compiled
def bisect(rates, weights, a, b, fa, level):
    """The t in [a, b] at which the sum is `level`; fa is its value less the level at a.

    Illinois steps, which halve the side that does not move.
    """
    fb = modal_sum(rates, weights, b) - level
    side = 0
    for _ in range(80):
        if b - a <= 1e-11 * b or fb == fa:  # integrals are flat at their zeros: an error of 1e-22
            break
        t = b - fb * (b - a) / (fb - fa)
        if not (a < t < b):
            t = 0.5 * (a + b)
        f = modal_sum(rates, weights, t) - level
        if f == 0.0:
            return t
        if (f > 0.0) == (fb > 0.0):
            b, fb = t, f
            if side == 1:
                fa *= 0.5
            side = 1
        else:
            a, fa = t, f
            if side == -1:
                fb *= 0.5
            side = -1
    return b - fb * (b - a) / (fb - fa) if fb != fa else b


@compiled
def one_per_pair(rates, weights):
    """The same sum with one mode per conjugate pair, without negligible modes."""
    r, w = np.empty_like(rates), np.empty_like(weights)
    n, largest = 0, np.max(np.abs(weights))
    for i in range(rates.size):
        if abs(weights[i]) <= 1e-15 * largest or rates[i].imag < 0.0:
            continue
        r[n], w[n] = rates[i], weights[i] * (2.0 if rates[i].imag > 0.0 else 1.0)
        n += 1
    return r[:n].copy(), w[:n].copy()


@compiled
def fastest_rate(rates, weights, t):
    """The fastest rate among the modes that are not negligible at t."""
    total = 0.0
    for i in range(rates.size):
        total += abs(weights[i]) * np.exp(rates[i].real * t)
    fast = 0.0
    for i in range(rates.size):
        if abs(weights[i]) * np.exp(rates[i].real * t) > 1e-7 * total:
            fast = max(fast, abs(rates[i]))
    return fast


@compiled
def extrema(rates, weights, times, values):
    """Extrema of sum weights exp(rates t), t > 0, in order; returns their number.

    times, values  (MAX_EXTREMA,) filled from the front
    """
    slope = weights * rates
    size = 0.0
    for i in range(rates.size):
        size += abs(weights[i] / rates[i])
    t, n = 0.0, 0
    g = modal_sum(rates, slope, 1e-12 / max(np.max(np.abs(rates)), 1e-300))
    slope_rounding = CANCELLATION_ROUNDING * np.sum(np.abs(slope))
    now, ratio = np.empty_like(rates), np.empty_like(rates)
    for _ in range(MAX_BLOCKS):
        total = 0.0
        for i in range(rates.size):
            total += abs(weights[i] / rates[i]) * np.exp(rates[i].real * t)
        if total < DECAYED_SHARE * size or n >= times.size - BLOCK_STEPS:
            break
        h = 0.3 / fastest_rate(rates, slope, t)
        for i in range(rates.size):  # a product per step instead of an exponential
            now[i], ratio[i] = slope[i] * np.exp(rates[i] * t), np.exp(rates[i] * h)
        for k in range(BLOCK_STEPS):
            next_slope = 0.0
            for i in range(rates.size):
                now[i] *= ratio[i]
                next_slope += now[i].real
            # A signal that starts flat has no direction until its slope exceeds rounding.
            if (next_slope > 0.0) != (g > 0.0) and not (n == 0 and abs(g) < slope_rounding):
                s = bisect(rates, slope, t + k * h, t + (k + 1) * h, g, 0.0)
                times[n], values[n] = s, modal_sum(rates, weights, s)
                n += 1
            g = next_slope
        t += BLOCK_STEPS * h
    return n


@compiled
def zeros_between(rates, weights, times, values, n, at_start, zeros):
    """Zeros of the sum: at most one on each monotone piece; returns their number."""
    m, a, fa = 0, 0.0, at_start
    for k in range(n):
        if fa * values[k] < 0.0:
            zeros[m] = bisect(rates, weights, a, times[k], fa, 0.0)
            m += 1
        a, fa = times[k], values[k]
    return m


@compiled
def absolute_integral(rates, weights):
    """Integral of |sum| from 0 to infinity, and the largest |integral up to t|.

    Exact between the zeros: each lobe is a difference of the closed integral.
    """
    rates, weights = one_per_pair(rates, weights)
    times, values, zeros = np.empty(MAX_EXTREMA), np.empty(MAX_EXTREMA), np.empty(MAX_EXTREMA)
    n = extrema(rates, weights, times, values)
    m = zeros_between(rates, weights, times, values, n, modal_sum(rates, weights, 0.0), zeros)
    integral = weights / rates
    start = modal_sum(rates, integral, 0.0)
    before, total, largest = start, 0.0, 0.0
    for k in range(m):
        now = modal_sum(rates, integral, zeros[k])
        total += abs(now - before)
        largest = max(largest, abs(now - start))
        before = now
    return total + abs(before), max(largest, abs(start))


@compiled
def absolute_integrals(rates, weights):
    """(m, 2) of m rows of modes, see above; infinite where a mode does not decay."""
    found = np.full((len(rates), 2), np.inf)
    for i in range(len(rates)):
        if np.max(rates[i].real) < 0.0 and np.all(np.isfinite(np.abs(weights[i]))):
            found[i, 0], found[i, 1] = absolute_integral(rates[i], weights[i])
    return found


@dataclass(frozen=True)
class Modes:
    """A signal after a unit step of load torque, minus its final value: sum weights exp(rates t).

    rates, weights  (n,) complex, in conjugate pairs
    rest            final value
    """

    rates: np.ndarray
    weights: np.ndarray
    rest: float = 0.0

    @property
    def stable(self) -> bool:
        """Whether it decays."""
        return bool(np.max(self.rates.real) < 0.0)

    def at(self, time: np.ndarray) -> np.ndarray:
        """(n,) the signal at times (n,) [s], its rest included."""
        return np.real(np.exp(np.outer(time, self.rates)) @ self.weights) + self.rest

    def extrema(self) -> tuple[np.ndarray, np.ndarray]:
        """(times, values less the rest) of the extrema after t = 0."""
        times, values = np.empty(MAX_EXTREMA), np.empty(MAX_EXTREMA)
        n = extrema(*one_per_pair(self.rates, self.weights), times, values)
        return times[:n], values[:n]

    def last_outside(self, band: float) -> float:
        """Last time at which |signal - rest| exceeds the band; 0 if it never does."""
        times, values = self.extrema()
        start = modal_sum(self.rates, self.weights, 0.0)
        times, values = np.r_[0.0, times], np.r_[start, values]
        out = np.flatnonzero(np.abs(values) > band)
        if not len(out):
            return 0.0
        k = out[-1]
        level = np.copysign(band, values[k])
        end = times[k + 1] if k + 1 < len(times) else times[k] + 60.0 / -np.max(self.rates.real)
        return float(bisect(self.rates, self.weights, times[k], end, values[k] - level, level))


def decompose(a: np.ndarray, b: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modes of y = rows x, dx/dt = a x + b from rest, minus the final value.

    a        (m, n, n); b (n,); rows (ny, n)
    returns  rates (m, n), weights (m, ny, n), complex
    """
    rates, vectors = np.linalg.eig(a)
    rates, vectors = rates.astype(complex), vectors.astype(complex)
    steady_state = np.linalg.solve(a, np.broadcast_to(b, a.shape[:-1])[..., None])
    with np.errstate(all="ignore"):
        coordinates = np.linalg.solve(vectors, steady_state.astype(complex))[..., 0]
    return rates, (rows @ vectors) * coordinates[:, None, :]
