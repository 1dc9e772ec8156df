"""A part of a sample with smooth laws: smooth.py for just so many states and laws, whose loops need no counting.

Derivatives are carried in registers: a block of columns goes all the way through the part before the next one is
begun.
"""

from __future__ import annotations

from collections.abc import Callable

from numba import njit

from drivetool.drive.arrays import MOST_LAWS, MOST_STATES, NARROW, WIDE
from drivetool.drive.compile import CACHE, HOT, LAWS, REAL, REALS, SYSTEM, WHOLE, WHOLES, unit
from drivetool.drive.kernel.laws import gap_side, own_columns, slope_of
from drivetool.drive.kernel.registers import mapped, plus, put, raised, taker, turned, turned_with
from drivetool.drive.kernel.smooth import motion_of, torque_row


def motion_for(n: int, nl: int) -> Callable:
    """The unit law_motion for n states and nl laws."""
    @unit(SYSTEM, CACHE, LAWS, WHOLE, WHOLE, REALS[1], REALS[2], WHOLE, REAL, WHOLES[1], REALS[1], REALS[1],
          gives=WHOLE)
    def law_motion(s, c, laws, k, part, x, u, i, time, mode, b, mid):
        return motion_of(s, c, laws, k, part, x, u, i, time, mode, b, mid, n, nl)

    return law_motion


@njit(**HOT)
def invert(a, inverse, size):
    """inverse (size, size) of a, which is near the identity and is lost, so without pivoting."""
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


def closer(n: int, nl: int) -> Callable:
    """close(changes, leap, big, q, one): let changes of the torques at middle and end act on columns at q."""
    @njit(**HOT)
    def close(changes, leap, big, q, one):
        ns = big.shape[1]
        for r in range(n):
            end = one(big, q + r * ns, 1)[0]
            for m in range(nl):
                at = n + 3 * m
                end = plus(plus(end, leap[r, at + 1], changes[m]), leap[r, at + 2], changes[nl + m])
            put(big, q + r * ns, end)

    return close


def asker(nl: int) -> Callable:
    """asked(slopes, r): whether a law looks at state r."""
    @njit(**HOT)
    def asked(slopes, r):
        found = False
        for m in range(nl):
            found = found or slopes[m, r] != 0.0
        return found

    return asked


def columns_for(n: int, nl: int) -> Callable:
    """The unit law_columns for n states, nl laws and one input."""
    # A row of a step lies over the states, three torques a law, the input and one.
    width, rows, state = n + 3 * nl + 2, n + 3 * nl - 2, taker(n + 3 * nl)
    wide, one_wide, all_wide = (taker(count, WIDE) for count in (rows, 1, nl))
    narrow, one_narrow, all_narrow = (taker(count, NARROW) for count in (rows, 1, nl))
    close, asked = closer(n, nl), asker(nl)

    @unit(SYSTEM, CACHE, LAWS, WHOLE, REALS[1], REALS[2], WHOLE, WHOLES[1], REALS[1], REALS[1], REALS[2])
    def law_columns(s, c, laws, k, x, u, i, mode, y, b, big):
        found, right, middle, last, inverse = laws.found, laws.right, laws.middle, laws.slopes, laws.spare
        leap, mid, d, dmid, ns, line = c.leap[k], c.mid[k], c.wide[k], c.wide_mid[k], big.shape[1], right.shape[1]
        for m in range(nl):
            torque_row(laws, m, mode, s.nq, x, found[0, m], big, big[n + 3 * m], n)
        for at in range(n + 1, rows):  # of the torques at middle and end, for they are not known yet
            for q in range(ns if (at - n) % 3 != 0 else 0):
                big[at, q] = 0.0
        for m in range(nl):
            side = gap_side(laws.gap, m, mode)
            own_columns(laws, m, side, s.nq, y, found[1, m], right[m])
            own_columns(laws, m, side, s.nq, b, found[2, m], right[nl + m])
            slope_of(laws.arguments, m, found[1, m], middle[m], n)
            slope_of(laws.arguments, m, found[2, m], last[m], n)
        invert(laws.weight, inverse, 2 * nl)
        z, torque = state(x, 0, 1), u[i, 0]
        # Parameters come in fours, and behind them at least two more columns: no block ends behind the last one.
        for block in range(d.shape[0]):
            q = WIDE * block
            v, at_mid, at_end = wide(big, q, ns), all_wide(right, q, line), all_wide(right, q + nl * line, line)
            for r in range(n):
                if asked(middle, r):
                    at_mid = raised(at_mid, middle, r, turned_with(mid, r * width, v, dmid[block], z, torque))
                row = turned_with(leap, r * width, v, d[block], z, torque)
                put(big, q + r * ns, row)
                at_end = raised(at_end, last, r, row)
            close(mapped(inverse, at_mid + at_end), leap, big, q, one_wide)
        for q in range(WIDE * d.shape[0], ns, NARROW):
            w = narrow(big, q, ns)
            at_mid, at_end = all_narrow(right, q, line), all_narrow(right, q + nl * line, line)
            for r in range(n):
                if asked(middle, r):
                    at_mid = raised(at_mid, middle, r, turned(mid, r * width, w))
                row = turned(leap, r * width, w)
                put(big, q + r * ns, row)
                at_end = raised(at_end, last, r, row)
            close(mapped(inverse, at_mid + at_end), leap, big, q, one_narrow)

    return law_columns


def transition_for(n: int, nl: int) -> Callable:
    """The unit law_transition for n states and nl laws.

    What `moved` has behind its n columns means nothing.
    """
    one, every = taker(1, NARROW), taker(nl, NARROW)
    close, asked = closer(n, nl), asker(nl)

    @njit(**HOT)
    def through_start(step, r, q, first):
        """Columns at q of row r of a step: its own, and through the torques at the start, which have `first`."""
        found = one(step, r * step.shape[1] + q, 1)[0]
        for m in range(nl):
            found = plus(found, step[r, n + 3 * m], first[m])
        return found

    @unit(CACHE, LAWS, WHOLE, REALS[2])
    def law_transition(c, laws, k, moved):
        found, leap, mid, right, inverse = laws.found, c.leap[k], c.mid[k], laws.right, laws.spare
        begun, middle, last = laws.begun, laws.middle, laws.slopes
        for m in range(nl):
            slope_of(laws.arguments, m, found[0, m], begun[m], n)
            slope_of(laws.arguments, m, found[1, m], middle[m], n)
            slope_of(laws.arguments, m, found[2, m], last[m], n)
            for q in range(NARROW):
                right[m, q] = 0.0
        invert(laws.weight, inverse, 2 * nl)
        for q in range(0, n, NARROW):
            first = every(begun, q, begun.shape[1])
            at_mid, at_end = every(right, 0, right.shape[1]), every(right, 0, right.shape[1])
            for r in range(n):
                if asked(middle, r):
                    at_mid = raised(at_mid, middle, r, through_start(mid, r, q, first))
                row = through_start(leap, r, q, first)
                put(moved, q + r * moved.shape[1], row)
                at_end = raised(at_end, last, r, row)
            close(mapped(inverse, at_mid + at_end), leap, moved, q, one)

    return law_transition


for _n in range(1, MOST_STATES + 1):
    for _nl in range(1, MOST_LAWS + 1):
        globals()[f"law_motion_{_n}_{_nl}"] = motion_for(_n, _nl)
        globals()[f"law_columns_{_n}_{_nl}"] = columns_for(_n, _nl)
        globals()[f"law_transition_{_n}_{_nl}"] = transition_for(_n, _nl)
