"""From event to event: the state stays in registers from sample to sample.

What is done at a sample is what run.py and filter.py do there. A sample in which an event may lie is not begun, or
begun and left to them, who do it from its start.
"""

from __future__ import annotations

from collections.abc import Callable

from numba import njit

from drivetool.drive.arrays import NARROW, WIDE
from drivetool.drive.compile import APART, HOT
from drivetool.drive.kernel.exact_step import fading
from drivetool.drive.kernel.outputs import output_gradient, output_row
from drivetool.drive.kernel.registers import (
    along,
    carried,
    column,
    combined,
    corrected,
    following,
    half_of,
    lessened,
    product,
    put,
    put_half,
    scaled,
    taker,
    turned,
    turned_with,
)


@njit(**APART)
def listen(b, k, col):
    """What the correction by k leaves of the columns of a state: b (ns,) -= k col."""
    for q in range(b.size):
        b[q] -= k * col[q]


@njit(**APART)
def weighted_row(col, g, e, seen, row):
    """Copy the columns col (ns,) of an output, and write its row of the Jacobian, weighted residual last."""
    last = col.size - 1
    for q in range(last):
        seen[q] = col[q]
        row[q] = g * col[q]
    seen[last], row[last] = 0.0, -g * e


@njit(**APART)
def write_row(jac, i, m, col, g, e):
    """Row of the weighted Jacobian, the weighted residual in its last column."""
    last = col.size - 1
    for q in range(last):
        jac[i, m, q] = g * col[q]
    jac[i, m, last] = -g * e


@njit(**HOT)
def seen(s, mode, m, z, x, row):
    """Output m at the state z; where it is more than a state, x becomes z and row what gives it over x."""
    pick = s.picks[m]
    if pick >= 0:
        return z[pick]
    put(x, 0, z)
    return output_row(s.outputs, s.spring, s.reach, s.output_gap, s.picks, mode, m, x, row)


@njit(**HOT)
def keeps(rows, looks, mode, reach, level, z, b, torque, observed):
    """Whether the mode holds from z to b, as kernel.stays asks; observed where z has been corrected."""
    gaps, smooth, width = reach.shape[0], True, rows.shape[2]
    for element in range(mode.size):
        digit, row = mode[element], rows[element]
        first, last = along(row, 0, z, torque), along(row, 0, b, torque)
        low, high, bend = min(first, last), max(first, last), 0.0
        before, now = first, first
        for m in range(1, looks + 1):
            v = along(row, m * width, z, torque)
            low, high = min(low, v), max(high, v)
            bend = max(bend, abs(v - 2.0 * now + before) if m > 1 else 0.0)
            before, now = now, v
        bend = max(bend, abs(last - 2.0 * now + before))
        bound = reach[element, 0] if element < gaps else level[element - gaps, 0] if digit == 1 else 0.0
        room = bound - max(high, -low) if digit == 1 else (low if digit == 0 else -high) - bound
        # A body that sticks is moved by a correction.
        smooth = smooth and room >= 0.25 * bend and not (observed and digit == 1 and element >= gaps)
    return smooth


def mover(n: int) -> Callable:
    """move(e, d, x, u, big): the columns of n states a sample later, in place; d as wide in arrays/system.py."""
    wide, narrow, width = taker(n, WIDE), taker(n, NARROW), n + 2

    @njit(**HOT)
    def move(e, d, x, u, big):
        ns = big.shape[1]
        for c in range(d.shape[0]):
            q, block = WIDE * c, d[c]
            v = wide(big, q, ns)
            for r in range(n):
                put(big, q + r * ns, turned_with(e, r * width, v, block, x, u))
        for q in range(WIDE * d.shape[0], ns, NARROW):
            w = narrow(big, q, ns)
            for r in range(n):
                put(big, q + r * ns, turned(e, r * width, w))

    return move


def stepper(n: int) -> Callable:
    """step(s, c, k, x, u, i, big, mode): run.plain_step for n states and one input."""
    state, move = taker(n), mover(n)

    @njit(**HOT)
    def step(s, c, k, x, u, i, big, mode):
        z, torque = state(x, 0, 1), u[i, 0]
        b = following(c.leap[k], z, torque)
        if not keeps(c.watch[k], c.looks[k], mode, s.reach, c.hold, z, b, torque, False):
            return False
        if big.shape[1] > 0:
            move(c.leap[k], c.wide[k], z, torque, big)
        put(x, 0, b)
        return True

    return step


def carrier(n: int) -> Callable:
    """carry(p, f, noise, q, extra): filter.advance_covariance for n states."""
    state = taker(n)

    @njit(**HOT)
    def carry(p, f, noise, q, extra):
        kick = state(noise, 0, 1)
        put_half(p, carried(half_of(p, kick), f, kick, q, extra), kick)

    return carry


