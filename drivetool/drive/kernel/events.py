"""A step in which a contact closes or opens, or a body stops or breaks away.

Inside a mode the state is a power series in time, and every guard is a scalar polynomial of time. The earliest root
among the guards ends the stretch and the mode changes. The saltation matrix carries the sensitivities across. Gap
laws are continuous at the contact, and so is breakaway: the saltation differs from the identity only where a body
comes to rest or reverses without resting.
"""

from __future__ import annotations

import math

from numba import njit

from drivetool.drive.compile import CACHE, COMPILE, INLINED, REALS, SYSTEM, WHOLE, WHOLES, as_unit
from drivetool.drive.kernel.exact_step import classify, guard_values, predict, propagate_rows
from drivetool.drive.kernel.modes import MAX_LOCATED_RATE, compute_mode, lookup
from drivetool.drive.kernel.roots import first_exit, horner
from drivetool.drive.kernel.series import propagate_sensitivities, series

# Rounding error of a guard relative to the sum of the magnitudes of its terms: a thousand unit roundoffs.
GUARD_ROUNDING = 1e-13
# Events in one part of a sample, after which the mode is kept. A choice: it bounds chattering.
MAX_EVENTS_PER_PART = 60


@njit(**COMPILE)
def contact_guard(spring, reach, side, sign, w, p):
    """Polynomial sign * (spring x(t) - side reach)."""
    for k in range(p.size):
        v = 0.0
        for j in range(w.shape[1]):
            v += spring[j, 0] * w[k, j]
        p[k] = sign * v
    p[0] -= sign * side * reach


@njit(**INLINED)
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


@njit(**INLINED)
def rounding_scale(row, x, u):
    """Sum of magnitudes of row [x, u, 1], to which its rounding errors are proportional."""
    v = abs(row[x.size + u.size])
    for j in range(x.size):
        v += abs(row[j] * x[j])
    for j in range(u.size):
        v += abs(row[x.size + j] * u[j])
    return v


@njit(**INLINED)
def next_event(s, holding_torque, net, mode, x, u, w, p, end, just_switched):
    """(time, element, new digit) of the earliest event, element -1 if there is none.

    `just_switched` has a bit for every element that has switched at this instant.
    """
    te, element, digit = end, -1, 0
    for g in range(s.ng):
        switched_now = (just_switched >> g) & 1 == 1
        rounding = s.reach[g, 0]
        for j in range(s.nx):
            rounding += abs((s.open_guard[g, j, 0] if mode[g] == 1 else s.spring[g, j, 0]) * x[j])
        for side in (1.0, -1.0):
            # In contact one guard counts, in the gap both do.
            if mode[g] == 1:
                contact_guard(s.open_guard[g], s.reach[g, 0], side, -side, w, p)
                new = 0 if side > 0.0 else 2
            elif side == 1.0 - mode[g]:
                contact_guard(s.spring[g], s.reach[g, 0], side, side, w, p)
                new = 1
            else:
                continue
            t = first_exit(p, te, switched_now, end, GUARD_ROUNDING * rounding)
            if t >= 0.0:
                te, element, digit = t, g, new
    for f in range(s.nf):
        e, row, level = s.ng + f, s.slip_rows[f], holding_torque[f, 0]
        switched_now = (just_switched >> e) & 1 == 1
        rounding = GUARD_ROUNDING * (level + rounding_scale(net[f], x, u))
        if mode[e] != 1:
            for j in range(p.size):
                p[j] = (1.0 - mode[e]) * w[j, row]
            t = first_exit(p, te, switched_now, end, rounding / s.mass[row, 0] * end)
            if t >= 0.0:
                te, element, digit = t, e, 1
        else:
            for side in (1.0, -1.0):
                stick_guard(net[f], u, level, side, w, p)
                t = first_exit(p, te, switched_now, end, rounding)
                if t >= 0.0:
                    te, element, digit = t, e, 0 if side > 0.0 else 2
    return te, element, digit


@njit(**COMPILE)
def net_load(net, x, u):
    """Torque on a body without its Coulomb friction."""
    nx = x.size
    v = net[nx + u.size]
    for j in range(nx):
        v += net[j] * x[j]
    for j in range(u.size):
        v += net[nx + j] * u[j]
    return v


