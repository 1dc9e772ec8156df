"""A part of a sample with smooth nonlinear torques.

Over the part each torque is the parabola through its values at the start, the middle and the end,
found by fixed-point iteration; the motion under it is exact (a collocated exponential integrator of
fourth order). Sensitivities are those of the solved equations, not of the iteration.
"""

from __future__ import annotations

from numba import njit

from drivetool.drive.compiled import COMPILE, HOT, unit
from drivetool.drive.kernel import predict, propagate_any, stays
from drivetool.drive.laws import gap_side, law_at, torque_columns
from drivetool.drive.system import CACHE, LAWS, SYSTEM
from drivetool.drive.table import REAL, REALS, WHOLE, WHOLES

ROUNDS = 12  # of the fixed point, after which shorter stretches are taken
CLOSE = 1e-10  # relative change of the torques at which it has converged


@njit(**HOT)
def parabola(x, at, first, middle, last, h):
    """Set value, slope and bend at x[at] from the torque at 0, h/2 and h."""
    x[at] = first
    x[at + 1] = (4.0 * middle - 3.0 * first - last) / h
    x[at + 2] = 4.0 * (first - 2.0 * middle + last) / (h * h)


@njit(**HOT)
def agree(found, m, middle, last):
    """Whether the torques at the middle and the end are those the motion was worked out with."""
    size = abs(found[0, m, 0]) + abs(found[1, m, 0]) + abs(found[2, m, 0]) + 1e-30
    return abs(found[1, m, 0] - middle) + abs(found[2, m, 0] - last) <= CLOSE * size


@njit(**HOT)
def law_step(s, c, laws, k, part, x, u, i, time, big, mode, b, mid):
    """Carry x and big over a part of a sample; False, and nothing moved, if an event may lie in it."""
    h, nl, n = s.spans[part], laws.code.size, laws.first
    found = laws.found
    for m in range(nl):
        at = n + 3 * m
        slope, bend = x[at + 1] + h * x[at + 2], x[at + 2]
        law_at(laws, m, x, time, mode, s.ng, found[0, m])
        x[at] = found[0, m, 0]
        x[at + 1], x[at + 2] = slope, bend
    for _ in range(ROUNDS):
        predict(c.mid, k, x, u, i, mid)
        predict(c.leap, k, x, u, i, b)
        done = True
        for m in range(nl):
            law_at(laws, m, mid, time + 0.5 * h, mode, s.ng, found[1, m])
            law_at(laws, m, b, time + h, mode, s.ng, found[2, m])
            at = n + 3 * m
            middle = x[at] + 0.5 * h * (x[at + 1] + 0.25 * h * x[at + 2])
            last = x[at] + h * (x[at + 1] + 0.5 * h * x[at + 2])
            if not agree(found, m, middle, last):
                done = False
                parabola(x, at, x[at], found[1, m, 0], found[2, m, 0], h)
        if done:
            break
    if not done:
        for m in range(nl):
            x[n + 3 * m + 1] = x[n + 3 * m + 2] = 0.0
        return False
    if not stays(c.watch, c.looks, s.reach, c.hold, k, mode, x, b, u, i):
        return False
    if big.shape[1] > 0:
        law_columns(laws.columns, s, c, laws, k, h, x, u, i, mode, mid, b, big)
    for r in range(n):
        x[r] = b[r]
    return True


@njit(**HOT)
def start_rows(arguments, parameters, half, gap, first, nq, found, x, mode, h, slope, big):
    """Rows of the laws' states from the torque at the start, those at middle and end held."""
    for m in range(gap.size):
        at = first + 3 * m
        torque_columns(arguments, parameters, half, gap_side(gap, m, mode), m, first, nq, x, big, found[0, m],
                       slope, big[at])
        for q in range(big.shape[1]):
            big[at + 1, q] = -3.0 / h * big[at, q]
            big[at + 2, q] = 4.0 / (h * h) * big[at, q]


