"""The exact simulation of a piecewise linear chain, with sensitivities and observer gains.

Per sample one product with the exact step matrix of the mode. If at its end a contact or a
friction has left its mode, or may have done so and come back, the step is repeated with located
events. Sensitivities have ns columns: nq parameters, nx start states, and at least one spare in
which the weighted residual is returned, so that one product gives the normal equations.
"""

from __future__ import annotations

from numba import njit

from drivetool.drive.events import event_step
from drivetool.drive.modes import COMPILE, HOT, lookup


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
def fits(reach, mode, new, old, older):
    """Whether guard values at the end of a step agree with the mode.

    The second difference bounds by how much a guard can have dipped between two samples.
    """
    for e in range(mode.size):
        if e < reach.shape[0]:
            level = reach[e, 0]
        elif mode[e] == 1:
            continue
        else:
            level = 0.0
        dip = 0.25 * abs(new[e] - 2.0 * old[e] + older[e])
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
def propagate(leap, dleap, k, x, u, i, big, t):
    """big = leap big + dleap z, through the scratch t."""
    nx, nu, nq, ns = x.size, u.shape[1], dleap.shape[3], big.shape[1]
    for r in range(nx):
        for q in range(ns):
            v = 0.0
            for j in range(nx):
                v += leap[k, r, j] * big[j, q]
            t[r, q] = v
        for q in range(nq):
            v = t[r, q] + dleap[k, r, nx + nu, q]
            for j in range(nx):
                v += dleap[k, r, j, q] * x[j]
            for j in range(nu):
                v += dleap[k, r, nx + j, q] * u[i, j]
            t[r, q] = v
    for r in range(nx):
        for q in range(ns):
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
