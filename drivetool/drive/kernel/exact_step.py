"""A part of a sample without events: one product with the exact step matrix of the mode.

The guards of the mode are looked at in its start, its end and instants between. If a contact or a
friction has left its mode, or may have done so and come back, the step is refused; events.py then
takes it. Sensitivities have ns columns: nq parameters, nx start states, and at least one spare in
which the weighted residual is returned, so that one product gives the normal equations.
"""

from __future__ import annotations

from numba import njit

from drivetool.drive.compile import APART, HOT


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
def row_value(rows, r, x, u, i):
    """rows[r] [x, u[i], 1]."""
    nx, nu = x.size, u.shape[1]
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


@njit(**HOT)
def propagate(leap, dleap, k, x, u, i, big, t):
    """big = leap big + dleap z, through the scratch t."""
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
