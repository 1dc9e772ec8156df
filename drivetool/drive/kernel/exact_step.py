"""A part of a sample without events: one product with the exact step matrix of the mode.

The guards of the mode are evaluated at the start, the end and instants between. If a contact or a friction has left
its mode, or may have left it and returned, the step is rejected and events.py takes it. Sensitivities have ns
columns: nq parameters, nx start states, and at least one for the weighted residual, so that one product gives the
normal equations.
"""

from __future__ import annotations

from numba import njit

from drivetool.drive.compile import INLINED, NO_OVERLAP


@njit(**INLINED)
def guard_values(s, mode, x, v):
    """Contact torques and speeds that determine the mode: v (elements,)."""
    for g in range(s.ng):
        v[g] = 0.0
        for j in range(x.size):
            v[g] += (s.open_guard[g, j, 0] if mode[g] == 1 else s.spring[g, j, 0]) * x[j]
    for f in range(s.nf):
        v[s.ng + f] = x[s.slip_rows[f]]


@njit(**INLINED)
def classify(reach, v, mode):
    """Set the mode to which guard values belong; returns whether it changed.

    A body at exactly zero speed sticks. The sign of a torque transmitted is left for the next step to find.
    """
    changed = False
    for e in range(v.size):
        level = reach[e, 0] if e < reach.shape[0] else 0.0
        digit = 0 if v[e] > level else (2 if v[e] < -level else 1)
        changed = changed or digit != mode[e]
        mode[e] = digit
    return changed


@njit(**INLINED)
def row_value(rows, r, x, u, i):
    """rows[r] [x, u[i], 1]."""
    nx, nu = x.size, u.shape[1]
    v = rows[r, nx + nu]
    for j in range(nu):
        v += rows[r, nx + j] * u[i, j]
    for j in range(nx):
        v += rows[r, j] * x[j]
    return v


@njit(**INLINED)
def mode_holds(guard_rows, guard_instants, reach, level, k, mode, x, b, u, i):
    """Whether mode k holds from x to b: guard values at both ends, between, and in dips between the instants.

    Between equally spaced instants a parabola dips below its lowest value by at most an eighth of its second
    difference; twice that is required as margin.
    """
    for e in range(mode.size):
        f, rows = e - reach.shape[0], guard_rows[k, e]
        digit = mode[e]
        first, last = row_value(rows, 0, x, u, i), row_value(rows, 0, b, u, i)
        low, high, second_difference = min(first, last), max(first, last), 0.0
        before, now = first, first
        for m in range(1, guard_instants[k] + 1):
            v = row_value(rows, m, x, u, i)
            low, high = min(low, v), max(high, v)
            second_difference = max(second_difference, abs(v - 2.0 * now + before) if m > 1 else 0.0)
            before, now = now, v
        second_difference = max(second_difference, abs(last - 2.0 * now + before))
        bound = reach[e, 0] if f < 0 else level[f, 0] if digit == 1 else 0.0
        margin_inside, margin_ahead = bound - max(high, -low), (low if digit == 0 else -high) - bound
        if (margin_inside if digit == 1 else margin_ahead) < 0.25 * second_difference:
            return False
    return True


@njit(**INLINED)
def predict(phi, k, x, u, i, b):
    """b = phi [x, u[i], 1]."""
    rows = phi[k]
    for r in range(x.size):
        b[r] = row_value(rows, r, x, u, i)


@njit(**NO_OVERLAP)
def propagate_rows(phi, dphi, k, x, u, i, sens, rows, t):
    """First rows of t = phi sens + dphi z; columns innermost, so that the compiler vectorises them."""
    nx, nu, nq, ns = x.size, u.shape[1], dphi.shape[3], sens.shape[1]
    for r in range(rows):
        e = phi[k, r, 0]
        for q in range(ns):
            t[r, q] = e * sens[0, q]
        for j in range(1, nx):
            e = phi[k, r, j]
            for q in range(ns):
                t[r, q] += e * sens[j, q]
        for q in range(nq):
            t[r, q] += dphi[k, r, nx + nu, q]
        for j in range(nx):
            e = x[j]
            for q in range(nq):
                t[r, q] += dphi[k, r, j, q] * e
        for j in range(nu):
            e = u[i, j]
            for q in range(nq):
                t[r, q] += dphi[k, r, nx + j, q] * e


@njit(**INLINED)
def propagate(phi, dphi, k, x, u, i, sens, t):
    """sens = phi sens + dphi z, through the scratch t."""
    propagate_rows(phi, dphi, k, x, u, i, sens, x.size, t)
    for r in range(x.size):
        for q in range(sens.shape[1]):
            sens[r, q] = t[r, q]


@njit(**INLINED)
def decaying_state(memory):
    """The disturbance state, the only one that decays from sample to sample; -1 if there is none."""
    found = -1
    for r in range(memory.size):
        found = r if memory[r] != 1.0 else found
    return found


@njit(**INLINED)
def decay_state(memory, r, x, sens):
    """Multiply state r by its decay from one sample to the next, unless r is -1."""
    if r >= 0:
        x[r] *= memory[r]
        for q in range(sens.shape[1]):
            sens[r, q] *= memory[r]
