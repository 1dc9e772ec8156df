"""A part of a sample with smooth torques in which a contact or a friction changes its mode."""

from __future__ import annotations

from numba import njit

from drivetool.drive.compiled import COMPILE, unit
from drivetool.drive.events import MOST, load_on, next_event, switch, unlocated_step
from drivetool.drive.laws import law_at, set_hold
from drivetool.drive.modes import STIFF, lookup
from drivetool.drive.roots import horner
from drivetool.drive.series import next_term, series
from drivetool.drive.smooth import ROUNDS, agree, eliminate, node_equations, parabola, response, start_columns
from drivetool.drive.system import CACHE, LAWS, ORDER, SYSTEM
from drivetool.drive.table import REAL, REALS, WHOLE, WHOLES

# Share of a part below which a stretch is not cut any further, converged or not: what changes faster
# leaves no trace in the record, and a trial value of a fit must not take for ever.
SHORTEST = 0.02
PATIENCE = 12  # stretches cut short in one part, after which the torques are held over the rest
FAR = 1e12  # of a state, in SI: a trial value that leads there is wrong anyway


@njit(**COMPILE)
def collocate(s, laws, a, x, u, time, h, mode, w, y):
    """Find the parabolas over h seconds from x; w gets the power series. Returns whether it converged."""
    n, nl, found = laws.first, laws.code.size, laws.found
    for _ in range(ROUNDS):
        series(a, x, u, w)
        done = True
        for node in range(2):
            t = 0.5 * h if node == 0 else h
            for r in range(n):
                y[r] = horner(w[:, r], t)
            for m in range(nl):
                law_at(laws, m, y, time + t, mode, s.ng, found[1 + node, m])
        for m in range(nl):
            at = n + 3 * m
            middle = x[at] + 0.5 * h * (x[at + 1] + 0.25 * h * x[at + 2])
            last = x[at] + h * (x[at + 1] + 0.5 * h * x[at + 2])
            if not agree(found, m, middle, last):
                done = False
                parabola(x, at, x[at], found[1, m, 0], found[2, m, 0], h)
        if done:
            return True
    return False


@njit(**COMPILE)
def begin(s, laws, x, time, mode):
    """Torques at the start of a stretch, taken as constant for a first guess."""
    for m in range(laws.code.size):
        at = laws.first + 3 * m
        law_at(laws, m, x, time, mode, s.ng, laws.found[0, m])
        x[at] = laws.found[0, m, 0]
        x[at + 1] = x[at + 2] = 0.0


@njit(**COMPILE)
def carry_to(a, u, nq, big, w, v, t, h, share, nodes):
    """nodes[0..2] = big after h/2, h and share h: one power series, summed up three times.

    nq  leading columns that also have a source of their own, dA z
    """
    nx, ns = big.shape
    for r in range(nx):
        for q in range(ns):
            v[r, q] = big[r, q]
            for node in range(3):
                nodes[node, r, q] = big[r, q]
    power, half, part = 1.0, 1.0, 1.0
    for n in range(ORDER):
        next_term(a, u, nq, w, n, power, h / (n + 1), v, t)
        half *= 0.5
        part *= share
        for r in range(nx):
            for q in range(ns):
                v[r, q] = t[r, q]
                nodes[0, r, q] += half * t[r, q]
                nodes[1, r, q] += t[r, q]
                nodes[2, r, q] += part * t[r, q]
        power *= h


@njit(**COMPILE)
def first_columns(s, laws, x, mode, h, big):
    """Rows of the laws' states from the torques at the start."""
    start_columns(laws.arguments, laws.parameters, laws.half, laws.gap, laws.first, s.nq, laws.found, x, mode, h,
                  laws.slopes[0], big)


@njit(**COMPILE)
def stretch_columns(s, c, laws, a, x, u, time, h, te, mode, big):
    """Sensitivities over the first te of a stretch of h seconds whose parabolas are known."""
    n, nl, ns, w = laws.first, laws.code.size, big.shape[1], c.series
    first_columns(s, laws, x, mode, h, big)
    carry_to(a, u, s.nq, big, w, laws.term[0], laws.term[1], h, te / h, laws.nodes)
    unit = laws.unit
    for r in range(x.size):
        for q in range(3 * nl):
            unit[r, q] = 1.0 if r == n + q else 0.0
    carry_to(a, u, 0, unit, w, laws.more[0], laws.more[1], h, te / h, laws.answers)
    for node in range(2):
        t = 0.5 * h if node == 0 else h
        for r in range(n):
            c.vectors[3, r] = horner(w[:, r], t)
        node_equations(laws.arguments, laws.parameters, laws.half, laws.gap, n, s.nq, laws.found, node,
                       c.vectors[3], mode, laws.nodes[node], laws.answers, node, 0, h, laws.slopes[0],
                       laws.weight, laws.right)
    eliminate(laws.weight, laws.right, ns)
    for r in range(n):
        for q in range(ns):
            v = laws.nodes[2, r, q]
            for node in range(2):
                for m in range(nl):
                    v += response(laws.answers, 2, r, 3 * m, node, h) * laws.right[node * nl + m, q]
            big[r, q] = v


