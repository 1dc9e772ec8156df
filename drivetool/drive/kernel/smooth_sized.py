"""A part of a sample with smooth laws: smooth.py for fixed numbers of states and laws, with unrolled loops.

Derivatives are carried in registers: a block of columns passes the whole part before the next block starts.
"""

from __future__ import annotations

from collections.abc import Callable

from numba import njit

from drivetool.drive.arrays import MAX_SIZED_LAWS, MOST_STATES, NARROW_BLOCK, WIDE_BLOCK
from drivetool.drive.compile import CACHE, INLINED, LAWS, REAL, REALS, SYSTEM, WHOLE, WHOLES, as_unit
from drivetool.drive.kernel.laws import gap_side, law_slope, parameter_columns
from drivetool.drive.kernel.simd_intrinsics import (
    add_weighted,
    matrix_times,
    plus_scaled,
    row_times,
    row_times_with_sources,
    tuple_reader,
    write,
)
from drivetool.drive.kernel.smooth import motion_of, torque_row


def motion_for(n: int, nl: int) -> Callable:
    """The unit law_motion for n states and nl laws."""
    @as_unit(SYSTEM, CACHE, LAWS, WHOLE, WHOLE, REALS[1], REALS[2], WHOLE, REAL, WHOLES[1], REALS[1],
                         REALS[1],
                         gives=WHOLE)
    def law_motion(s, c, laws, k, part, x, u, i, time, mode, b, x_mid):
        return motion_of(s, c, laws, k, part, x, u, i, time, mode, b, x_mid, n, nl)

    return law_motion


@njit(**INLINED)
def invert(a, inverse, size):
    """inverse (size, size) of a, near the identity and so without pivoting; a is overwritten."""
    for r in range(size):
        for q in range(size):
            inverse[r, q] = 1.0 if r == q else 0.0
    for k in range(size):
        share = 1.0 / a[k, k]
        for q in range(size):
            a[k, q] *= share
            inverse[k, q] *= share
        for r in range(size):
            if r != k:
                f = a[r, k]
                for q in range(size):
                    a[r, q] -= f * a[k, q]
                    inverse[r, q] -= f * inverse[k, q]


def torque_effect_for(n: int, nl: int) -> Callable:
    """add_torque_effect(changes, phi, sens, q, one): add the effect of torque changes to the columns at q."""
    @njit(**INLINED)
    def add_torque_effect(changes, phi, sens, q, one):
        ns = sens.shape[1]
        for r in range(n):
            end = one(sens, q + r * ns, 1)[0]
            for m in range(nl):
                at = n + 3 * m
                end = plus_scaled(plus_scaled(end, phi[r, at + 1], changes[m]), phi[r, at + 2], changes[nl + m])
            write(sens, q + r * ns, end)

    return add_torque_effect


def dependence_test_for(nl: int) -> Callable:
    """depends_on(slopes, r): whether a law depends on state r."""
    @njit(**INLINED)
    def depends_on(slopes, r):
        found = False
        for m in range(nl):
            found = found or slopes[m, r] != 0.0
        return found

    return depends_on


