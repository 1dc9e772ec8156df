"""Where a guard polynomial first becomes negative."""

from __future__ import annotations

from numba import njit

from drivetool.drive.compile import COMPILE


@njit(**COMPILE)
def horner(p, t):
    """Value of the polynomial p (k,) at t."""
    v = 0.0
    for k in range(p.size - 1, -1, -1):
        v = v * t + p[k]
    return v


@njit(**COMPILE)
def derivative_at(p, t):
    """Derivative of the polynomial p (k,) at t."""
    v = 0.0
    for k in range(p.size - 1, 0, -1):
        v = v * t + k * p[k]
    return v


@njit(**COMPILE)
def bracketed_root(p, lo, hi):
    """Root of p between lo, where p > 0, and hi, where p < 0: Newton steps, bisection if one leaves it."""
    first, last = horner(p, lo), horner(p, hi)
    t = (lo * last - hi * first) / (last - first)
    for trial in range(100):
        if trial > 20 or not lo < t < hi:
            t = 0.5 * (lo + hi)
        v, d = 0.0, 0.0
        for k in range(p.size - 1, -1, -1):
            d = d * t + v
            v = v * t + p[k]
        if v == 0.0 or hi - lo < 1e-15 * hi:
            return t
        if v > 0.0:
            lo = t
        else:
            hi = t
        t -= v / d
        if abs(v) < 1e-15 * t * abs(d):
            return t
    return hi


@njit(**COMPILE)
def deflate(p, end, noise):
    """Divide out the lowest terms of a guard that has just been at zero, as far as they are rounding errors.

    Returns the sign of the first significant term, 0 if none is until `end`; p is changed.
    """
    if abs(p[0]) > noise:
        return 1.0 if p[0] > 0.0 else -1.0
    size, power = 0.0, 1.0
    for k in range(1, p.size):
        power *= end
        size += abs(p[k]) * power
    power, order, threshold = 1.0, 0, max(noise, 1e-12 * size)
    for k in range(1, p.size):
        power *= end
        if abs(p[k]) * power > threshold:
            order = k
            break
    if order == 0:
        return 0.0
    for k in range(p.size):
        p[k] = p[k + order] if k + order < p.size else 0.0
    return 1.0 if p[0] > 0.0 else -1.0


@njit(**COMPILE)
def first_exit(p, end, just_switched, span, noise):
    """First time in [0, end] at which the guard p(t) becomes negative, or -1.

    just_switched  the guard has just been at zero: the root at 0 is not found again; values up to `noise` are then
                   zero, and terms that change it by less until `span` >= end are ignored
    """
    if just_switched and deflate(p, span, noise) == 0.0:
        return -1.0
    if p[0] < 0.0:
        return 0.0
    if horner(p, end) < 0.0:
        return bracketed_root(p, 0.0, end)
    if p[1] < 0.0 and derivative_at(p, end) > 0.0:  # may dip below and come back
        lo, hi = 0.0, end
        for _ in range(60):
            t = 0.5 * (lo + hi)
            if horner(p, t) < 0.0:
                return bracketed_root(p, 0.0, t)
            if derivative_at(p, t) < 0.0:
                lo = t
            else:
                hi = t
    return -1.0
