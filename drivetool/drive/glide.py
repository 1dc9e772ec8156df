"""Two and three masses between events: the state stays in registers from sample to sample.

What is done at a sample is what run.py does there. A sample in which an event may lie is not begun, or begun
and left to run.py, which does it from its start.
"""

from __future__ import annotations

from collections.abc import Callable

from numba import njit

from drivetool.drive.compiled import APART, HOT
from drivetool.drive.kernel import propagate_five, propagate_three, value_five, value_three


@njit(**HOT)
def next_three(e, x, u):
    """The state a sample later."""
    return value_three(e, 0, x, u), value_three(e, 1, x, u), value_three(e, 2, x, u)


@njit(**HOT)
def next_five(e, x, u):
    """The same for five states."""
    return (value_five(e, 0, x, u), value_five(e, 1, x, u), value_five(e, 2, x, u), value_five(e, 3, x, u),
            value_five(e, 4, x, u))


@njit(**HOT)
def three_of(x):
    """The state as numbers by themselves."""
    return x[0], x[1], x[2]


@njit(**HOT)
def five_of(x):
    """The same for five states."""
    return x[0], x[1], x[2], x[3], x[4]


@njit(**HOT)
def corrected_three(x, k, e):
    """The state after the correction by k times the innovation e."""
    return x[0] + k[0] * e, x[1] + k[1] * e, x[2] + k[2] * e


@njit(**HOT)
def corrected_five(x, k, e):
    """The same for five states."""
    return x[0] + k[0] * e, x[1] + k[1] * e, x[2] + k[2] * e, x[3] + k[3] * e, x[4] + k[4] * e


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


def keeper(value: Callable) -> Callable:
    """keeps(...): whether the mode holds from z to b, as kernel.stays asks; observed where z has been corrected."""
    @njit(**HOT)
    def keeps(rows, looks, mode, reach, level, z, b, torque, observed):
        gaps, smooth = reach.shape[0], True
        for element in range(mode.size):
            digit = mode[element]
            first, last = value(rows[element], 0, z, torque), value(rows[element], 0, b, torque)
            low, high, bend = min(first, last), max(first, last), 0.0
            before, now = first, first
            for m in range(1, looks + 1):
                v = value(rows[element], m, z, torque)
                low, high = min(low, v), max(high, v)
                bend = max(bend, abs(v - 2.0 * now + before) if m > 1 else 0.0)
                before, now = now, v
            bend = max(bend, abs(last - 2.0 * now + before))
            bound = reach[element, 0] if element < gaps else level[element - gaps, 0] if digit == 1 else 0.0
            room = bound - max(high, -low) if digit == 1 else (low if digit == 0 else -high) - bound
            # A body that sticks is moved by a correction.
            smooth = smooth and room >= 0.25 * bend and not (observed and digit == 1 and element >= gaps)
        return smooth

    return keeps


def glider(state_of: Callable, value: Callable, following: Callable, propagate: Callable,
           corrected: Callable) -> Callable:
    """glide(s, c, p, k, i): samples from i on in the mode of slot k; returns the first that was not done.

    s, c, p  system, cache and pass, of one input; all outputs are states
    """
    keeps = keeper(value)

    @njit(**HOT)
    def glide(s, c, p, k, i):
        e, d, rows, looks, mode, x = c.leap[k], c.dleap[k], c.watch[k], c.looks[k], p.mode, state_of(p.x)
        reach, level, picks = s.reach, c.hold, s.picks
        u, y, gain, weight, big, out, jac, col = p.u, p.y, p.gain, p.weight, p.big, p.out, p.jac, c.gradient
        n, weighed, observed = u.shape[0], weight.shape[0] > 0, gain.shape[0] > 0
        while i < n:
            z = x
            for m in range(out.shape[1]):
                out[i, m] = z[picks[m]]
                if observed and y[i, m] == y[i, m]:
                    z = corrected(z, gain[i, m], y[i, m] - out[i, m])
            torque = u[i, 0]
            b = following(e, z, torque)
            if not keeps(rows, looks, mode, reach, level, z, b, torque, observed):
                break
            for m in range(out.shape[1] if jac.shape[0] > 0 else 0):
                known = y[i, m] == y[i, m]
                g = (weight[i, m] if weighed else 1.0) if known else 0.0
                weighted_row(big[picks[m]], g, y[i, m] - out[i, m] if known else 0.0, col, jac[i, m])
                if observed and known:
                    for r in range(len(x)):
                        listen(big[r], gain[i, m, r], col)
            if big.shape[1] > 0:
                propagate(e, d, z, torque, big)
            x = b
            i += 1
        for r in range(len(x)):
            p.x[r] = x[r]
        return i

    return glide


