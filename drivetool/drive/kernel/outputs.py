"""What the sensors see: states, or rows over the state to which the torque of a contact may belong."""

from __future__ import annotations

from numba import njit

from drivetool.drive.compile import APART, HOT


@njit(**HOT)
def output_row(outputs, spring, reach, output_gap, picks, mode, m, x, row):
    """Output m at x; row (nx,) gets its derivative over the state."""
    v, pick = 0.0, picks[m]
    for j in range(x.size):
        row[j] = outputs[m, j, 0]
    if pick >= 0:
        return x[pick]
    gap = output_gap[m]
    if gap >= 0 and mode[gap] != 1:
        for j in range(x.size):
            row[j] += spring[gap, j, 0]
        v -= (1.0 - mode[gap]) * reach[gap, 0]
    for j in range(x.size):
        v += row[j] * x[j]
    return v


@njit(**APART)
def add_scaled(total, factor, other):
    """total (n,) += factor other."""
    for q in range(total.size):
        total[q] += factor * other[q]


@njit(**HOT)
def output_gradient(outputs, spring, reach, output_gap, picks, mode, m, x, row, big, col):
    """Derivative of output m over the ns columns."""
    pick = picks[m]
    for q in range(col.size):
        col[q] = big[pick, q] if pick >= 0 else row[0] * big[0, q]
    if pick >= 0:
        return
    own, gap = col[:outputs.shape[2] - 1], output_gap[m]
    for j in range(x.size):
        if j > 0:
            add_scaled(col, row[j], big[j])
        add_scaled(own, x[j], outputs[m, j, 1:])
    if gap >= 0 and mode[gap] != 1:
        for j in range(x.size):
            add_scaled(own, x[j], spring[gap, j, 1:])
        add_scaled(own, mode[gap] - 1.0, reach[gap, 1:])