@njit(**COMPILE)
def start_columns(arguments, parameters, half, gap, first, nq, found, x, mode, h, slope, big):
    """As `start_rows`, for those who are not in a hurry."""
    start_rows(arguments, parameters, half, gap, first, nq, found, x, mode, h, slope, big)


@njit(**HOT)
def response(leap, k, r, at, node, h):
    """Change of row r per unit of the torque at the middle (node 0) or the end (node 1).

    leap  (cap, nx, ...) whose columns at, at + 1, at + 2 are over value, slope and bend
    """
    if node == 0:
        return 4.0 / h * leap[k, r, at + 1] - 8.0 / (h * h) * leap[k, r, at + 2]
    return -1.0 / h * leap[k, r, at + 1] + 4.0 / (h * h) * leap[k, r, at + 2]


@njit(**HOT)
def node_equations(arguments, parameters, half, gap, first, nq, found, node, y, mode, columns, leap, k, offset,
                   h, slope, weight, right):
    """Rows of the equations: torque at a node = its slope times the motion there + its own derivative.

    y        state at the node; columns (nx, ns) its sensitivities with the unknown torques held
    leap, k  from the states of the laws, whose columns begin at `offset`, to the state at the node
    """
    nl = gap.size
    for m in range(nl):
        row = node * nl + m
        torque_columns(arguments, parameters, half, gap_side(gap, m, mode), m, first, nq, y, columns,
                       found[1 + node, m], slope, right[row])
        for other in range(2):
            for p in range(nl):
                v = 0.0
                for j in range(first):
                    v += slope[j] * response(leap, k, j, offset + 3 * p, other, h)
                column = other * nl + p
                weight[row, column] = (1.0 if row == column else 0.0) - v


@njit(**HOT)
def eliminate(a, b, columns):
    """Solve a z = b in place by elimination; a is near the identity, so without pivoting."""
    size = a.shape[0]
    for k in range(size):
        for r in range(k + 1, size):
            f = a[r, k] / a[k, k]
            for j in range(k, size):
                a[r, j] -= f * a[k, j]
            for q in range(columns):
                b[r, q] -= f * b[k, q]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            for q in range(columns):
                b[k, q] -= a[k, j] * b[j, q]
        for q in range(columns):
            b[k, q] /= a[k, k]


@unit(SYSTEM, CACHE, LAWS, WHOLE, REAL, REALS[1], REALS[2], WHOLE, WHOLES[1], REALS[1], REALS[1], REALS[2])
def law_columns(s, c, laws, k, h, x, u, i, mode, y, b, big):
    """Sensitivities over a part without events; y, b are the states at its middle and its end."""
    mid, dmid, leap, dleap = c.mid, c.dmid, c.leap, c.dleap
    arguments, parameters, half, gap = laws.arguments, laws.parameters, laws.half, laws.gap
    first, nq, found, nodes, slope = laws.first, s.nq, laws.found, laws.nodes, laws.slopes[0]
    weight, right = laws.weight, laws.right
    nl, ns, middle, end = gap.size, big.shape[1], nodes[0], nodes[1]
    start_rows(arguments, parameters, half, gap, first, nq, found, x, mode, h, slope, big)
    propagate_any(mid, dmid, k, x, u, i, big, first, middle)
    propagate_any(leap, dleap, k, x, u, i, big, first, end)
    node_equations(arguments, parameters, half, gap, first, nq, found, 0, y, mode, middle, mid, k, first,
                   h, slope, weight, right)
    node_equations(arguments, parameters, half, gap, first, nq, found, 1, b, mode, end, leap, k, first,
                   h, slope, weight, right)
    eliminate(weight, right, ns)
    for r in range(first):
        for q in range(ns):
            big[r, q] = end[r, q]
        for node in range(2):
            for m in range(nl):
                f = response(leap, k, r, first + 3 * m, node, h)
                for q in range(ns):
                    big[r, q] += f * right[node * nl + m, q]