@njit(**COMPILE)
def rest_columns(s, laws, x, mode, big):
    """Sensitivities of torques taken as constant over a part."""
    first_columns(s, laws, x, mode, 1.0, big)
    for r in range(laws.code.size):
        at = laws.first + 3 * r
        for q in range(big.shape[1]):
            big[at + 1, q] = big[at + 2, q] = 0.0


@unit(SYSTEM, CACHE, LAWS, REALS[1], REALS[2], WHOLE, REAL, REALS[2], WHOLES[1], WHOLE)
def law_rough_step(s, c, laws, x, inputs, i, time, big, mode, part):
    """Carry x, sensitivities and mode over one part of a sample under inputs[i]."""
    w, p, u = c.series, c.poly, inputs[i]
    whole, rest, events, fresh, failed = s.spans[part], s.spans[part], 0, 0, 0
    for r in range(s.nx):
        if not abs(x[r]) < FAR:
            failed = PATIENCE + 1  # it has run away: no torque is worth a search
    for f in range(s.nf):
        if mode[s.ng + f] == 1:
            for q in range(big.shape[1]):
                big[s.slip_rows[f], q] = 0.0
    while rest > 0.0:
        set_hold(s, c, laws, time)
        k = lookup(s, c, mode, part)
        a, net = c.flow[k], c.net[k]
        begin(s, laws, x, time, mode)
        if not c.rate[k] * rest < STIFF or failed > PATIENCE:
            rest_columns(s, laws, x, mode, big)
            unlocated_step(s, c, x, inputs, i, big, mode, part, k, rest)
            break
        h, element, digit = min(rest, 0.5 / max(c.rate[k], 1e-300)), -1, 0
        while not collocate(s, laws, a, x, u, time, h, mode, w, c.vectors[3]) and h > SHORTEST * whole:
            h *= 0.5
            failed += 1
            begin(s, laws, x, time, mode)
        te = h
        if events < MOST:
            te, element, digit = next_event(s, c.hold, net, mode, x, u, w, p, h, fresh)
        if te > 0.0:
            if big.shape[1] > 0:
                stretch_columns(s, c, laws, a, x, u, time, h, te, mode, big)
            for r in range(s.nx):
                x[r] = horner(w[:, r], te)
            fresh = 0
        rest = rest - te if te < rest else 0.0
        time += te
        if element >= 0:
            side, dropped = 1.0 - mode[element], drop_friction(s, laws, element, x)
            switch(s, c.hold, net, mode, x, u, big, element, digit)
            if element >= s.ng and side * (1.0 - mode[element]) < 0.0:
                as_it_came(s, c.hold, net, element - s.ng, side, dropped, x, u, big)
            fresh |= 1 << element
            events += 1
    for m in range(laws.code.size):
        at = laws.first + 3 * m
        x[at + 1] = x[at + 2] = 0.0


@njit(**COMPILE)
def drop_friction(s, laws, element, x):
    """Take the laws of a friction off the torque on its body, as `hold` has them; returns their sum."""
    total = 0.0
    for m in range(laws.code.size):
        if laws.friction[m] >= 0 and s.ng + laws.friction[m] == element:
            total += x[laws.first + 3 * m]
            x[laws.first + 3 * m] = 0.0
    return total


@njit(**COMPILE)
def as_it_came(s, hold, net, f, side, dropped, x, u, big):
    """Mend the saltation of a body that goes on through zero: the parabola's torque is what slowed it."""
    load = load_on(net[f], x, u)
    factor = (load - side * hold[f, 0]) / (load - side * s.level[f, 0] + dropped)
    for q in range(big.shape[1]):
        big[s.slip_rows[f], q] *= factor


@unit(SYSTEM, LAWS, REALS[1], REAL, WHOLES[1], REALS[2])
def show(s, laws, x, time, mode, big):
    """Put the torques of the laws, and their sensitivities, where an output can read them."""
    for m in range(laws.code.size):
        law_at(laws, m, x, time, mode, s.ng, laws.found[0, m])
        x[laws.first + 3 * m] = laws.found[0, m, 0]
    if big.shape[1] > 0:
        first_columns(s, laws, x, mode, 1.0, big)
