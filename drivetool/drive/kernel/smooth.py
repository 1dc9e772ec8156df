"""A part of a sample with smooth nonlinear torques.

Over the part each torque is the parabola through its values at the start, the middle and the end. Newton's method
makes these values consistent with the motion that they cause. The motion under the parabolas is exact (a collocated
exponential integrator of fourth order). Sensitivities are those of the solved equations.

The three values of a law follow the drive's own states in the state; the step matrices of a mode are over them.
"""

from __future__ import annotations

from numba import njit

from drivetool.drive.compile import (
    CACHE,
    INLINED,
    LAWS,
    NO_OVERLAP,
    REAL,
    REALS,
    SYSTEM,
    WHOLE,
    WHOLES,
    as_unit,
)
from drivetool.drive.kernel.exact_step import mode_holds
from drivetool.drive.kernel.laws import gap_side, law_at, law_slope, parameter_columns

# Newton iterations before the part is handed to smooth_events.py. A choice: quadratic convergence needs fewer.
MAX_NEWTON_ITERATIONS = 8
# Relative change of the torques below which the next change is at most the coupling times this one.
CONTRACTION_CHANGE = 1e-2
# Relative change that need not be made. A choice: far above rounding, far below the method's own error.
NEWTON_TOLERANCE = 1e-9


@njit(**INLINED)
def extrapolate_torques(s, laws, x, time, mode, n, nl):
    """Torques at the start; those at middle and end extrapolate the last parabola."""
    for m in range(nl):
        at = n + 3 * m
        law_at(laws, m, x, time, mode, s.ng, laws.torque_jets[0, m])
        now, first, middle, last = laws.torque_jets[0, m, 0], x[at], x[at + 1], x[at + 2]
        x[at] = now
        x[at + 1] = now + first - 3.0 * middle + 2.0 * last
        x[at + 2] = now + 3.0 * first - 8.0 * middle + 5.0 * last


@njit(**INLINED)
def newton_rows(laws, phi, k, node, weight, n, nl):
    """Rows of Newton's matrix for the torques at a node: identity minus their change through the motion there.

    phi, k  step to the node (0 middle, 1 end), over the torques at middle and end
    returns  the largest sum of such changes in a row
    """
    slopes, largest = laws.slopes, 0.0
    for m in range(nl):
        law_slope(laws.arguments, m, laws.torque_jets[1 + node, m], slopes[m], n)
        row, total = node * nl + m, 0.0
        for other in range(2):
            for p in range(nl):
                v, at = 0.0, n + 3 * p + 1 + other
                if n == 3:
                    v = (slopes[m, 0] * phi[k, 0, at] + slopes[m, 1] * phi[k, 1, at]
                         + slopes[m, 2] * phi[k, 2, at])
                else:
                    for j in range(n):
                        v += slopes[m, j] * phi[k, j, at]
                column = other * nl + p
                weight[row, column] = (1.0 if row == column else 0.0) - v
                total += abs(v)
        largest = max(largest, total)
    return largest


@njit(**INLINED)
def add_torques(phi, k, change, y, n, nl):
    """y (n,) += effect of changes (2 nl, 1) of the torques at middle and end."""
    for r in range(n):
        for m in range(nl):
            at = n + 3 * m
            y[r] += phi[k, r, at + 1] * change[m, 0] + phi[k, r, at + 2] * change[nl + m, 0]


@njit(**INLINED)
def row_times_state(row, x, u, n, nl):
    """row (nz,) times [x, u, 1]; n states, the rest of x the torques of nl laws."""
    nx, nu = n + 3 * nl, u.size
    if n >= 3 and nu == 1:
        v = (row[0] * x[0] + row[1] * x[1]) + (row[2] * x[2] + row[nx] * u[0]) + row[nx + 1]
        for j in range(3, n):
            v += row[j] * x[j]
    else:
        v = row[nx + nu]
        for j in range(nu):
            v += row[nx + j] * u[j]
        for j in range(n):
            v += row[j] * x[j]
    for at in range(n, nx, 3):
        v += row[at] * x[at] + (row[at + 1] * x[at + 1] + row[at + 2] * x[at + 2])
    return v