glide_three = glider(three_of, value_three, next_three, propagate_three, corrected_three)
glide_five = glider(five_of, value_five, next_five, propagate_five, corrected_five)
keeps_three = keeper(value_three)


@njit(**HOT)
def column_three(p, pick):
    """Column of the symmetric matrix of which p are the rows of the lower half."""
    if pick == 0:
        return p[0], p[1], p[3]
    if pick == 1:
        return p[1], p[2], p[4]
    return p[3], p[4], p[5]


@njit(**HOT)
def lessened_three(p, v, k):
    """p - k v'."""
    return (p[0] - k[0] * v[0], p[1] - k[1] * v[0], p[2] - k[1] * v[1],
            p[3] - k[2] * v[0], p[4] - k[2] * v[1], p[5] - k[2] * v[2])


@njit(**HOT)
def advanced_three(p, f, noise, q, extra):
    """f p f' + q noise noise' + diag(extra), its lower half by rows as that of p."""
    a, b, c, d, e, g = p
    f00, f01, f02 = f[0, 0], f[0, 1], f[0, 2]
    f10, f11, f12 = f[1, 0], f[1, 1], f[1, 2]
    f20, f21, f22 = f[2, 0], f[2, 1], f[2, 2]
    t00, t01, t02 = f00 * a + f01 * b + f02 * d, f00 * b + f01 * c + f02 * e, f00 * d + f01 * e + f02 * g
    t10, t11, t12 = f10 * a + f11 * b + f12 * d, f10 * b + f11 * c + f12 * e, f10 * d + f11 * e + f12 * g
    t20, t21, t22 = f20 * a + f21 * b + f22 * d, f20 * b + f21 * c + f22 * e, f20 * d + f21 * e + f22 * g
    k0, k1, k2 = noise
    return ((t00 * f00 + t01 * f01 + t02 * f02) + (q * k0 * k0 + extra[0]),
            (t10 * f00 + t11 * f01 + t12 * f02) + q * k1 * k0,
            (t10 * f10 + t11 * f11 + t12 * f12) + (q * k1 * k1 + extra[1]),
            (t20 * f00 + t21 * f01 + t22 * f02) + q * k2 * k0,
            (t20 * f10 + t21 * f11 + t22 * f12) + q * k2 * k1,
            (t20 * f20 + t21 * f21 + t22 * f22) + (q * k2 * k2 + extra[2]))


@njit(**HOT)
def lower_three(full):
    """The lower half of a symmetric matrix (3, 3), by rows."""
    return full[0, 0], full[1, 0], full[1, 1], full[2, 0], full[2, 1], full[2, 2]


@njit(**HOT)
def put_three(full, p):
    """Write a symmetric matrix (3, 3) of which p are the rows of the lower half."""
    full[0, 0], full[1, 1], full[2, 2] = p[0], p[2], p[5]
    full[1, 0] = full[0, 1] = p[1]
    full[2, 0] = full[0, 2] = p[3]
    full[2, 1] = full[1, 2] = p[4]


@njit(**HOT)
def filter_three(s, c, f, k, q, i):
    """Samples of a Kalman pass from i on in the mode of slot k; returns the first that was not done.

    s, c, f  system, cache and filtering, of three states that do not fade, and one input; all outputs are states
    """
    e, rows, looks, mode, x, p = c.leap[k], c.watch[k], c.looks[k], f.mode, three_of(f.x), lower_three(f.p)
    u, y, r, extra, gain, var, innov, states = f.u, f.y, f.r, f.extra, f.gain, f.var, f.innov, f.states
    noise = e[0, 3] + f.kick[0], e[1, 3] + f.kick[1], e[2, 3] + f.kick[2]
    reach, level, picks = s.reach, c.hold, s.picks
    while i < u.shape[0]:
        z, w = x, p
        for m in range(innov.shape[1]):
            pick, share, column = picks[m], 0.0, (0.0, 0.0, 0.0)
            innov[i, m], var[i, m] = y[i, m] - z[pick], 1.0
            if y[i, m] == y[i, m]:
                column = column_three(w, pick)
                var[i, m] = r[m] + column[pick]
                share = 1.0 / var[i, m]
            g = column[0] * share, column[1] * share, column[2] * share
            if share != 0.0:
                w, z = lessened_three(w, column, g), corrected_three(z, g, innov[i, m])
            if gain.shape[0] > 0:
                gain[i, m, 0], gain[i, m, 1], gain[i, m, 2] = g
        torque = u[i, 0]
        b = next_three(e, z, torque)
        if not keeps_three(rows, looks, mode, reach, level, z, b, torque, True):
            break
        if states.shape[0] > 0:
            states[i, 0], states[i, 1], states[i, 2] = z
        x, p = b, advanced_three(w, e, noise, q, extra)
        i += 1
    f.x[0], f.x[1], f.x[2] = x
    put_three(f.p, p)
    return i
