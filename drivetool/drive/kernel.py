"""The exact simulation of a piecewise linear chain, with sensitivities and observer gains.

Per sample one product with the exact step matrix of the mode. If at its end a contact or a
friction has left its mode, or may have done so and come back, the step is repeated with located
events. Sensitivities have ns columns: nq parameters, nx start states, and at least one spare in
which the weighted residual is returned, so that one product gives the normal equations.
"""

from __future__ import annotations

from numba import njit

from drivetool.drive.compiled import COMPILE, HOT
from drivetool.drive.events import event_step
from drivetool.drive.modes import lookup


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
def fits(reach, mode, new, old, older, watch):
    """Whether guard values at the end of a step agree with the mode.

    With `watch`, the second difference bounds by how much a guard can have dipped between two
    samples; under an observer, whose corrections are larger, it says nothing.
    """
    for e in range(mode.size):
        if e < reach.shape[0]:
            level = reach[e, 0]
        elif mode[e] == 1:
            continue
        else:
            level = 0.0
        dip = 0.25 * abs(new[e] - 2.0 * old[e] + older[e]) if watch else 0.0
        if mode[e] == 1:
            margin = level - max(abs(new[e]), abs(old[e]))
        else:
            side = 1.0 - mode[e]
            margin = min(side * new[e], side * old[e]) - level
        if margin < dip:
            return False
    return True


@njit(**HOT)
def holds(level, net, k, mode, x, u, i):
    """Whether every sticking body stays put under the torques at x and u[i]."""
    first = mode.size - level.shape[0]
    for f in range(level.shape[0]):
        if mode[first + f] == 1:
            v = net[k, f, x.size + u.shape[1]]
            for j in range(x.size):
                v += net[k, f, j] * x[j]
            for j in range(u.shape[1]):
                v += net[k, f, x.size + j] * u[i, j]
            if abs(v) > level[f, 0]:
                return False
    return True


@njit(**HOT)
def predict(leap, k, x, u, i, b):
    """b = leap [x, u[i], 1]."""
    nx, nu = x.size, u.shape[1]
    for r in range(nx):
        v = leap[k, r, nx + nu]
        for j in range(nu):
            v += leap[k, r, nx + j] * u[i, j]
        for j in range(nx):
            v += leap[k, r, j] * x[j]
        b[r] = v


@njit(**HOT)
def propagate_any(leap, dleap, k, x, u, i, big, t):
    """t = leap big + dleap z; columns innermost, so that the compiler makes vectors of them."""
    nx, nu, nq, ns = x.size, u.shape[1], dleap.shape[3], big.shape[1]
    for r in range(nx):
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
def propagate_three(e, d, k, x, u, i, big, t):
    """The same for three states and one input, the two-mass drive: twice as fast unrolled."""
    x0, x1, x2, u0 = x[0], x[1], x[2], u[i, 0]
    for r in range(3):
        e0, e1, e2 = e[k, r, 0], e[k, r, 1], e[k, r, 2]
        for q in range(big.shape[1]):
            t[r, q] = e0 * big[0, q] + e1 * big[1, q] + e2 * big[2, q]
        for q in range(d.shape[3]):
            t[r, q] += ((d[k, r, 0, q] * x0 + d[k, r, 1, q] * x1)
                        + (d[k, r, 2, q] * x2 + d[k, r, 3, q] * u0) + d[k, r, 4, q])


@njit(**HOT)
def propagate(leap, dleap, k, x, u, i, big, t):
    """big = leap big + dleap z, through the scratch t."""
    if x.size == 3 and u.shape[1] == 1:
        propagate_three(leap, dleap, k, x, u, i, big, t)
    else:
        propagate_any(leap, dleap, k, x, u, i, big, t)
    for r in range(x.size):
        for q in range(big.shape[1]):
            big[r, q] = t[r, q]


@njit(**COMPILE)
def rough_step(s, c, x, held, big, mode, part, new):
    """A part of a sample with events; new gets the guard values at its end."""
    event_step(s, c, x, held, big, mode, part)
    guard_values(s.spring, s.slip_rows, x, new)


@njit(**COMPILE)
def switch_late(s, c, x, u, late, big, mode):
    """Saltation where the held torque switches inside a sample, at the dead time."""
    k = lookup(s, c, mode, 0)
    for r in range(s.nx):
        jump = 0.0
        for j in range(s.nu):
            jump += c.flow[k, r, s.nx + j, 0] * (late[j] - u[j])
        for q in range(s.nq):
            big[r, q] += jump * s.delay[q]


@njit(**HOT)
def forget(memory, x, big):
    """Let the disturbance state decay from one sample to the next."""
    for r in range(x.size):
        if memory[r] != 1.0:
            x[r] *= memory[r]
            for q in range(big.shape[1]):
                big[r, q] *= memory[r]