@njit(**INLINED)
def solve_torques(s, c, laws, k, h, x, time, mode, x_mid, b, n, nl):
    """Newton's method for the torques at middle and end; returns whether it converged."""
    jets, weight, change = laws.torque_jets, laws.newton_matrix, laws.torque_change
    for _ in range(MAX_NEWTON_ITERATIONS):
        largest_change, size = 0.0, 1e-30
        for m in range(nl):
            at = n + 3 * m
            law_at(laws, m, x_mid, time + 0.5 * h, mode, s.ng, jets[1, m])
            law_at(laws, m, b, time + h, mode, s.ng, jets[2, m])
            change[m, 0], change[nl + m, 0] = jets[1, m, 0] - x[at + 1], jets[2, m, 0] - x[at + 2]
            size = max(size, abs(x[at]) + abs(jets[1, m, 0]) + abs(jets[2, m, 0]))
        coupling = max(newton_rows(laws, c.phi_mid, k, 0, weight, n, nl),
                       newton_rows(laws, c.phi, k, 1, weight, n, nl))
        solve(weight, laws.matrix_scratch, change, 1, 2 * nl)
        for m in range(nl):
            at = n + 3 * m
            x[at + 1] += change[m, 0]
            x[at + 2] += change[nl + m, 0]
            largest_change = max(largest_change, abs(change[m, 0]), abs(change[nl + m, 0]))
        add_torques(c.phi_mid, k, change, x_mid, n, nl)
        add_torques(c.phi, k, change, b, n, nl)
        if (largest_change <= CONTRACTION_CHANGE * size
                and min(coupling, 1.0) * largest_change <= NEWTON_TOLERANCE * size):
            return True
        if not largest_change < 1e12 * size:
            return False
    return False


@njit(**INLINED)
def motion_of(s, c, laws, k, part, x, u, i, time, mode, b, x_mid, n, nl):
    """law_motion for n states and nl laws."""
    h = s.part_lengths[part]
    extrapolate_torques(s, laws, x, time, mode, n, nl)
    for r in range(n):
        x_mid[r] = row_times_state(c.phi_mid[k, r], x, u[i], n, nl)
        b[r] = row_times_state(c.phi[k, r], x, u[i], n, nl)
    if not solve_torques(s, c, laws, k, h, x, time, mode, x_mid, b, n, nl):
        return False
    if mode.size > 0:
        for at in range(n, n + 3 * nl, 3):
            b[at], b[at + 1], b[at + 2] = x[at + 2], x[at + 2], x[at + 2]
        if not mode_holds(c.guard_rows, c.guard_instants, s.reach, c.holding_torque, k, mode, x, b, u, i):
            return False
    return True


@as_unit(SYSTEM, CACHE, LAWS, WHOLE, WHOLE, REALS[1], REALS[2], WHOLE, REAL, WHOLES[1], REALS[1],
                     REALS[1],
                     gives=WHOLE)
def law_motion(s, c, laws, k, part, x, u, i, time, mode, b, x_mid):
    """Torques and states at middle and end of a part of a sample; 0 if an event may occur in it."""
    return motion_of(s, c, laws, k, part, x, u, i, time, mode, b, x_mid, laws.first, laws.code.size)


@njit(**INLINED)
def law_step(s, c, laws, k, part, x, u, i, time, sens, mode, b, x_mid):
    """Carry x and sens over a part of a sample; False, and both unchanged, if an event may occur in it."""
    if not law_motion(laws.motion, s, c, laws, k, part, x, u, i, time, mode, b, x_mid):
        return False
    if sens.shape[1] > 0:
        law_columns(laws.columns, s, c, laws, k, x, u, i, mode, x_mid, b, sens)
    for r in range(laws.first):
        x[r] = b[r]
    return True