def columns_for(n: int, nl: int) -> Callable:
    """The unit law_columns for n states, nl laws and one input."""
    # A row of a step is over the states, three torques per law, the input and one.
    width, rows, state = n + 3 * nl + 2, n + 3 * nl - 2, tuple_reader(n + 3 * nl)
    wide, one_wide, all_wide = (tuple_reader(count, WIDE_BLOCK) for count in (rows, 1, nl))
    narrow, one_narrow, all_narrow = (tuple_reader(count, NARROW_BLOCK) for count in (rows, 1, nl))
    add_torque_effect, depends_on = torque_effect_for(n, nl), dependence_test_for(nl)

    @as_unit(SYSTEM, CACHE, LAWS, WHOLE, REALS[1], REALS[2], WHOLE, WHOLES[1], REALS[1], REALS[1],
                         REALS[2])
    def law_columns(s, c, laws, k, x, u, i, mode, y, b, sens):
        jets, right, middle, last, inverse = (
            laws.torque_jets, laws.torque_columns, laws.middle_slopes, laws.slopes, laws.matrix_scratch)
        phi, phi_mid, dphi, dphi_mid, ns, line = (
            c.phi[k], c.phi_mid[k], c.dphi_blocks[k], c.dphi_mid_blocks[k], sens.shape[1], right.shape[1])
        for m in range(nl):
            torque_row(laws, m, mode, s.nq, x, jets[0, m], sens, sens[n + 3 * m], n)
        for at in range(n + 1, rows):  # of the torques at middle and end, which are not known yet
            for q in range(ns if (at - n) % 3 != 0 else 0):
                sens[at, q] = 0.0
        for m in range(nl):
            side = gap_side(laws.gap, m, mode)
            parameter_columns(laws, m, side, s.nq, y, jets[1, m], right[m])
            parameter_columns(laws, m, side, s.nq, b, jets[2, m], right[nl + m])
            law_slope(laws.arguments, m, jets[1, m], middle[m], n)
            law_slope(laws.arguments, m, jets[2, m], last[m], n)
        invert(laws.newton_matrix, inverse, 2 * nl)
        z, torque = state(x, 0, 1), u[i, 0]
        # Parameters are padded to fours, and at least two more columns follow: no block exceeds the last column.
        for block in range(dphi.shape[0]):
            q = WIDE_BLOCK * block
            v, at_mid, at_end = wide(sens, q, ns), all_wide(right, q, line), all_wide(right, q + nl * line, line)
            for r in range(n):
                if depends_on(middle, r):
                    at_mid = add_weighted(at_mid, middle, r,
                                    row_times_with_sources(phi_mid, r * width, v, dphi_mid[block], z, torque))
                row = row_times_with_sources(phi, r * width, v, dphi[block], z, torque)
                write(sens, q + r * ns, row)
                at_end = add_weighted(at_end, last, r, row)
            add_torque_effect(matrix_times(inverse, at_mid + at_end), phi, sens, q, one_wide)
        for q in range(WIDE_BLOCK * dphi.shape[0], ns, NARROW_BLOCK):
            w = narrow(sens, q, ns)
            at_mid, at_end = all_narrow(right, q, line), all_narrow(right, q + nl * line, line)
            for r in range(n):
                if depends_on(middle, r):
                    at_mid = add_weighted(at_mid, middle, r, row_times(phi_mid, r * width, w))
                row = row_times(phi, r * width, w)
                write(sens, q + r * ns, row)
                at_end = add_weighted(at_end, last, r, row)
            add_torque_effect(matrix_times(inverse, at_mid + at_end), phi, sens, q, one_narrow)

    return law_columns


def transition_for(n: int, nl: int) -> Callable:
    """The unit law_transition for n states and nl laws.

    The columns of `transition` beyond the first n have no meaning.
    """
    one, every = tuple_reader(1, NARROW_BLOCK), tuple_reader(nl, NARROW_BLOCK)
    add_torque_effect, depends_on = torque_effect_for(n, nl), dependence_test_for(nl)

    @njit(**INLINED)
    def through_start(step, r, q, first):
        """Columns at q of row r of a step: direct, and through the torques at the start with columns `first`."""
        total = one(step, r * step.shape[1] + q, 1)[0]
        for m in range(nl):
            total = plus_scaled(total, step[r, n + 3 * m], first[m])
        return total

    @as_unit(CACHE, LAWS, WHOLE, REALS[2])
    def law_transition(c, laws, k, transition):
        jets, phi, phi_mid, right, inverse = (
            laws.torque_jets, c.phi[k], c.phi_mid[k], laws.torque_columns, laws.matrix_scratch)
        start_slopes, middle, last = laws.start_slopes, laws.middle_slopes, laws.slopes
        for m in range(nl):
            law_slope(laws.arguments, m, jets[0, m], start_slopes[m], n)
            law_slope(laws.arguments, m, jets[1, m], middle[m], n)
            law_slope(laws.arguments, m, jets[2, m], last[m], n)
            for q in range(NARROW_BLOCK):
                right[m, q] = 0.0
        invert(laws.newton_matrix, inverse, 2 * nl)
        for q in range(0, n, NARROW_BLOCK):
            first = every(start_slopes, q, start_slopes.shape[1])
            at_mid, at_end = every(right, 0, right.shape[1]), every(right, 0, right.shape[1])
            for r in range(n):
                if depends_on(middle, r):
                    at_mid = add_weighted(at_mid, middle, r, through_start(phi_mid, r, q, first))
                row = through_start(phi, r, q, first)
                write(transition, q + r * transition.shape[1], row)
                at_end = add_weighted(at_end, last, r, row)
            add_torque_effect(matrix_times(inverse, at_mid + at_end), phi, transition, q, one)

    return law_transition


for _n in range(1, MOST_STATES + 1):
    for _nl in range(1, MAX_SIZED_LAWS + 1):
        globals()[f"law_motion_{_n}_{_nl}"] = motion_for(_n, _nl)
        globals()[f"law_columns_{_n}_{_nl}"] = columns_for(_n, _nl)
        globals()[f"law_transition_{_n}_{_nl}"] = transition_for(_n, _nl)
