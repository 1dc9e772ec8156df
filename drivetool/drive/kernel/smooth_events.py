"""A part of a sample with smooth torques in which a contact or a friction changes its mode."""

from __future__ import annotations

from numba import njit

from drivetool.drive.arrays import SERIES_ORDER
from drivetool.drive.compile import (
    CACHE,
    COMPILE,
    LAWS,
    NO_OVERLAP,
    REAL,
    REALS,
    SYSTEM,
    WHOLE,
    WHOLES,
    as_unit,
)
from drivetool.drive.kernel.events import (
    MAX_EVENTS_PER_PART,
    close_relaxed_gap,
    net_load,
    next_event,
    switch_mode,
    unlocated_step,
)
from drivetool.drive.kernel.laws import law_at, set_holding_torque
from drivetool.drive.kernel.modes import MAX_LOCATED_RATE, lookup
from drivetool.drive.kernel.roots import horner
from drivetool.drive.kernel.smooth import solve, torque_row

# Fixed-point iterations before the stretch is halved. A choice: halving is cheaper than slow convergence.
MAX_COLLOCATION_ITERATIONS = 12
# Relative change of the torques at convergence. A choice: below the error of the parabolas, above rounding.
COLLOCATION_TOLERANCE = 1e-10
# Fraction of a part below which a stretch is not halved further, converged or not. Faster changes leave no trace in
# the record, and the step would take unbounded time at an extreme trial value of a fit.
MIN_STRETCH_FRACTION = 0.02
# Halved stretches in one part, after which the torques are held over the rest. A choice: it bounds the run time.
MAX_SHORTENED_STRETCHES = 12
# A state in SI units beyond which the torques are held: no drive reaches it, the trial value of the fit is wrong.
DIVERGED_STATE = 1e12


@njit(**COMPILE)
def law_series(a, x, u, first, w):
    """Power series of the state: w (SERIES_ORDER + 1, nx); a law's states are value, slope and curvature."""
    nx = x.size
    for k in range(SERIES_ORDER + 1):
        for r in range(first, nx):
            w[k, r] = 0.0
    for r in range(nx):
        w[0, r] = x[r]
    for at in range(first, nx, 3):
        w[1, at], w[1, at + 1], w[2, at] = x[at + 1], x[at + 2], 0.5 * x[at + 2]
    for k in range(1, SERIES_ORDER + 1):
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
    n, nl, jets = laws.first, laws.code.size, laws.torque_jets
    for _ in range(MAX_COLLOCATION_ITERATIONS):
        law_series(a, x, u, n, w)
        done = True
        for node in range(2):
            t = 0.5 * h if node == 0 else h
            for r in range(n):
                y[r] = horner(w[:, r], t)
            for m in range(nl):
                law_at(laws, m, y, time + t, mode, s.ng, jets[1 + node, m])
        for m in range(nl):
            at = n + 3 * m
            middle = x[at] + 0.5 * h * (x[at + 1] + 0.25 * h * x[at + 2])
            last = x[at] + h * (x[at + 1] + 0.5 * h * x[at + 2])
            size = abs(jets[0, m, 0]) + abs(jets[1, m, 0]) + abs(jets[2, m, 0]) + 1e-30
            if not abs(jets[1, m, 0] - middle) + abs(jets[2, m, 0] - last) <= COLLOCATION_TOLERANCE * size:
                done = False
                middle, last = jets[1, m, 0], jets[2, m, 0]
                x[at + 1] = (4.0 * middle - 3.0 * x[at] - last) / h
                x[at + 2] = 4.0 * (x[at] - 2.0 * middle + last) / (h * h)
        if done:
            return True
    return False


@njit(**COMPILE)
def hold_start_torques(s, laws, x, time, mode):
    """Torques at the start of a stretch, held constant as the initial guess."""
    for m in range(laws.code.size):
        at = laws.first + 3 * m
        law_at(laws, m, x, time, mode, s.ng, laws.torque_jets[0, m])
        x[at] = laws.torque_jets[0, m, 0]
        x[at + 1] = x[at + 2] = 0.0


@njit(**COMPILE)
def start_torque_columns(s, laws, x, mode, sens):
    """Row of the torque of each law at the start."""
    for m in range(laws.code.size):
        torque_row(laws, m, mode, s.nq, x, laws.torque_jets[0, m], sens, sens[laws.first + 3 * m], laws.first)


