"""Outputs: single states, or rows over the state, to which a contact may add its torque."""

from __future__ import annotations

from numba import njit

from drivetool.drive.compile import INLINED, NO_OVERLAP


@njit(**INLINED)
def output_row(outputs, spring, reach, output_gap, output_state, mode, m, x, row):
    """Output m at x; row (nx,) gets its derivative over the state."""
    v, measured = 0.0, output_state[m]
    for j in range(x.size):
        row[j] = outputs[m, j, 0]
    if measured >= 0:
        return x[measured]
    gap = output_gap[m]
    if gap >= 0 and mode[gap] != 1:
        for j in range(x.size):
            row[j] += spring[gap, j, 0]
        v -= (1.0 - mode[gap]) * reach[gap, 0]
    for j in range(x.size):
        v += row[j] * x[j]
    return v


@njit(**NO_OVERLAP)
def add_scaled(total, factor, other):
    """total (n,) += factor other."""
    for q in range(total.size):
        total[q] += factor * other[q]


@njit(**INLINED)
def output_gradient(outputs, spring, reach, output_gap, output_state, mode, m, x, row, sens, col):
    """Derivative of output m over the ns columns."""
    measured = output_state[m]
    for q in range(col.size):
        col[q] = sens[measured, q] if measured >= 0 else row[0] * sens[0, q]
    if measured >= 0:
        return
    own, gap = col[:outputs.shape[2] - 1], output_gap[m]
    for j in range(x.size):
        if j > 0:
            add_scaled(col, row[j], sens[j])
        add_scaled(own, x[j], outputs[m, j, 1:])
    if gap >= 0 and mode[gap] != 1:
        for j in range(x.size):
            add_scaled(own, x[j], spring[gap, j, 1:])
        add_scaled(own, mode[gap] - 1.0, reach[gap, 1:])
