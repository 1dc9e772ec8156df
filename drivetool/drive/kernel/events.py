"""A step in which a contact closes or opens, or a body stops or breaks away.

Inside a mode the state is a power series in time; every guard is a scalar polynomial of it. The
earliest root among the guards ends the stretch, the mode changes, and the sensitivities are
carried across by the saltation rule. Gap laws are continuous at the contact, and so is breakaway,
so only a body that comes to rest, or reverses without resting, has a saltation that is not one.
"""

from __future__ import annotations

from numba import njit

from drivetool.drive.compile import CACHE, COMPILE, HOT, REALS, SYSTEM, WHOLE, WHOLES, unit
from drivetool.drive.kernel.exact_step import classify, guard_values, predict, propagate_any
from drivetool.drive.kernel.modes import STIFF, lookup, work_out
from drivetool.drive.kernel.roots import first_exit, horner
from drivetool.drive.kernel.series import carry, series

NOISE = 1e-13  # rounding error of a guard, as a share of the terms that it is the sum of
MOST = 60  # events in one part of a sample, after which the mode is kept: no endless chatter


@njit(**COMPILE)
def contact_guard(spring, reach, side, sign, w, p):
    """Polynomial sign * (spring x(t) - side reach)."""
    for k in range(p.size):
        v = 0.0
        for j in range(w.shape[1]):
            v += spring[j, 0] * w[k, j]
        p[k] = sign * v
    p[0] -= sign * side * reach


@njit(**HOT)
def stick_guard(net, u, level, side, w, p):
    """Polynomial level - side * (torque on the sticking body)."""
    nx = w.shape[1]
    for k in range(p.size):
        v = 0.0
        for j in range(nx):
            v += net[j] * w[k, j]
        p[k] = -side * v
    v = net[nx + u.size]
    for j in range(u.size):
        v += net[nx + j] * u[j]
    p[0] += level - side * v


@njit(**HOT)
def sum_of_sizes(row, x, u):
    """What rounding errors of row [x, u, 1] are in proportion to."""
    v = abs(row[x.size + u.size])
    for j in range(x.size):
        v += abs(row[j] * x[j])
    for j in range(u.size):
        v += abs(row[x.size + j] * u[j])
    return v


@njit(**HOT)
def next_event(s, hold, net, mode, x, u, w, p, end, fresh):
    """(time, element, new digit) of the earliest event, element -1 if there is none.

    `fresh` has a bit for every element that has switched at this very moment.
    """
    te, element, digit = end, -1, 0
    for g in range(s.ng):
        new_one = (fresh >> g) & 1 == 1
        noise = s.reach[g, 0]
        for j in range(s.nx):
            noise += abs(s.spring[g, j, 0] * x[j])
        for side in (1.0, -1.0):
            # In contact one guard counts, in the gap both do.
            if mode[g] == 1:
                contact_guard(s.spring[g], s.reach[g, 0], side, -side, w, p)
                new = 0 if side > 0.0 else 2
            elif side == 1.0 - mode[g]:
                contact_guard(s.spring[g], s.reach[g, 0], side, side, w, p)
                new = 1
            else:
                continue
            t = first_exit(p, te, new_one, end, NOISE * noise)
            if t >= 0.0:
                te, element, digit = t, g, new
    for f in range(s.nf):
        e, row, level = s.ng + f, s.slip_rows[f], hold[f, 0]
        new_one = (fresh >> e) & 1 == 1
        noise = NOISE * (level + sum_of_sizes(net[f], x, u))
        if mode[e] != 1:
            for j in range(p.size):
                p[j] = (1.0 - mode[e]) * w[j, row]
            t = first_exit(p, te, new_one, end, noise / s.mass[row, 0] * end)
            if t >= 0.0:
                te, element, digit = t, e, 1
        else:
            for side in (1.0, -1.0):
                stick_guard(net[f], u, level, side, w, p)
                t = first_exit(p, te, new_one, end, noise)
                if t >= 0.0:
                    te, element, digit = t, e, 0 if side > 0.0 else 2
    return te, element, digit


@njit(**COMPILE)
def load_on(net, x, u):
    """Torque on a body without its Coulomb friction."""
    nx = x.size
    v = net[nx + u.size]
    for j in range(nx):
        v += net[j] * x[j]
    for j in range(u.size):
        v += net[nx + j] * u[j]
    return v


@njit(**HOT)
def switch(s, hold, net, mode, x, u, big, element, digit):
    """Change the mode at an event and apply the saltation."""
    f = element - s.ng
    if f < 0 or mode[element] == 1:
        mode[element] = digit
        return
    row, side, level = s.slip_rows[f], 1.0 - mode[element], hold[f, 0]
    x[row] = 0.0
    load = load_on(net[f], x, u)
    if side * load >= -level:
        # Also where a load in the direction of motion tops the level by a rounding error.
        mode[element] = 1
        factor = 0.0
    else:
        mode[element] = 2 - mode[element]
        # The body goes on through zero: its acceleration jumps from load - side Tc to load + side Tc.
        factor = (load + side * level) / (load - side * level)
    for q in range(big.shape[1]):
        big[row, q] *= factor


