"""A part of a sample with smooth nonlinear torques.

Over the part each torque is the parabola through its values at the start, the middle and the end,
which are those at the motion that they cause: found by Newton's method. The motion under it is exact
(a collocated exponential integrator of fourth order). Sensitivities are those of the solved equations.

The state carries the three values of a law behind the drive's own states; the step matrices of a mode
are over them.
"""

from __future__ import annotations

from numba import njit

from drivetool.drive.compile import APART, CACHE, HOT, LAWS, REAL, REALS, SYSTEM, WHOLE, WHOLES, unit
from drivetool.drive.kernel.exact_step import stays
from drivetool.drive.kernel.laws import gap_side, law_at, own_columns, slope_of

ROUNDS = 8  # of Newton's method, after which shorter stretches are taken
NEAR = 1e-2  # relative change of the torques, below which the change after it is the coupling's share of it at most
CLOSE = 1e-9  # such a change that need not be made


@njit(**HOT)
def first_guess(s, laws, x, time, mode, n, nl):
    """Torques at the start; those at middle and end as if the parabola before went on."""
    for m in range(nl):
        at = n + 3 * m
        law_at(laws, m, x, time, mode, s.ng, laws.found[0, m])
        now, first, middle, last = laws.found[0, m, 0], x[at], x[at + 1], x[at + 2]
        x[at] = now
        x[at + 1] = now + first - 3.0 * middle + 2.0 * last
        x[at + 2] = now + 3.0 * first - 8.0 * middle + 5.0 * last


@njit(**HOT)
def couple(laws, leap, k, node, weight, n, nl):
    """Rows of `weight` for the torques at a node: one, less what they are changed by through the motion there.

    leap, k  step to the node (0 middle, 1 end), over the torques at middle and end
    returns  the largest sum of such changes in a row
    """
    slopes, largest = laws.slopes, 0.0
    for m in range(nl):
        slope_of(laws.arguments, m, laws.found[1 + node, m], slopes[m], n)
        row, total = node * nl + m, 0.0
        for other in range(2):
            for p in range(nl):
                v, at = 0.0, n + 3 * p + 1 + other
                if n == 3:
                    v = (slopes[m, 0] * leap[k, 0, at] + slopes[m, 1] * leap[k, 1, at]
                         + slopes[m, 2] * leap[k, 2, at])
                else:
                    for j in range(n):
                        v += slopes[m, j] * leap[k, j, at]
                column = other * nl + p
                weight[row, column] = (1.0 if row == column else 0.0) - v
                total += abs(v)
        largest = max(largest, total)
    return largest


@njit(**HOT)
def add_torques(leap, k, change, y, n, nl):
    """y (n,) += effect of changes (2 nl, 1) of the torques at middle and end."""
    for r in range(n):
        for m in range(nl):
            at = n + 3 * m
            y[r] += leap[k, r, at + 1] * change[m, 0] + leap[k, r, at + 2] * change[nl + m, 0]


@njit(**HOT)
def value_after(row, x, u, n, nl):
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


@njit(**HOT)
def meet(s, c, laws, k, h, x, time, mode, mid, b, n, nl):
    """Newton's method for the torques at middle and end; returns whether it got there."""
    found, weight, change = laws.found, laws.weight, laws.change
    for _ in range(ROUNDS):
        moved, size = 0.0, 1e-30
        for m in range(nl):
            at = n + 3 * m
            law_at(laws, m, mid, time + 0.5 * h, mode, s.ng, found[1, m])
            law_at(laws, m, b, time + h, mode, s.ng, found[2, m])
            change[m, 0], change[nl + m, 0] = found[1, m, 0] - x[at + 1], found[2, m, 0] - x[at + 2]
            size = max(size, abs(x[at]) + abs(found[1, m, 0]) + abs(found[2, m, 0]))
        coupling = max(couple(laws, c.mid, k, 0, weight, n, nl), couple(laws, c.leap, k, 1, weight, n, nl))
        solve(weight, laws.spare, change, 1, 2 * nl)
        for m in range(nl):
            at = n + 3 * m
            x[at + 1] += change[m, 0]
            x[at + 2] += change[nl + m, 0]
            moved = max(moved, abs(change[m, 0]), abs(change[nl + m, 0]))
        add_torques(c.mid, k, change, mid, n, nl)
        add_torques(c.leap, k, change, b, n, nl)
        if moved <= NEAR * size and min(coupling, 1.0) * moved <= CLOSE * size:
            return True
        if not moved < 1e12 * size:
            return False
    return False


