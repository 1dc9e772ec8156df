"""The inverse-dynamics regression of one body as a candidate and referee of the default fit.

Without a noise model and without start values: less accurate than a fit of innovations where that one is right, and
a witness where it is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.identify.laws.laws import Law
from drivetool.identify.motion import Motions, Rows, change_of, equations, influence_of, inverse_of, stands
from drivetool.identify.setup import Task

COLUMNS = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque")


@dataclass(frozen=True)
class Regression:
    """A solution.

    values     (k,) of the free parameters, then of the laws' factors
    influence  (BLOCKS, k) each block's share of their error
    """

    names: tuple[str, ...]
    values: np.ndarray
    influence: np.ndarray


def regressable(task: Task) -> bool:
    """Whether the drive is one body on which nothing but inertia, friction and idle torque acts."""
    drive = task.drive
    known = {n for n, v in drive.values.items() if v != drive.quantity(n).neutral} | set(task.free)
    return task.roles.inputs == ("motor_torque",) and len(drive.bodies) == 1 and known <= set(COLUMNS)


def regress(task: Task, seen: Motions, laws: Sequence[Law] = ()) -> Regression:
    """Least squares of the free parameters and the laws' factors, the other parameters held at their values."""
    factors = tuple(f"motor.law{i + 1}" for i in range(sum(law.size for law in laws)))
    names = (*task.free, *factors)
    drive = replace(task.drive, known_torques=factors)
    rows = []
    for i, (e, m) in enumerate(zip(task.experiments, seen.each, strict=True)):
        columns = np.column_stack([np.empty((e.size, 0)), *(law.columns[i] for law in laws)])
        q = equations(e, drive, names, seen, m, stands(m.slow), dict(zip(factors, columns.T, strict=True)))
        rows.append(Rows(q.residual[q.used], q.slopes[q.used], q.slopes[q.used]))
    inverse = inverse_of(rows)
    change = change_of(rows, inverse)
    left = [replace(r, residual=r.residual - r.slopes @ change) for r in rows]
    values = np.array([drive.value(n) or 0.0 for n in names]) + change
    return Regression(names, values, influence_of(left, inverse))