@njit(**INLINED)
def switch_mode(s, holding_torque, net, mode, x, u, sens, element, digit):
    """Change the mode at an event and apply the saltation."""
    f = element - s.ng
    if f < 0 or mode[element] == 1:
        mode[element] = digit
        return
    row, side, level = s.slip_rows[f], 1.0 - mode[element], holding_torque[f, 0]
    x[row] = 0.0
    load = net_load(net[f], x, u)
    if side * load >= -level:
        # Also where a load in the direction of motion tops the level by a rounding error.
        mode[element] = 1
        factor = 0.0
    else:
        mode[element] = 2 - mode[element]
        # The body goes on through zero: its acceleration jumps from load - side Tc to load + side Tc.
        factor = (load + side * level) / (load - side * level)
    for q in range(sens.shape[1]):
        sens[row, q] *= factor


@njit(**COMPILE)
def release_bodies(s, holding_torque, net, x, u, mode):
    """Release the bodies that friction cannot hold any more; returns whether there are any."""
    found = False
    for f in range(s.nf):
        if mode[s.ng + f] == 1:
            load = net_load(net[f], x, u)
            if abs(load) > holding_torque[f, 0]:
                mode[s.ng + f] = 0 if load > 0.0 else 2
                found = True
    return found


@njit(**COMPILE)
def follow_contacts(s, mode, x, sens):
    """Set the elastic twists of the gaps in contact, the twists beyond the half gap, and their columns."""
    for g in range(s.ng):
        e, twist, side = s.relaxing[g, 0], s.relaxing[g, 1], 1.0 - mode[g]
        if e >= 0 and side != 0.0:
            stiffness = s.open_guard[g, twist, 0]
            half = s.reach[g, 0] / stiffness
            x[e] = x[twist] - side * half
            for q in range(sens.shape[1]):
                sens[e, q] = sens[twist, q]
                if q < s.nq:
                    sens[e, q] -= side * (s.reach[g, q + 1] - half * s.open_guard[g, twist, q + 1]) / stiffness


@njit(**COMPILE)
def started_torque(s, holding_torque, net, mode, row, torque, x, u):
    """What a torque that starts at once adds to that on a body: all of it, or what friction does not hold."""
    for f in range(s.nf):
        if s.slip_rows[f] == row and mode[s.ng + f] == 1:
            load = net_load(net[f], x, u) + torque
            return math.copysign(max(abs(load) - holding_torque[f, 0], 0.0), load)
    return torque


@njit(**COMPILE)
def close_relaxed_gap(s, c, k, g, side, mode, x, u, sens):
    """Saltation where a gap closes whose shaft has relaxed: the torque of its damping starts at once.

    k  slot of the mode in the gap
    """
    a, shift = c.a_matrix[k], c.gradient
    e, rate, jump = s.relaxing[g, 0], 0.0, -side * s.reach[g, 0]
    for j in range(s.nx):
        if s.open_guard[g, j, 0] != 0.0:
            rate += s.open_guard[g, j, 0] * net_load(a[j, :, 0], x, u)
        jump += s.spring[g, j, 0] * x[j]
    for q in range(sens.shape[1]):
        v = 0.0
        for j in range(s.nx):
            v += s.open_guard[g, j, 0] * sens[j, q]
            if q < s.nq:
                v += s.open_guard[g, j, q + 1] * x[j]
        if q < s.nq:
            v -= side * s.reach[g, q + 1]
        shift[q] = -v / rate
    for end in range(2):
        row = s.gap_rows[g, end]
        torque = started_torque(s, c.holding_torque, c.net_torque[k], mode, row, s.gap_gain[g, end, 0] * jump, x, u)
        for q in range(sens.shape[1]):
            sens[row, q] -= torque / s.mass[row, 0] * shift[q]
    for q in range(sens.shape[1]):  # its own rate becomes that of the twist
        sens[e, q] -= rate / s.open_guard[g, s.relaxing[g, 1], 0] * shift[q]


