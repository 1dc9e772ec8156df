"""Extrema and integrals of signals that are sums of modes: the real part of sum weights exp(rates t).

Extrema separate monotone pieces of a decaying sum, each piece has at most one zero, and integrals between zeros
are closed: no figure depends on a time grid. A step length only sets where extrema are searched; it follows from
the modes that have not decayed. Complex numbers are pairs of floats here: (n, 2) are n of them.
"""

from __future__ import annotations

import math

from numba import njit

from drivetool.drive.compile import COMPILE, INLINED, MODES, WHOLE, as_unit

# Steps of one length, and changes of that length. A choice: longer blocks step too finely once fast modes have
# decayed; the number of blocks only ends the search in modes that hardly decay.
BLOCK_STEPS, MAX_BLOCKS = 12, 40000
CANCELLATION_ROUNDING = 1e-10  # of a sum of cancelling terms, relative to them: 1e6 times the rounding of a double
DECAYED_SHARE = 1e-10  # share of the first integral below which the remaining signal is dropped; no figure shows it


@njit(**INLINED)
def magnitude(z):
    """Of a complex number (2,)."""
    return math.sqrt(z[0] * z[0] + z[1] * z[1])


@njit(**COMPILE)
def modal_sum(rates, weights, t):
    """The signal at t."""
    v = 0.0
    for i in range(rates.shape[0]):
        angle = rates[i, 1] * t
        v += math.exp(rates[i, 0] * t) * (weights[i, 0] * math.cos(angle) - weights[i, 1] * math.sin(angle))
    return v


@njit(**INLINED)
def remaining(rates, weights, t):
    """Sum of the magnitudes of the modes at t."""
    total = 0.0
    for i in range(rates.shape[0]):
        total += magnitude(weights[i]) * math.exp(rates[i, 0] * t)
    return total


@njit(**INLINED)
def fastest_rate(rates, weights, t, share):
    """The fastest rate among the modes that have more than a share of the magnitudes at t."""
    fast, least = 0.0, share * remaining(rates, weights, t)
    for i in range(rates.shape[0]):
        if magnitude(weights[i]) * math.exp(rates[i, 0] * t) > least:
            fast = max(fast, magnitude(rates[i]))
    return fast


@njit(**COMPILE)
def crossing(rates, weights, a, b, fa):
    """The zero of the signal between a and b; fa is its value at a.

    Illinois steps: the side that does not move counts half.
    """
    fb = modal_sum(rates, weights, b)
    for _ in range(80):
        if abs(b - a) <= 1e-11 * b or fb == 0.0 or fb == fa:  # integrals are flat at their zeros: an error of 1e-22
            break
        t = b - fb * (b - a) / (fb - fa)
        if not (min(a, b) < t < max(a, b)):
            t = 0.5 * (a + b)
        f = modal_sum(rates, weights, t)
        if (f > 0.0) == (fb > 0.0):
            fa *= 0.5
        else:
            a, fa = b, fb
        b, fb = t, f
    return b - fb * (b - a) / (fb - fa) if fb != fa else b


@njit(**INLINED)
def start_steps(rates, slopes, t, h, now, ratio):
    """Each mode of the slope at t, and its ratio over a step: a product per step instead of an exponential."""
    for i in range(rates.shape[0]):
        c, s, e = math.cos(rates[i, 1] * t), math.sin(rates[i, 1] * t), math.exp(rates[i, 0] * t)
        now[i, 0], now[i, 1] = e * (slopes[i, 0] * c - slopes[i, 1] * s), e * (slopes[i, 0] * s + slopes[i, 1] * c)
        e = math.exp(rates[i, 0] * h)
        ratio[i, 0], ratio[i, 1] = e * math.cos(rates[i, 1] * h), e * math.sin(rates[i, 1] * h)


@njit(**INLINED)
def next_slope(now, ratio):
    """The slope a step later."""
    slope = 0.0
    for i in range(now.shape[0]):
        re, im = now[i, 0], now[i, 1]
        now[i, 0], now[i, 1] = re * ratio[i, 0] - im * ratio[i, 1], re * ratio[i, 1] + im * ratio[i, 0]
        slope += now[i, 0]
    return slope


@njit(**COMPILE)
def follow(rates, weights, slopes, integrals, now, ratio, turns, found):
    """Follow one signal from extremum to extremum; as in `extrema`."""
    start, size = modal_sum(rates, integrals, 0.0), DECAYED_SHARE * remaining(rates, integrals, 0.0)
    before, total, largest = start, 0.0, abs(start)
    a, fa, t, n = 0.0, modal_sum(rates, weights, 0.0), 0.0, 0
    slope = modal_sum(rates, slopes, 1e-12 / max(fastest_rate(rates, rates, 0.0, 0.0), 1e-300))
    slope_rounding = CANCELLATION_ROUNDING * remaining(rates, slopes, 0.0)
    for _ in range(MAX_BLOCKS):
        if remaining(rates, integrals, t) <= size or n >= turns.shape[1] - BLOCK_STEPS:
            break
        h = 0.3 / fastest_rate(rates, slopes, t, 1e-7)
        start_steps(rates, slopes, t, h, now, ratio)
        for k in range(BLOCK_STEPS):
            last, slope = slope, next_slope(now, ratio)
            # A signal that starts flat has no direction until its slope exceeds rounding.
            if (slope > 0.0) != (last > 0.0) and not (n == 0 and abs(last) < slope_rounding):
                b = crossing(rates, slopes, t + k * h, t + (k + 1) * h, last)
                fb = modal_sum(rates, weights, b)
                if fa * fb < 0.0:
                    left = modal_sum(rates, integrals, crossing(rates, weights, a, b, fa))
                    total, largest = total + abs(left - before), max(largest, abs(left - start))
                    before = left
                turns[0, n], turns[1, n] = b, fb
                a, fa, n = b, fb, n + 1
        t += BLOCK_STEPS * h
    found[0], found[1] = total + abs(before), largest
    return n


@as_unit(MODES, gives=WHOLE)
def extrema(p):
    """Integrals of each signal, exact between its zeros, and the extrema of the last; returns their number."""
    n = 0
    for i in range(p.count.size):
        kept = p.count[i]
        n = follow(p.rates[i, :kept], p.weights[i, :kept], p.slopes[i, :kept], p.integrals[i, :kept],
                   p.step[0, :kept], p.step[1, :kept], p.extrema, p.found[i])
    return n
