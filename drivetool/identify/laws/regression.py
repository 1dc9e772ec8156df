"""The inverse-dynamics regression of one body as a candidate of the default fit.

It needs no noise model and no start values. It is less accurate than an innovations fit whose noise model is right,
and an independent estimate where that is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.identify.laws.laws import Law
from drivetool.identify.motion import Motions, Rows, at_standstill, change_of, equations, influence_of, inverse_of
from drivetool.identify.setup import Task

REGRESSION_PARAMETERS = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque")


@dataclass(frozen=True)
class Regression:
    """A solution.

    values     (k,) of the free parameters, then of the laws' factors
    influence  (BLOCKS, k) each block's share of their error
    """

    names: tuple[str, ...]
    values: np.ndarray
    influence: np.ndarray


def is_regressable(task: Task) -> bool:
    """Whether the drive is one body on which nothing but inertia, friction and idle torque acts."""
    drive = task.drive
    known = {n for n, v in drive.values.items() if v != drive.quantity(n).neutral} | set(task.free)
    return task.roles.inputs == ("motor_torque",) and len(drive.bodies) == 1 and known <= set(REGRESSION_PARAMETERS)


def regress(task: Task, seen: Motions, laws: Sequence[Law] = ()) -> Regression:
    """Least squares of the free parameters and the laws' factors, the other parameters held at their values."""
    factors = tuple(f"motor.law{i + 1}" for i in range(sum(law.size for law in laws)))
    names = (*task.free, *factors)
    drive = replace(task.drive, known_torques=factors)
    rows = []
    for i, (e, m) in enumerate(zip(task.experiments, seen.each, strict=True)):
        columns = np.column_stack([np.empty((e.size, 0)), *(law.on_grid(i) for law in laws)])
        q = equations(e, drive, names, seen, m, at_standstill(m.slow), dict(zip(factors, columns.T, strict=True)))
        rows.append(Rows(q.residual[q.used], q.slopes[q.used], q.slopes[q.used]))
    inverse = inverse_of(rows)
    change = change_of(rows, inverse)
    residuals = [replace(r, residual=r.residual - r.slopes @ change) for r in rows]
    values = np.array([drive.value(n) or 0.0 for n in names]) + change
    return Regression(names, values, influence_of(residuals, inverse))