@njit(**INLINED)
def transition_of(c, laws, k, transition, slope, n, nl):
    """law_transition for n states and nl laws."""
    jets, right, end, start_slopes = laws.torque_jets, laws.torque_columns, laws.end_columns, laws.slopes
    for m in range(nl):
        law_slope(laws.arguments, m, jets[0, m], start_slopes[m], n)
    for r in range(n):
        for j in range(n):
            end[r, j] = row_through_start(c.phi[k, r], start_slopes, n, nl, j)
    for m in range(nl):
        law_slope(laws.arguments, m, jets[1, m], slope, n)
        for j in range(n):
            right[m, j] = 0.0
        for r in range(n):
            if slope[r] != 0.0:
                for j in range(n):
                    right[m, j] += slope[r] * row_through_start(c.phi_mid[k, r], start_slopes, n, nl, j)
        law_slope(laws.arguments, m, jets[2, m], slope, n)
        for j in range(n):
            v = 0.0
            for r in range(n):
                v += slope[r] * end[r, j]
            right[nl + m, j] = v
    solve(laws.newton_matrix, laws.matrix_scratch, right, n, 2 * nl)
    for r in range(n):
        row = c.phi[k, r]
        for j in range(n):
            v = end[r, j]
            for m in range(nl):
                v += row[n + 3 * m + 1] * right[m, j] + row[n + 3 * m + 2] * right[nl + m, j]
            transition[r, j] = v


@as_unit(CACHE, LAWS, WHOLE, REALS[2])
def law_transition(c, laws, k, transition):
    """transition (n, n) = derivative of the state after a part over that before it; its torques are known.

    Equal to law_columns applied to the identity.
    """
    transition_of(c, laws, k, transition, c.vectors[3], laws.first, laws.code.size)


@njit(**INLINED)
def row_through_start(row, start_slopes, n, nl, j):
    """Derivative of a row of a step over state j, by itself and through the torques at the start."""
    v = row[j]
    for m in range(nl):
        v += row[n + 3 * m] * start_slopes[m, j]
    return v


@njit(**NO_OVERLAP)
def solve_two(a, b, c, columns):
    """The same for two equations."""
    w00, w01, w10, w11 = a[0, 0], a[0, 1], a[1, 0], a[1, 1]
    share = 1.0 / (w00 * w11 - w01 * w10)
    for q in range(columns):
        v, w = b[q], c[q]
        b[q] = (w11 * v - w01 * w) * share
        c[q] = (w00 * w - w10 * v) * share


@njit(**INLINED)
def solve(a, spare, b, columns, size):
    """Solve a z = b of `size` in place of b by elimination; a is near the identity, so without pivoting."""
    if size == 2:
        solve_two(a, b[0], b[1], columns)
        return
    for r in range(size):
        for j in range(size):
            spare[r, j] = a[r, j]
    for k in range(size):
        for r in range(k + 1, size):
            f = spare[r, k] / spare[k, k]
            for j in range(k, size):
                spare[r, j] -= f * spare[k, j]
            for q in range(columns):
                b[r, q] -= f * b[k, q]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            for q in range(columns):
                b[k, q] -= spare[k, j] * b[j, q]
        for q in range(columns):
            b[k, q] /= spare[k, k]


@njit(**NO_OVERLAP)
def add_row(e, d, x, u, n, sens, share, row):
    """row (ns,) += share (e sens + d z), a row of the columns after a step; n states and the torques at the start.

    e (nz,) and d (nz, nq) are the row of the step matrix and its derivatives
    """
    nx, nu, nq = x.size, u.size, d.shape[1]
    if n >= 3 and nu == 1:
        add_three(e, d, x, u[0], n, share, sens[0], sens[1], sens[2], sens[n], row)
        for j in range(3, n):
            f, z = share * e[j], share * x[j]
            for q in range(row.size):
                row[q] += f * sens[j, q]
            for q in range(nq):
                row[q] += z * d[j, q]
    else:
        for j in range(n):
            f = share * e[j]
            for q in range(row.size):
                row[q] += f * sens[j, q]
            f = share * x[j]
            for q in range(nq):
                row[q] += f * d[j, q]
        for j in range(nu):
            f = share * u[j]
            for q in range(nq):
                row[q] += f * d[nx + j, q]
        for q in range(nq):
            row[q] += share * d[nx + nu, q]
        add_law(e, d, x, n, share, sens[n], row)
    for at in range(n + 3, nx, 3):
        add_law(e, d, x, at, share, sens[at], row)


@njit(**NO_OVERLAP)
def add_law(e, d, x, at, share, start, row):
    """Share of the law whose torques are x[at:at + 3], start (ns,) the columns of the first of them."""
    f = share * e[at]
    for q in range(row.size):
        row[q] += f * start[q]
    z0, z1, z2 = share * x[at], share * x[at + 1], share * x[at + 2]
    for q in range(d.shape[1]):
        row[q] += z0 * d[at, q] + z1 * d[at + 1, q] + z2 * d[at + 2, q]