@njit(**HOT)
def motion_of(s, c, laws, k, part, x, u, i, time, mode, b, mid, n, nl):
    """What law_motion does, for n states and nl laws."""
    h = s.spans[part]
    first_guess(s, laws, x, time, mode, n, nl)
    for r in range(n):
        mid[r] = value_after(c.mid[k, r], x, u[i], n, nl)
        b[r] = value_after(c.leap[k, r], x, u[i], n, nl)
    if not meet(s, c, laws, k, h, x, time, mode, mid, b, n, nl):
        return False
    if mode.size > 0:
        for at in range(n, n + 3 * nl, 3):
            b[at], b[at + 1], b[at + 2] = x[at + 2], x[at + 2], x[at + 2]
        if not stays(c.watch, c.looks, s.reach, c.hold, k, mode, x, b, u, i):
            return False
    return True


@unit(SYSTEM, CACHE, LAWS, WHOLE, WHOLE, REALS[1], REALS[2], WHOLE, REAL, WHOLES[1], REALS[1], REALS[1],
      gives=WHOLE)
def law_motion(s, c, laws, k, part, x, u, i, time, mode, b, mid):
    """Torques and states at middle and end of a part of a sample; 0 if an event may lie in it."""
    return motion_of(s, c, laws, k, part, x, u, i, time, mode, b, mid, laws.first, laws.code.size)


@njit(**HOT)
def law_step(s, c, laws, k, part, x, u, i, time, big, mode, b, mid):
    """Carry x and big over a part of a sample; False, and nothing moved, if an event may lie in it."""
    if not law_motion(laws.motion, s, c, laws, k, part, x, u, i, time, mode, b, mid):
        return False
    if big.shape[1] > 0:
        law_columns(laws.columns, s, c, laws, k, x, u, i, mode, mid, b, big)
    for r in range(laws.first):
        x[r] = b[r]
    return True


@njit(**HOT)
def transition_of(c, laws, k, moved, slope, n, nl):
    """What law_transition does, for n states and nl laws."""
    found, right, end, begun = laws.found, laws.right, laws.after, laws.slopes
    for m in range(nl):
        slope_of(laws.arguments, m, found[0, m], begun[m], n)
    for r in range(n):
        for j in range(n):
            end[r, j] = through_start(c.leap[k, r], begun, n, nl, j)
    for m in range(nl):
        slope_of(laws.arguments, m, found[1, m], slope, n)
        for j in range(n):
            right[m, j] = 0.0
        for r in range(n):
            if slope[r] != 0.0:
                for j in range(n):
                    right[m, j] += slope[r] * through_start(c.mid[k, r], begun, n, nl, j)
        slope_of(laws.arguments, m, found[2, m], slope, n)
        for j in range(n):
            v = 0.0
            for r in range(n):
                v += slope[r] * end[r, j]
            right[nl + m, j] = v
    solve(laws.weight, laws.spare, right, n, 2 * nl)
    for r in range(n):
        row = c.leap[k, r]
        for j in range(n):
            v = end[r, j]
            for m in range(nl):
                v += row[n + 3 * m + 1] * right[m, j] + row[n + 3 * m + 2] * right[nl + m, j]
            moved[r, j] = v


@unit(CACHE, LAWS, WHOLE, REALS[2])
def law_transition(c, laws, k, moved):
    """moved (n, n) = derivative of the state after a part over that before it; its torques have been found.

    What law_columns would make of the identity.
    """
    transition_of(c, laws, k, moved, c.vectors[3], laws.first, laws.code.size)


@njit(**HOT)
def through_start(row, begun, n, nl, j):
    """Derivative of a row of a step over state j, by itself and through the torques at the start."""
    v = row[j]
    for m in range(nl):
        v += row[n + 3 * m] * begun[m, j]
    return v


@njit(**APART)
def solve_two(a, b, c, columns):
    """The same for two equations."""
    w00, w01, w10, w11 = a[0, 0], a[0, 1], a[1, 0], a[1, 1]
    share = 1.0 / (w00 * w11 - w01 * w10)
    for q in range(columns):
        v, w = b[q], c[q]
        b[q] = (w11 * v - w01 * w) * share
        c[q] = (w00 * w - w10 * v) * share


@njit(**HOT)
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