@njit(**INLINED)
def unlocated_step(s, c, x, u, i, sens, mode, part, k, h):
    """A stretch in a mode too fast for the sampling: exact in that mode, which is re-determined at its end."""
    to = c.rate.size - 1
    if release_bodies(s, c.holding_torque, c.net_torque[k], x, u[i], mode):
        k = lookup(s, c, mode, part)
    compute_mode(c.compute_mode, s, c, mode, part, k, h)
    predict(c.phi, to, x, u, i, c.vectors[1])
    propagate_rows(c.phi, c.dphi, to, x, u, i, sens, s.nx, c.columns[0])
    for r in range(s.nx):
        x[r] = c.vectors[1, r]
        for q in range(sens.shape[1]):
            sens[r, q] = c.columns[0, r, q]
    stop_reversed_bodies(s, c.holding_torque, c.net_torque[k], x, u[i], sens, mode)
    guard_values(s, mode, x, c.guards)
    classify(s.reach, c.guards, mode)
    follow_contacts(s, mode, x, sens)


@njit(**COMPILE)
def stop_reversed_bodies(s, holding_torque, net, x, u, sens, mode):
    """Stop the bodies whose speed has changed sign and which friction holds.

    Their friction still has the old direction: without the stop they would reverse in every sample.
    """
    for f in range(s.nf):
        row, digit = s.slip_rows[f], mode[s.ng + f]
        if digit != 1 and (1.0 - digit) * x[row] < 0.0:
            speed = x[row]
            x[row] = 0.0
            if abs(net_load(net[f], x, u)) > holding_torque[f, 0]:
                x[row] = speed
            else:
                for q in range(sens.shape[1]):
                    sens[row, q] = 0.0


@as_unit(SYSTEM, CACHE, REALS[1], REALS[2], WHOLE, REALS[2], WHOLES[1], WHOLE)
def step_through_events(s, c, x, inputs, i, sens, mode, part):
    """Carry x, sensitivities and mode over one part of a sample under inputs[i]."""
    w, p, v, t = c.series, c.poly, c.columns[1], c.columns[2]
    u, rest, events, just_switched = inputs[i], s.part_lengths[part], 0, 0
    for f in range(s.nf):
        if mode[s.ng + f] == 1:
            for q in range(sens.shape[1]):
                sens[s.slip_rows[f], q] = 0.0
    while rest > 0.0:
        k = lookup(s, c, mode, part)
        a, net = c.a_matrix[k], c.net_torque[k]
        if not c.rate[k] * rest < MAX_LOCATED_RATE:
            unlocated_step(s, c, x, inputs, i, sens, mode, part, k, rest)
            break
        te, element, digit = min(rest, 0.5 / max(c.rate[k], 1e-300)), -1, 0
        series(a, x, u, w)
        if events < MAX_EVENTS_PER_PART:
            te, element, digit = next_event(s, c.holding_torque, net, mode, x, u, w, p, te, just_switched)
        if te > 0.0:
            if sens.shape[1] > 0:
                propagate_sensitivities(a, u, sens, w, v, t, te)
            for r in range(s.nx):
                x[r] = horner(w[:, r], te)
            just_switched = 0
        rest = rest - te if te < rest else 0.0
        if element >= 0:
            if element < s.ng and digit != 1 and s.relaxing[element, 0] >= 0:
                close_relaxed_gap(s, c, k, element, 1.0 - digit, mode, x, u, sens)
            switch_mode(s, c.holding_torque, net, mode, x, u, sens, element, digit)
            just_switched |= 1 << element
            events += 1


@as_unit(SYSTEM, CACHE, REALS[1], REALS[1], REALS[1], REALS[2], WHOLES[1], WHOLE)
def switch_late(s, c, x, u, late, sens, mode, k):
    """Saltation where the held torque switches inside a sample, at the dead time.

    k  slot of the mode, or -1
    """
    if k < 0:
        k = lookup(s, c, mode, 0)
    jump = c.vectors[1]
    for r in range(s.nx):
        jump[r] = 0.0
        for j in range(s.nu):
            jump[r] += c.a_matrix[k, r, s.nx + j, 0] * (late[j] - u[j])
    if s.nf > 0 and release_bodies(s, c.holding_torque, c.net_torque[k], x, u, mode):
        # The switch releases a body: its acceleration starts here too.
        for r in range(s.nx):
            jump[r] = net_load(c.a_matrix[k, r, :, 0], x, late)
        k = lookup(s, c, mode, 0)
        for r in range(s.nx):
            jump[r] -= net_load(c.a_matrix[k, r, :, 0], x, u)
    for r in range(s.nx):
        for q in range(min(s.nq, sens.shape[1])):
            sens[r, q] += jump[r] * s.dead_time_gradient[q]
