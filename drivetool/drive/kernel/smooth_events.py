"""A part of a sample with smooth torques in which a contact or a friction changes its mode."""

from __future__ import annotations

from numba import njit

from drivetool.drive.arrays import ORDER
from drivetool.drive.compile import APART, CACHE, COMPILE, LAWS, REAL, REALS, SYSTEM, WHOLE, WHOLES, unit
from drivetool.drive.kernel.events import MOST, load_on, next_event, switch, unlocated_step
from drivetool.drive.kernel.laws import law_at, set_hold
from drivetool.drive.kernel.modes import STIFF, lookup
from drivetool.drive.kernel.roots import horner
from drivetool.drive.kernel.smooth import solve, torque_row

ROUNDS = 12  # of the fixed point, after which shorter stretches are taken
CLOSE = 1e-10  # relative change of the torques at which it has converged
# Share of a part below which a stretch is not cut any further, converged or not: what changes faster
# leaves no trace in the record, and a trial value of a fit must not take for ever.
SHORTEST = 0.02
PATIENCE = 12  # stretches cut short in one part, after which the torques are held over the rest
FAR = 1e12  # of a state, in SI: a trial value that leads there is wrong anyway


@njit(**COMPILE)
def law_series(a, x, u, first, w):
    """Power series of the state: w (ORDER + 1, nx); value, slope and bend of a law feed one another."""
    nx = x.size
    for k in range(ORDER + 1):
        for r in range(first, nx):
            w[k, r] = 0.0
    for r in range(nx):
        w[0, r] = x[r]
    for at in range(first, nx, 3):
        w[1, at], w[1, at + 1], w[2, at] = x[at + 1], x[at + 2], 0.5 * x[at + 2]
    for k in range(1, ORDER + 1):
        share = 1.0 / k
        for r in range(first):
            v = 0.0
            for j in range(first):
                v += a[r, j, 0] * w[k - 1, j]
            for at in range(first, nx, 3):
                v += a[r, at, 0] * w[k - 1, at]
            if k == 1:
                v += a[r, nx + u.size, 0]
                for j in range(u.size):
                    v += a[r, nx + j, 0] * u[j]
            w[k, r] = v * share


@njit(**COMPILE)
def collocate(s, laws, a, x, u, time, h, mode, w, y):
    """Find the parabolas over h seconds from x; w gets the power series. Returns whether it converged."""
    n, nl, found = laws.first, laws.code.size, laws.found
    for _ in range(ROUNDS):
        law_series(a, x, u, n, w)
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
            size = abs(found[0, m, 0]) + abs(found[1, m, 0]) + abs(found[2, m, 0]) + 1e-30
            if not abs(found[1, m, 0] - middle) + abs(found[2, m, 0] - last) <= CLOSE * size:
                done = False
                middle, last = found[1, m, 0], found[2, m, 0]
                x[at + 1] = (4.0 * middle - 3.0 * x[at] - last) / h
                x[at + 2] = 4.0 * (x[at] - 2.0 * middle + last) / (h * h)
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
def start_columns(s, laws, x, mode, big):
    """Row of the torque of each law at the start."""
    for m in range(laws.code.size):
        torque_row(laws, m, mode, s.nq, x, laws.found[0, m], big, big[laws.first + 3 * m], laws.first)


@njit(**APART)
def widened(big, first, h, wide):
    """wide = big, and behind it a column for the torque of each law at the middle and at the end of h seconds."""
    nx, ns = big.shape
    nl = (nx - first) // 3
    for r in range(nx):
        for q in range(ns, ns + 2 * nl):
            wide[r, q] = 0.0
    for r in range(first):
        for q in range(ns):
            wide[r, q] = big[r, q]
    for m in range(nl):
        at = first + 3 * m
        for q in range(ns):
            wide[at, q] = big[at, q]
            wide[at + 1, q] = -3.0 / h * big[at, q]
            wide[at + 2, q] = 4.0 / (h * h) * big[at, q]
        wide[at + 1, ns + m], wide[at + 2, ns + m] = 4.0 / h, -8.0 / (h * h)
        wide[at + 1, ns + nl + m], wide[at + 2, ns + nl + m] = -1.0 / h, 4.0 / (h * h)