def glider(n: int) -> Callable:
    """glide(s, c, p, k, i): samples from i on in the mode of slot k; returns the first that was not done.

    s, c, p  system, cache and pass, of n states and one input that does not switch inside a sample
    """
    state, move = taker(n), mover(n)

    @njit(**HOT)
    def glide(s, c, p, k, i):
        e, d, rows, looks, mode, x = c.leap[k], c.wide[k], c.watch[k], c.looks[k], p.mode, state(p.x, 0, 1)
        reach, level, picks, memory, fades = s.reach, c.hold, s.picks, s.memory, fading(s.memory)
        u, y, gain, weight, big, out, jac, states = p.u, p.y, p.gain, p.weight, p.big, p.out, p.jac, p.states
        count, weighed, observed, row, col = len(u), len(weight) > 0, len(gain) > 0, c.vectors[0], c.gradient
        while i < count:
            z = x
            for m in range(out.shape[1]):
                out[i, m] = seen(s, mode, m, z, p.x, row)
                if observed and y[i, m] == y[i, m]:
                    z = corrected(z, gain[i, m], y[i, m] - out[i, m])
            torque = u[i, 0]
            b = following(e, z, torque)
            if not keeps(rows, looks, mode, reach, level, z, b, torque, observed):
                break
            if states.shape[0] > 0:
                put(states[i], 0, x)
            z = x
            for m in range(out.shape[1] if jac.shape[0] > 0 else 0):
                known = y[i, m] == y[i, m]
                g = (weight[i, m] if weighed else 1.0) if known else 0.0
                e_m = y[i, m] - out[i, m] if known else 0.0
                if picks[m] >= 0:
                    weighted_row(big[picks[m]], g, e_m, col, jac[i, m])
                else:
                    seen(s, mode, m, z, p.x, row)
                    output_gradient(s.outputs, s.spring, reach, s.output_gap, picks, mode, m, p.x, row, big, col)
                    write_row(jac, i, m, col, g, e_m)
                if observed and known:
                    z = corrected(z, gain[i, m], e_m)
                    for r in range(n):
                        listen(big[r], gain[i, m, r], col)
            if big.shape[1] > 0:
                move(e, d, z, torque, big)
            x = b
            if fades >= 0:
                x = product(x, memory)
                for q in range(big.shape[1]):
                    big[fades, q] *= memory[fades]
            i += 1
        put(p.x, 0, x)
        return i

    return glide


def filter_glider(n: int) -> Callable:
    """glide(s, c, f, k, q, i): samples of a Kalman pass from i on in the mode of slot k; first that was not done.

    s, c, f  system, cache and filtering, of n states and one input that does not switch inside a sample
    """
    state = taker(n)

    @njit(**HOT)
    def glide(s, c, f, k, q, i):
        e, rows, looks, mode, x = c.leap[k], c.watch[k], c.looks[k], f.mode, state(f.x, 0, 1)
        for d in range(s.ng, mode.size):
            if mode[d] == 1:  # noise may break it loose
                return i
        p, kick = half_of(f.p, x), state(f.kick, 0, 1)
        u, y, variance, extra, gain, var, innov, states = f.u, f.y, f.r, f.extra, f.gain, f.var, f.innov, f.states
        noise = corrected(state(e, n, n + 2), kick, 1.0)
        reach, level, picks, memory, fades = s.reach, c.hold, s.picks, s.memory, fading(s.memory)
        row, moved = c.vectors[0], c.transition
        for r in range(n):
            for j in range(n):
                moved[r, j] = memory[r] * e[r, j]
        while i < u.shape[0]:
            z, w = x, p
            for m in range(innov.shape[1]):
                pick = picks[m]
                innov[i, m], var[i, m] = y[i, m] - seen(s, mode, m, z, f.x, row), 1.0
                if y[i, m] == y[i, m]:
                    v = column(w, x, pick) if pick >= 0 else combined(w, row, x)
                    var[i, m] = variance[m] + (v[pick] if pick >= 0 else turned(row, 0, v))
                    g = scaled(v, 1.0 / var[i, m])
                    w, z = lessened(w, v, g), corrected(z, g, innov[i, m])
                    if gain.shape[0] > 0:
                        put(gain[i, m], 0, g)
                elif gain.shape[0] > 0:
                    gain[i, m, :] = 0.0
            torque = u[i, 0]
            b = following(e, z, torque)
            if not keeps(rows, looks, mode, reach, level, z, b, torque, True):
                break
            if states.shape[0] > 0:
                put(states[i], 0, z)
            x, p = product(b, memory) if fades >= 0 else b, carried(w, moved, noise, q, extra)
            i += 1
        put(f.x, 0, x)
        put_half(f.p, p, x)
        return i

    return glide
