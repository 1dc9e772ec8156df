"""A part of a sample without events: one product with the exact step matrix of the mode.

The guards of the mode are looked at in its start, its end and instants between. If a contact or a
friction has left its mode, or may have done so and come back, the step is refused; events.py then
takes it. Sensitivities have ns columns: nq parameters, nx start states, and at least one spare in
which the weighted residual is returned, so that one product gives the normal equations.
"""

from __future__ import annotations

from numba import njit

from drivetool.drive.compiled import APART, HOT


@njit(**HOT)
def guard_values(spring, slip_rows, x, v):
    """Contact torques and speeds that decide on the mode: v (elements,)."""
    for g in range(spring.shape[0]):
        v[g] = 0.0
        for j in range(x.size):
            v[g] += spring[g, j, 0] * x[j]
    for f in range(slip_rows.size):
        v[spring.shape[0] + f] = x[slip_rows[f]]


@njit(**HOT)
def classify(reach, v, mode):
    """Set the mode that guard values lie in; returns whether it changed.

    A body at exactly zero speed sticks for now.
    """
    changed = False
    for e in range(mode.size):
        level = reach[e, 0] if e < reach.shape[0] else 0.0
        digit = 0 if v[e] > level else (2 if v[e] < -level else 1)
        changed = changed or digit != mode[e]
        mode[e] = digit
    return changed


@njit(**HOT)
def value_three(rows, r, x, u):
    """rows[r] [x, u, 1] for three states; short chains of what waits for the state."""
    return (rows[r, 2] * x[2] + (rows[r, 3] * u + rows[r, 4])) + (rows[r, 1] * x[1] + rows[r, 0] * x[0])


@njit(**HOT)
def value_five(rows, r, x, u):
    """The same for five states."""
    return ((rows[r, 4] * x[4] + (rows[r, 5] * u + rows[r, 6])) + (rows[r, 3] * x[3] + rows[r, 2] * x[2])
            + (rows[r, 1] * x[1] + rows[r, 0] * x[0]))


@njit(**HOT)
def row_value(rows, r, x, u, i):
    """rows[r] [x, u[i], 1]; two and three masses without a loop, which is twice as fast."""
    nx, nu = x.size, u.shape[1]
    if nu == 1 and nx == 3:
        return value_three(rows, r, x, u[i, 0])
    if nu == 1 and nx == 5:
        return value_five(rows, r, x, u[i, 0])
    v = rows[r, nx + nu]
    for j in range(nu):
        v += rows[r, nx + j] * u[i, j]
    for j in range(nx):
        v += rows[r, j] * x[j]
    return v


@njit(**HOT)
def stays(watch, looks, reach, level, k, mode, x, b, u, i):
    """Whether mode k holds from x to b: guard values at both ends, between, and in dips unseen.

    Between equal instants a curve dips below its lowest value by an eighth of its second
    difference; twice is allowed.
    """
    for e in range(mode.size):
        f, rows = e - reach.shape[0], watch[k, e]
        digit = mode[e]
        first, last = row_value(rows, 0, x, u, i), row_value(rows, 0, b, u, i)
        low, high, bend = min(first, last), max(first, last), 0.0
        before, now = first, first
        for m in range(1, looks[k] + 1):
            v = row_value(rows, m, x, u, i)
            low, high = min(low, v), max(high, v)
            bend = max(bend, abs(v - 2.0 * now + before) if m > 1 else 0.0)
            before, now = now, v
        bend = max(bend, abs(last - 2.0 * now + before))
        bound = reach[e, 0] if f < 0 else level[f, 0] if digit == 1 else 0.0
        inside, ahead = bound - max(high, -low), (low if digit == 0 else -high) - bound
        if (inside if digit == 1 else ahead) < 0.25 * bend:
            return False
    return True


@njit(**HOT)
def predict(leap, k, x, u, i, b):
    """b = leap [x, u[i], 1]."""
    rows = leap[k]
    for r in range(x.size):
        b[r] = row_value(rows, r, x, u, i)


@njit(**APART)
def propagate_any(leap, dleap, k, x, u, i, big, rows, t):
    """First rows of t = leap big + dleap z; columns innermost, so that the compiler makes vectors of them."""
    nx, nu, nq, ns = x.size, u.shape[1], dleap.shape[3], big.shape[1]
    for r in range(rows):
        e = leap[k, r, 0]
        for q in range(ns):
            t[r, q] = e * big[0, q]
        for j in range(1, nx):
            e = leap[k, r, j]
            for q in range(ns):
                t[r, q] += e * big[j, q]
        for q in range(nq):
            t[r, q] += dleap[k, r, nx + nu, q]
        for j in range(nx):
            e = x[j]
            for q in range(nq):
                t[r, q] += dleap[k, r, j, q] * e
        for j in range(nu):
            e = u[i, j]
            for q in range(nq):
                t[r, q] += dleap[k, r, nx + j, q] * e