@njit(**APART)
def add_term(a, nq, first, w, n, power, g, v, t):
    """t = term n + 1 of the power series of dS/dt = A S + dA z, from term n in v, but for the inputs.

    power  h^n; g: h/(n + 1)
    """
    nx, ns = v.shape
    for at in range(first, nx, 3):
        for q in range(ns):
            t[at, q], t[at + 1, q], t[at + 2, q] = g * v[at + 1, q], g * v[at + 2, q], 0.0
    for r in range(first):
        for q in range(ns):
            t[r, q] = 0.0
        for j in range(nx):
            if j < first or (j - first) % 3 == 0:
                e, f = a[r, j, 0] * g, w[n, j] * power * g
                if e != 0.0:
                    for q in range(ns):
                        t[r, q] += e * v[j, q]
                if f != 0.0:
                    for q in range(nq):
                        t[r, q] += f * a[r, j, q + 1]


@njit(**COMPILE)
def carry_to(a, u, nq, first, w, v, t, h, share, nodes):
    """nodes[0..2] (nx, ns) = the columns v after h/2, h and share h: one power series, summed up three times.

    nq  leading columns that also have a source of their own, dA z; v and t are lost
    """
    nx, ns = v.shape
    for r in range(first):
        for q in range(ns):
            for node in range(3):
                nodes[node, r, q] = v[r, q]
    power, half, part = 1.0, 1.0, 1.0
    for n in range(ORDER):
        g = h / (n + 1)
        add_term(a, nq, first, w, n, power, g, v, t)
        if n == 0:
            for r in range(first):
                for q in range(nq):
                    t[r, q] += g * a[r, nx + u.size, q + 1]
                    for j in range(u.size):
                        t[r, q] += u[j] * g * a[r, nx + j, q + 1]
        half *= 0.5
        part *= share
        for r in range(first):
            sum_up(nodes[0, r], nodes[1, r], nodes[2, r], half, part, t[r])
        v, t = t, v
        power *= h


@njit(**APART)
def sum_up(middle, end, there, half, part, term):
    """Add a term of the series to the three sums (ns,)."""
    for q in range(term.size):
        middle[q] += half * term[q]
        end[q] += term[q]
        there[q] += part * term[q]


@njit(**COMPILE)
def stretch_columns(s, c, laws, a, x, u, time, h, te, mode, big):
    """Sensitivities over the first te of a stretch of h seconds whose parabolas are known."""
    n, nl, ns, w = laws.first, laws.code.size, big.shape[1], c.series
    right, weight, nodes = laws.right, laws.weight, laws.nodes
    start_columns(s, laws, x, mode, big)
    widened(big, n, h, laws.term[0])
    carry_to(a, u, s.nq, n, w, laws.term[0], laws.term[1], h, te / h, nodes)
    for node in range(2):
        t = 0.5 * h if node == 0 else h
        for r in range(n):
            c.vectors[3, r] = horner(w[:, r], t)
        for m in range(nl):
            i, slope = node * nl + m, laws.slopes[m]
            torque_row(laws, m, mode, s.nq, c.vectors[3], laws.found[1 + node, m], nodes[node], right[i], n)
            for j in range(2 * nl):
                weight[i, j] = 1.0 if i == j else 0.0
                for r in range(n):
                    weight[i, j] -= slope[r] * nodes[node, r, ns + j]
    solve(weight, laws.spare, right, ns, 2 * nl)
    for r in range(n):
        for q in range(ns):
            big[r, q] = nodes[2, r, q]
        for j in range(2 * nl):
            f = nodes[2, r, ns + j]
            for q in range(ns):
                big[r, q] += f * right[j, q]


@njit(**COMPILE)
def rest_columns(s, laws, x, mode, big):
    """Sensitivities of torques taken as constant over a part."""
    start_columns(s, laws, x, mode, big)
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
    for at in range(laws.first, s.nx, 3):
        x[at + 1] = x[at + 2] = x[at]  # the next part steps over torques at start, middle and end


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
        start_columns(s, laws, x, mode, big)