@njit(**APART)
def add_row(e, d, x, u, n, big, share, row):
    """row (ns,) += share (e big + d z), a row of the columns after a step; n states and the torques at the start.

    e (nz,) and d (nz, nq) are the row of the step matrix and its derivatives
    """
    nx, nu, nq = x.size, u.size, d.shape[1]
    if n >= 3 and nu == 1:
        add_three(e, d, x, u[0], n, share, big[0], big[1], big[2], big[n], row)
        for j in range(3, n):
            f, z = share * e[j], share * x[j]
            for q in range(row.size):
                row[q] += f * big[j, q]
            for q in range(nq):
                row[q] += z * d[j, q]
    else:
        for j in range(n):
            f = share * e[j]
            for q in range(row.size):
                row[q] += f * big[j, q]
            f = share * x[j]
            for q in range(nq):
                row[q] += f * d[j, q]
        for j in range(nu):
            f = share * u[j]
            for q in range(nq):
                row[q] += f * d[nx + j, q]
        for q in range(nq):
            row[q] += share * d[nx + nu, q]
        add_law(e, d, x, n, share, big[n], row)
    for at in range(n + 3, nx, 3):
        add_law(e, d, x, at, share, big[at], row)


@njit(**APART)
def add_law(e, d, x, at, share, start, row):
    """Share of the law whose torques are x[at:at + 3], start (ns,) the columns of the first of them."""
    f = share * e[at]
    for q in range(row.size):
        row[q] += f * start[q]
    z0, z1, z2 = share * x[at], share * x[at + 1], share * x[at + 2]
    for q in range(d.shape[1]):
        row[q] += z0 * d[at, q] + z1 * d[at + 1, q] + z2 * d[at + 2, q]


@njit(**APART)
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


@njit(**APART)
def moved_by(end, f, g, b, c, row):
    """row (ns,) = end + f b + g c."""
    for q in range(row.size):
        row[q] = end[q] + (f * b[q] + g * c[q])


@njit(**HOT)
def torque_row(laws, m, mode, nq, x, out, columns, row, n):
    """row (ns,) = sensitivities of the torque of law m at a state x with sensitivities columns (nx, ns)."""
    own_columns(laws, m, gap_side(laws.gap, m, mode), nq, x, out, row)
    slope_of(laws.arguments, m, out, laws.slopes[m], n)
    for j in range(n):
        add_scaled(row, laws.slopes[m, j], columns[j])


@njit(**APART)
def add_scaled(row, factor, other):
    """row (ns,) += factor other, unless that is nothing."""
    if factor != 0.0:
        for q in range(row.size):
            row[q] += factor * other[q]


@njit(**HOT)
def columns_of(s, c, laws, k, x, u, i, mode, y, b, big, n, nl):
    """What law_columns does, for n states and nl laws."""
    found, right, end, slope = laws.found, laws.right, laws.after, laws.slopes
    for m in range(nl):
        torque_row(laws, m, mode, s.nq, x, found[0, m], big, big[n + 3 * m], n)
    for r in range(n):
        for q in range(big.shape[1]):
            end[r, q] = 0.0
        add_row(c.leap[k, r], c.dleap[k, r], x, u[i], n, big, 1.0, end[r])
    for m in range(nl):
        # Of the rows in the middle only those that the law looks at are worked out.
        own_columns(laws, m, gap_side(laws.gap, m, mode), s.nq, y, found[1, m], right[m])
        slope_of(laws.arguments, m, found[1, m], slope[m], n)
        for r in range(n):
            if slope[m, r] != 0.0:
                add_row(c.mid[k, r], c.dmid[k, r], x, u[i], n, big, slope[m, r], right[m])
        torque_row(laws, m, mode, s.nq, b, found[2, m], end, right[nl + m], n)
    solve(laws.weight, laws.spare, right, big.shape[1], 2 * nl)
    for r in range(n):
        row = c.leap[k, r]
        moved_by(end[r], row[n + 1], row[n + 2], right[0], right[nl], big[r])
        for m in range(1, nl):
            at = n + 3 * m
            add_scaled(big[r], row[at + 1], right[m])
            add_scaled(big[r], row[at + 2], right[nl + m])


@unit(SYSTEM, CACHE, LAWS, WHOLE, REALS[1], REALS[2], WHOLE, WHOLES[1], REALS[1], REALS[1], REALS[2])
def law_columns(s, c, laws, k, x, u, i, mode, y, b, big):
    """Sensitivities over a part without events; y, b are the states at its middle and its end."""
    columns_of(s, c, laws, k, x, u, i, mode, y, b, big, laws.first, laws.code.size)