@njit(**NO_OVERLAP)
def add_three(e, d, x, u, n, share, b0, b1, b2, law, row):
    """The same for the first three states, the one input and the first law, in two loops over the columns."""
    nx = x.size
    e0, e1, e2, e3 = share * e[0], share * e[1], share * e[2], share * e[n]
    for q in range(row.size):
        row[q] += (e0 * b0[q] + e1 * b1[q]) + (e2 * b2[q] + e3 * law[q])
    z0, z1, z2, z3 = share * x[0], share * x[1], share * x[2], share * x[n]
    z4, z5, z6 = share * x[n + 1], share * x[n + 2], share * u
    for q in range(d.shape[1]):
        row[q] += ((z0 * d[0, q] + z1 * d[1, q]) + (z2 * d[2, q] + z3 * d[n, q])
                   + ((z4 * d[n + 1, q] + z5 * d[n + 2, q]) + (z6 * d[nx, q] + share * d[nx + 1, q])))


@njit(**NO_OVERLAP)
def add_two_scaled(end, f, g, b, c, row):
    """row (ns,) = end + f b + g c."""
    for q in range(row.size):
        row[q] = end[q] + (f * b[q] + g * c[q])


@njit(**INLINED)
def torque_row(laws, m, mode, nq, x, out, columns, row, n):
    """row (ns,) = sensitivities of the torque of law m at a state x with sensitivities columns (nx, ns)."""
    parameter_columns(laws, m, gap_side(laws.gap, m, mode), nq, x, out, row)
    law_slope(laws.arguments, m, out, laws.slopes[m], n)
    for j in range(n):
        add_scaled_nonzero(row, laws.slopes[m, j], columns[j])


@njit(**NO_OVERLAP)
def add_scaled_nonzero(row, factor, other):
    """row (ns,) += factor other, skipped for a zero factor."""
    if factor != 0.0:
        for q in range(row.size):
            row[q] += factor * other[q]


@njit(**INLINED)
def columns_of(s, c, laws, k, x, u, i, mode, y, b, sens, n, nl):
    """law_columns for n states and nl laws."""
    jets, right, end, slope = laws.torque_jets, laws.torque_columns, laws.end_columns, laws.slopes
    for m in range(nl):
        torque_row(laws, m, mode, s.nq, x, jets[0, m], sens, sens[n + 3 * m], n)
    for r in range(n):
        for q in range(sens.shape[1]):
            end[r, q] = 0.0
        add_row(c.phi[k, r], c.dphi[k, r], x, u[i], n, sens, 1.0, end[r])
    for m in range(nl):
        # Of the rows in the middle only those that the law depends on are computed.
        parameter_columns(laws, m, gap_side(laws.gap, m, mode), s.nq, y, jets[1, m], right[m])
        law_slope(laws.arguments, m, jets[1, m], slope[m], n)
        for r in range(n):
            if slope[m, r] != 0.0:
                add_row(c.phi_mid[k, r], c.dphi_mid[k, r], x, u[i], n, sens, slope[m, r], right[m])
        torque_row(laws, m, mode, s.nq, b, jets[2, m], end, right[nl + m], n)
    solve(laws.newton_matrix, laws.matrix_scratch, right, sens.shape[1], 2 * nl)
    for r in range(n):
        row = c.phi[k, r]
        add_two_scaled(end[r], row[n + 1], row[n + 2], right[0], right[nl], sens[r])
        for m in range(1, nl):
            at = n + 3 * m
            add_scaled_nonzero(sens[r], row[at + 1], right[m])
            add_scaled_nonzero(sens[r], row[at + 2], right[nl + m])


@as_unit(SYSTEM, CACHE, LAWS, WHOLE, REALS[1], REALS[2], WHOLE, WHOLES[1], REALS[1], REALS[1], REALS[2])
def law_columns(s, c, laws, k, x, u, i, mode, y, b, sens):
    """Sensitivities over a part without events; y, b are the states at its middle and its end."""
    columns_of(s, c, laws, k, x, u, i, mode, y, b, sens, laws.first, laws.code.size)
