"""The inverse-dynamics regression of one body: torque over acceleration, speed, sign and one, filtered alike.

Without a noise model and without start values: less accurate than a fit of innovations where that one is right, and
a witness where it is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.identify.explanations.laws import Law
from drivetool.identify.explanations.motion import ORDER, Motions
from drivetool.identify.task import Task
from drivetool.logs.zero_phase import low_pass

COLUMNS = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque")
STANDING = 0.05  # of standstill in what the filter mixes into a sample, from which it is left out
BLOCKS = 16  # contiguous, so that errors may be correlated within (Bester, Conley, Hansen 2011)


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
    """Least squares of the free parameters and the laws' factors, the other parameters held at their values.

    source  Gautier, Janot and Vandanjon 2013, for the filters
    """
    is_angle, smoothing = seen.lag > 0, seen.smoothing
    rows, torques = [], []
    for i, (e, m) in enumerate(zip(task.experiments, seen.each, strict=True)):
        columns = np.column_stack([m.acceleration, m.speed, m.side, np.where(m.known, 1.0, np.nan),
                                   *(law.columns[i] for law in laws)])
        torque = np.where(m.known, e.signals["motor_torque"], np.nan)
        standing = np.where(m.known, m.slow & _beside(m.slow), np.nan)
        both = np.column_stack([torque, standing, columns])
        for j in range(both.shape[1]):
            # Acceleration, speed come from a motion that is smooth already.
            if j not in (2, 3):
                both[:, j] = low_pass(both[:, j], e.segments, smoothing.cutoff, ORDER)
            if is_angle and j != 2:  # a second difference of the angle weighs three torques so
                both[:, j] = _weighed(both[:, j])
        used = np.isfinite(both).all(axis=1) & (both[:, 1] < STANDING)
        edge = int(1.0 / smoothing.cutoff) + 1
        for first, last in e.segments:  # the filter's own transient
            used[first:first + edge] = used[max(last - edge, first):last] = False
        rows.append(both[used, 2:])
        torques.append(both[used, 0])
    return _solved(task, np.concatenate(rows), np.concatenate(torques), sum(law.size for law in laws))


def _solved(task: Task, rows: np.ndarray, torque: np.ndarray, more: int) -> Regression:
    held = [n for n in COLUMNS if n not in task.free]
    torque = torque - sum(rows[:, COLUMNS.index(n)] * (task.drive.value(n) or 0.0) for n in held)
    free = [COLUMNS.index(n) for n in task.free]
    rows = rows[:, [*free, *range(len(COLUMNS), len(COLUMNS) + more)]]
    size = np.sqrt(np.mean(rows**2, axis=0))
    size[size == 0.0] = 1.0
    rows = rows / size
    inverse = np.linalg.pinv(rows.T @ rows, rcond=1e-12, hermitian=True)
    values = inverse @ (rows.T @ torque)
    scores = rows * (torque - rows @ values)[:, None]
    block = np.arange(len(rows)) * BLOCKS // max(len(rows), 1)
    sums = np.array([scores[block == b].sum(axis=0) for b in range(BLOCKS)])
    names = (*task.free, *(f"motor.law{i + 1}" for i in range(more)))
    return Regression(names, values / size, sums @ inverse / size)


def _beside(slow: np.ndarray) -> np.ndarray:
    """Whether a neighbour is slow as well: a reversal at speed is no standstill."""
    return np.concatenate([slow[1:2], slow[:-1]]) | np.concatenate([slow[1:], slow[-1:]])


def _weighed(values: np.ndarray) -> np.ndarray:
    """Each with a quarter of its neighbours."""
    found = np.full(len(values), np.nan)
    found[1:-1] = 0.25 * (values[:-2] + values[2:]) + 0.5 * values[1:-1]
    return found