@njit(**COMPILE)
def release(s, hold, net, x, u, mode):
    """Let go the bodies that friction cannot hold any more; returns whether there are any."""
    found = False
    for f in range(s.nf):
        if mode[s.ng + f] == 1:
            load = load_on(net[f], x, u)
            if abs(load) > hold[f, 0]:
                mode[s.ng + f] = 0 if load > 0.0 else 2
                found = True
    return found


@njit(**HOT)
def unlocated_step(s, c, x, u, i, big, mode, part, k, h):
    """A stretch in a mode too fast for the record: exact in that mode, which is chosen anew after."""
    to = c.rate.size - 1
    if release(s, c.hold, c.net[k], x, u[i], mode):
        k = lookup(s, c, mode, part)
    work_out(c.work_out, s, c, mode, part, k, h)
    predict(c.leap, to, x, u, i, c.vectors[1])
    propagate_any(c.leap, c.dleap, to, x, u, i, big, s.nx, c.columns[0])
    for r in range(s.nx):
        x[r] = c.vectors[1, r]
        for q in range(big.shape[1]):
            big[r, q] = c.columns[0, r, q]
    come_to_rest(s, c.hold, c.net[k], x, u[i], big, mode)
    guard_values(s.spring, s.slip_rows, x, c.guards)
    classify(s.reach, c.guards, mode)


@njit(**COMPILE)
def come_to_rest(s, hold, net, x, u, big, mode):
    """Stop the bodies whose speed has changed its sign where friction holds them.

    Their friction is that of the old direction still: left to slide, they would turn back in every sample.
    """
    for f in range(s.nf):
        row, digit = s.slip_rows[f], mode[s.ng + f]
        if digit != 1 and (1.0 - digit) * x[row] < 0.0:
            speed = x[row]
            x[row] = 0.0
            if abs(load_on(net[f], x, u)) > hold[f, 0]:
                x[row] = speed
            else:
                for q in range(big.shape[1]):
                    big[row, q] = 0.0


@unit(SYSTEM, CACHE, REALS[1], REALS[2], WHOLE, REALS[2], WHOLES[1], WHOLE)
def rough_step(s, c, x, inputs, i, big, mode, part):
    """Carry x, sensitivities and mode over one part of a sample under inputs[i]."""
    w, p, v, t = c.series, c.poly, c.columns[1], c.columns[2]
    u, rest, events, fresh = inputs[i], s.spans[part], 0, 0
    for f in range(s.nf):
        if mode[s.ng + f] == 1:
            for q in range(big.shape[1]):
                big[s.slip_rows[f], q] = 0.0
    while rest > 0.0:
        k = lookup(s, c, mode, part)
        a, net = c.flow[k], c.net[k]
        if not c.rate[k] * rest < STIFF:
            unlocated_step(s, c, x, inputs, i, big, mode, part, k, rest)
            break
        te, element, digit = min(rest, 0.5 / max(c.rate[k], 1e-300)), -1, 0
        series(a, x, u, w)
        if events < MOST:
            te, element, digit = next_event(s, c.hold, net, mode, x, u, w, p, te, fresh)
        if te > 0.0:
            if big.shape[1] > 0:
                carry(a, u, big, w, v, t, te)
            for r in range(s.nx):
                x[r] = horner(w[:, r], te)
            fresh = 0
        rest = rest - te if te < rest else 0.0
        if element >= 0:
            switch(s, c.hold, net, mode, x, u, big, element, digit)
            fresh |= 1 << element
            events += 1


@unit(SYSTEM, CACHE, REALS[1], REALS[1], REALS[1], REALS[2], WHOLES[1], WHOLE)
def switch_late(s, c, x, u, late, big, mode, k):
    """Saltation where the held torque switches inside a sample, at the dead time.

    k  slot of the mode, or -1
    """
    if k < 0:
        k = lookup(s, c, mode, 0)
    jump = c.vectors[1]
    for r in range(s.nx):
        jump[r] = 0.0
        for j in range(s.nu):
            jump[r] += c.flow[k, r, s.nx + j, 0] * (late[j] - u[j])
    if s.nf > 0 and release(s, c.hold, c.net[k], x, u, mode):
        # The switch lets a body go: its acceleration begins here too.
        for r in range(s.nx):
            jump[r] = load_on(c.flow[k, r, :, 0], x, late)
        k = lookup(s, c, mode, 0)
        for r in range(s.nx):
            jump[r] -= load_on(c.flow[k, r, :, 0], x, u)
    for r in range(s.nx):
        for q in range(min(s.nq, big.shape[1])):
            big[r, q] += jump[r] * s.delay[q]