@njit(**NO_OVERLAP)
def with_torque_columns(sens, first, h, wide):
    """wide = sens, then a column for the torque of each law at the middle and at the end of h seconds."""
    nx, ns = sens.shape
    nl = (nx - first) // 3
    for r in range(nx):
        for q in range(ns, ns + 2 * nl):
            wide[r, q] = 0.0
    for r in range(first):
        for q in range(ns):
            wide[r, q] = sens[r, q]
    for m in range(nl):
        at = first + 3 * m
        for q in range(ns):
            wide[at, q] = sens[at, q]
            wide[at + 1, q] = -3.0 / h * sens[at, q]
            wide[at + 2, q] = 4.0 / (h * h) * sens[at, q]
        wide[at + 1, ns + m], wide[at + 2, ns + m] = 4.0 / h, -8.0 / (h * h)
        wide[at + 1, ns + nl + m], wide[at + 2, ns + nl + m] = -1.0 / h, 4.0 / (h * h)


@njit(**NO_OVERLAP)
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
def propagate_to_nodes(a, u, nq, first, w, v, t, h, share, nodes):
    """nodes[0..2] (nx, ns) = the columns v after h/2, h and share h: one power series, summed up three times.

    nq  leading columns, which also have the source dA z; v and t are overwritten
    """
    nx, ns = v.shape
    for r in range(first):
        for q in range(ns):
            for node in range(3):
                nodes[node, r, q] = v[r, q]
    power, half, part = 1.0, 1.0, 1.0
    for n in range(SERIES_ORDER):
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
            add_to_sums(nodes[0, r], nodes[1, r], nodes[2, r], half, part, t[r])
        v, t = t, v
        power *= h


@njit(**NO_OVERLAP)
def add_to_sums(middle, end, there, half, part, term):
    """Add a term of the series to the three sums (ns,)."""
    for q in range(term.size):
        middle[q] += half * term[q]
        end[q] += term[q]
        there[q] += part * term[q]


@njit(**COMPILE)
def stretch_columns(s, c, laws, a, x, u, time, h, te, mode, sens):
    """Sensitivities over the first te of a stretch of h seconds whose parabolas are known."""
    n, nl, ns, w = laws.first, laws.code.size, sens.shape[1], c.series
    right, weight, nodes = laws.torque_columns, laws.newton_matrix, laws.nodes
    start_torque_columns(s, laws, x, mode, sens)
    with_torque_columns(sens, n, h, laws.term[0])
    propagate_to_nodes(a, u, s.nq, n, w, laws.term[0], laws.term[1], h, te / h, nodes)
    for node in range(2):
        t = 0.5 * h if node == 0 else h
        for r in range(n):
            c.vectors[3, r] = horner(w[:, r], t)
        for m in range(nl):
            i, slope = node * nl + m, laws.slopes[m]
            torque_row(laws, m, mode, s.nq, c.vectors[3], laws.torque_jets[1 + node, m], nodes[node], right[i], n)
            for j in range(2 * nl):
                weight[i, j] = 1.0 if i == j else 0.0
                for r in range(n):
                    weight[i, j] -= slope[r] * nodes[node, r, ns + j]
    solve(weight, laws.matrix_scratch, right, ns, 2 * nl)
    for r in range(n):
        for q in range(ns):
            sens[r, q] = nodes[2, r, q]
        for j in range(2 * nl):
            f = nodes[2, r, ns + j]
            for q in range(ns):
                sens[r, q] += f * right[j, q]


@njit(**COMPILE)
def constant_torque_columns(s, laws, x, mode, sens):
    """Sensitivities of torques taken as constant over a part."""
    start_torque_columns(s, laws, x, mode, sens)
    for r in range(laws.code.size):
        at = laws.first + 3 * r
        for q in range(sens.shape[1]):
            sens[at + 1, q] = sens[at + 2, q] = 0.0