@njit(**APART)
def turn_three(e, b0, b1, b2):
    """Columns without a source of their own: three rows of big times e (3, nz), in place."""
    for q in range(b0.size):
        v0, v1, v2 = b0[q], b1[q], b2[q]
        b0[q] = e[0, 0] * v0 + e[0, 1] * v1 + e[0, 2] * v2
        b1[q] = e[1, 0] * v0 + e[1, 1] * v1 + e[1, 2] * v2
        b2[q] = e[2, 0] * v0 + e[2, 1] * v1 + e[2, 2] * v2


@njit(**APART)
def three_rows(e, d, x0, x1, x2, u0, b0, b1, b2):
    """The same for three states and one input, the two-mass drive: in place, row by row of big.

    e (3, nz) and d (3, nz, nq) are leap and dleap of the mode
    """
    nq = d.shape[2]
    e00, e01, e02, e10, e11, e12 = e[0, 0], e[0, 1], e[0, 2], e[1, 0], e[1, 1], e[1, 2]
    e20, e21, e22 = e[2, 0], e[2, 1], e[2, 2]
    for q in range(nq):
        v0, v1, v2 = b0[q], b1[q], b2[q]
        b0[q] = (e00 * v0 + e01 * v1 + e02 * v2) + ((d[0, 0, q] * x0 + d[0, 1, q] * x1)
                                                    + (d[0, 2, q] * x2 + d[0, 3, q] * u0) + d[0, 4, q])
        b1[q] = (e10 * v0 + e11 * v1 + e12 * v2) + ((d[1, 0, q] * x0 + d[1, 1, q] * x1)
                                                    + (d[1, 2, q] * x2 + d[1, 3, q] * u0) + d[1, 4, q])
        b2[q] = (e20 * v0 + e21 * v1 + e22 * v2) + ((d[2, 0, q] * x0 + d[2, 1, q] * x1)
                                                    + (d[2, 2, q] * x2 + d[2, 3, q] * u0) + d[2, 4, q])
    turn_three(e, b0[nq:], b1[nq:], b2[nq:])


@njit(**HOT)
def propagate_three(e, d, x, u0, big):
    """big = leap big + dleap z in place, for three states and one input."""
    three_rows(e, d, x[0], x[1], x[2], u0, big[0], big[1], big[2])


@njit(**APART)
def turn_five(e, b0, b1, b2, b3, b4):
    """The same as turn_three for five states."""
    for q in range(b0.size):
        v0, v1, v2, v3, v4 = b0[q], b1[q], b2[q], b3[q], b4[q]
        b0[q] = (e[0, 0] * v0 + e[0, 1] * v1) + (e[0, 2] * v2 + e[0, 3] * v3) + e[0, 4] * v4
        b1[q] = (e[1, 0] * v0 + e[1, 1] * v1) + (e[1, 2] * v2 + e[1, 3] * v3) + e[1, 4] * v4
        b2[q] = (e[2, 0] * v0 + e[2, 1] * v1) + (e[2, 2] * v2 + e[2, 3] * v3) + e[2, 4] * v4
        b3[q] = (e[3, 0] * v0 + e[3, 1] * v1) + (e[3, 2] * v2 + e[3, 3] * v3) + e[3, 4] * v4
        b4[q] = (e[4, 0] * v0 + e[4, 1] * v1) + (e[4, 2] * v2 + e[4, 3] * v3) + e[4, 4] * v4


@njit(**APART)
def source_of_five(d, x0, x1, x2, x3, x4, u0, b):
    """Add to a row of big what its own source gives: d (7, nq) over [x, u, 1]."""
    for q in range(b.size):
        b[q] += ((d[0, q] * x0 + d[1, q] * x1) + (d[2, q] * x2 + d[3, q] * x3)
                 + (d[4, q] * x4 + d[5, q] * u0) + d[6, q])


@njit(**HOT)
def propagate_five(e, d, x, u0, big):
    """The same for the three-mass drive: in place."""
    x0, x1, x2, x3, x4 = x[0], x[1], x[2], x[3], x[4]
    turn_five(e, big[0], big[1], big[2], big[3], big[4])
    nq = d.shape[2]
    for r in range(5):
        source_of_five(d[r], x0, x1, x2, x3, x4, u0, big[r, :nq])


@njit(**HOT)
def propagate(leap, dleap, k, x, u, i, big, t):
    """big = leap big + dleap z, through the scratch t."""
    if x.size == 3 and u.shape[1] == 1:
        propagate_three(leap[k], dleap[k], x, u[i, 0], big)
        return
    if x.size == 5 and u.shape[1] == 1:
        propagate_five(leap[k], dleap[k], x, u[i, 0], big)
        return
    propagate_any(leap, dleap, k, x, u, i, big, x.size, t)
    for r in range(x.size):
        for q in range(big.shape[1]):
            big[r, q] = t[r, q]


@njit(**HOT)
def fading(memory):
    """The disturbance state, the only one that decays from sample to sample; -1 if there is none."""
    found = -1
    for r in range(memory.size):
        found = r if memory[r] != 1.0 else found
    return found


@njit(**HOT)
def forget(memory, r, x, big):
    """Let state r decay from one sample to the next, unless r is -1."""
    if r >= 0:
        x[r] *= memory[r]
        for q in range(big.shape[1]):
            big[r, q] *= memory[r]
