"""The smooth laws by number, and their torques at a state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from drivetool.drive.compile import COMPILE, COMPILE_LAW, INLINED, REAL, REALS, WHOLE, as_unit
from drivetool.drive.effects import LAW_TORQUES


@njit(**INLINED)
def _no_law(code, a, b, time, side, p, out):
    """A number that belongs to no law gives NaN."""
    for j in range(out.size):
        out[j] = np.nan


def _branch(number: int, law: Callable, others: Callable) -> Callable:
    """The law if the code is its number, else one of the others."""
    @njit(**INLINED)
    def choose(code, a, b, time, side, p, out):
        if code == number:
            law(a, b, time, side, p, out)
        else:
            others(code, a, b, time, side, p, out)

    return choose


_dispatch = _no_law
for _number, _torque in reversed(tuple(enumerate(LAW_TORQUES))):
    _dispatch = _branch(_number, COMPILE_LAW(_torque), _dispatch)


@as_unit(WHOLE, REAL, REAL, REAL, REAL, REALS[2], REALS[1])
def law_torque(code, a, b, time, side, p, out):
    """out = torque of a law of LAW_TORQUES, its derivatives over the arguments a and b, and over the parameters."""
    for j in range(out.size):
        out[j] = 0.0
    _dispatch(code, a, b, time, side, p, out)


@njit(**INLINED)
def side_of(gap, friction, m, mode, gaps):
    """Side on which law m acts in a mode: 1, -1, or 0 where it does not; 1 where it always does."""
    if gap[m] >= 0:
        return 1.0 - mode[gap[m]]
    if friction[m] >= 0:
        return 1.0 - mode[gaps + friction[m]]
    return 1.0


@njit(**INLINED)
def law_argument(row, x, first):
    """An argument of a law, row (nx, 1 + nq), at a state; unrolled for two masses."""
    if first == 3:
        return row[0, 0] * x[0] + row[1, 0] * x[1] + row[2, 0] * x[2]
    v = 0.0
    for j in range(first):
        v += row[j, 0] * x[j]
    return v


@njit(**INLINED)
def law_at(laws, m, x, time, mode, gaps, out):
    """out (3 + PARAMETERS,) of law m at a state."""
    side = side_of(laws.gap, laws.friction, m, mode, gaps)
    if side == 0.0:
        for j in range(out.size):
            out[j] = 0.0
        return
    a = law_argument(laws.arguments[m, 0], x, laws.first)
    b = law_argument(laws.arguments[m, 1], x, laws.first)
    if laws.gap[m] >= 0:
        a -= side * laws.half_gap[m, 0]
    law_torque(laws.torque, laws.code[m], a, b, time, side, laws.parameters[m], out)


@njit(**INLINED)
def law_slope(arguments, m, out, slope, first):
    """slope (first,) derivative of law m over the state, from its derivatives over the arguments."""
    for j in range(first):
        slope[j] = out[1] * arguments[m, 0, j, 0] + out[2] * arguments[m, 1, j, 0]


@njit(**INLINED)
def parameter_columns(laws, m, side, nq, x, out, row):
    """row (ns,) = derivatives of the torque of law m over the parameters at a fixed state.

    side  of the contact whose half gap is subtracted, 0 if the law belongs to no gap
    """
    for q in range(row.size):
        row[q] = 0.0
    if laws.arguments_vary[m] != 0:
        for k in range(2):
            for j in range(laws.first):
                e = out[1 + k] * x[j]
                for q in range(nq):
                    row[q] += e * laws.arguments[m, k, j, q + 1]
    for p in range(laws.parameters.shape[1]):
        e = out[3 + p]
        if e != 0.0:
            for q in range(nq):
                row[q] += e * laws.parameters[m, p, q + 1]
    if side != 0.0:
        e = -out[1] * side
        for q in range(nq):
            row[q] += e * laws.half_gap[m, q + 1]


@njit(**INLINED)
def gap_side(gap, m, mode):
    """Side of the contact that law m belongs to, 0 if it belongs to none."""
    return 1.0 - mode[gap[m]] if gap[m] >= 0 else 0.0


@njit(**COMPILE)
def set_holding_torque(s, c, laws, time):
    """Torque up to which each friction holds a body at rest: its level and what the laws add there."""
    for f in range(s.nf):
        c.holding_torque[f, 0] = s.level[f, 0]
    for m in range(laws.code.size):
        if laws.friction[m] >= 0:
            out = laws.torque_jets[0, m]
            law_torque(laws.torque, laws.code[m], 0.0, 0.0, time, 1.0, laws.parameters[m], out)
            c.holding_torque[laws.friction[m], 0] -= out[0]