@as_unit(SYSTEM, CACHE, LAWS, REALS[1], REALS[2], WHOLE, REAL, REALS[2], WHOLES[1], WHOLE)
def step_through_law_events(s, c, laws, x, inputs, i, time, sens, mode, part):
    """Carry x, sensitivities and mode over one part of a sample under inputs[i]."""
    w, p, u = c.series, c.poly, inputs[i]
    whole, rest, events, just_switched, shortened = s.part_lengths[part], s.part_lengths[part], 0, 0, 0
    longest = whole  # stretch that may converge
    for r in range(s.nx):
        if not abs(x[r]) < DIVERGED_STATE:
            shortened = MAX_SHORTENED_STRETCHES + 1  # it has diverged: the torques are not solved for
    for f in range(s.nf):
        if mode[s.ng + f] == 1:
            for q in range(sens.shape[1]):
                sens[s.slip_rows[f], q] = 0.0
    while rest > 0.0:
        set_holding_torque(s, c, laws, time)
        k = lookup(s, c, mode, part)
        a, net = c.a_matrix[k], c.net_torque[k]
        hold_start_torques(s, laws, x, time, mode)
        if not c.rate[k] * rest < MAX_LOCATED_RATE or shortened > MAX_SHORTENED_STRETCHES:
            constant_torque_columns(s, laws, x, mode, sens)
            unlocated_step(s, c, x, inputs, i, sens, mode, part, k, rest)
            break
        h, element, digit = min(rest, longest, 0.5 / max(c.rate[k], 1e-300)), -1, 0
        while not collocate(s, laws, a, x, u, time, h, mode, w, c.vectors[3]) and h > MIN_STRETCH_FRACTION * whole:
            h *= 0.5
            longest = h
            shortened += 1
            hold_start_torques(s, laws, x, time, mode)
        te = h
        if events < MAX_EVENTS_PER_PART:
            te, element, digit = next_event(s, c.holding_torque, net, mode, x, u, w, p, h, just_switched)
        if te > 0.0:
            if sens.shape[1] > 0:
                stretch_columns(s, c, laws, a, x, u, time, h, te, mode, sens)
            for r in range(s.nx):
                x[r] = horner(w[:, r], te)
            just_switched = 0
        rest = rest - te if te < rest else 0.0
        time += te
        if element >= 0:
            if element < s.ng and digit != 1 and s.relaxing[element, 0] >= 0:
                close_relaxed_gap(s, c, k, element, 1.0 - digit, mode, x, u, sens)
            side, dropped = 1.0 - mode[element], remove_friction_laws(s, laws, element, x)
            switch_mode(s, c.holding_torque, net, mode, x, u, sens, element, digit)
            if element >= s.ng and side * (1.0 - mode[element]) < 0.0:
                correct_saltation(s, c.holding_torque, net, element - s.ng, side, dropped, x, u, sens)
            just_switched |= 1 << element
            events += 1
    for at in range(laws.first, s.nx, 3):
        x[at + 1] = x[at + 2] = x[at]  # the next part steps over torques at start, middle and end


@njit(**COMPILE)
def remove_friction_laws(s, laws, element, x):
    """Subtract a friction's laws from the torque on its body: the holding torque has them. Returns their sum."""
    total = 0.0
    for m in range(laws.code.size):
        if laws.friction[m] >= 0 and s.ng + laws.friction[m] == element:
            total += x[laws.first + 3 * m]
            x[laws.first + 3 * m] = 0.0
    return total


@njit(**COMPILE)
def correct_saltation(s, holding_torque, net, f, side, dropped, x, u, sens):
    """Correct the saltation of a body that passes zero speed: the torque of the parabola decelerated it."""
    load = net_load(net[f], x, u)
    factor = (load - side * holding_torque[f, 0]) / (load - side * s.level[f, 0] + dropped)
    for q in range(sens.shape[1]):
        sens[s.slip_rows[f], q] *= factor


@as_unit(SYSTEM, LAWS, REALS[1], REAL, WHOLES[1], REALS[2])
def write_law_torques(s, laws, x, time, mode, sens):
    """Write the torques of the laws, and their sensitivities, into the state, where an output reads them."""
    for m in range(laws.code.size):
        law_at(laws, m, x, time, mode, s.ng, laws.torque_jets[0, m])
        x[laws.first + 3 * m] = laws.torque_jets[0, m, 0]
    if sens.shape[1] > 0:
        start_torque_columns(s, laws, x, mode, sens)
