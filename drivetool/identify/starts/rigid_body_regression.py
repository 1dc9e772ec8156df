"""Total inertia and friction of a drive by regression, as if it were one rigid body.

Seen through a filter slower than its slowest resonance, a drive is one body: torque = inertia *
acceleration + viscous * speed + Coulomb * sign + idle torque. That is linear in the unknowns and
needs no start values, so it removes the largest errors of poor ones. The shares of the bodies in
the totals stay as they were.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.identify.setup import Task
from drivetool.quantity import name_of, quantity_of

FILTER_PERIODS = 2.0  # length of the filter in periods of the slowest resonance, a choice: its triangle damps them
# Share of the filter's window in one direction, a choice: a reversal mixes both signs of friction.
MIN_ONE_DIRECTION_SHARE = 0.99
MAX_RELATIVE_STD = 0.3  # relative std up to which a total is used: above, a poor start value is no worse
MIN_EQUATIONS = 12  # equations, a choice: three for each of the four unknowns
REGRESSED_TOTALS = ("inertia", "viscous", "coulomb", "idle_torque")


def scaled_to_totals(task: Task) -> Task:
    """The task with its free inertias and frictions scaled so that their sums agree with the record.

    Held values and carried masses stay. Where a sum is not identifiable, or torques other than the motor's act,
    nothing changes.
    """
    found = regressed_totals(task)
    if found is None:
        return task
    new: dict[str, float] = {}
    carried = sum(task.drive.inertias()) - sum(task.drive.value(name_of(b, "inertia")) or 0.0
                                               for b in task.drive.bodies)
    for suffix, (value, std) in found.items():
        names = [n for n in task.drive.quantities if quantity_of(n) == suffix
                 and (n in task.drive.values or n in task.free)]
        free = [n for n in names if n in task.free]
        rest = value - sum(task.drive.value(n) or 0.0 for n in names if n not in free)
        rest -= carried if suffix == "inertia" else 0.0
        if not free or rest <= 0.0 or not std < MAX_RELATIVE_STD * value:
            continue
        now = sum(task.drive.value(n) or 0.0 for n in free)
        for n in free:
            new[n] = (task.drive.value(n) or 0.0) * rest / now if now > 0.0 else rest / len(free)
    return task.at(new)


def regressed_totals(task: Task) -> dict[str, tuple[float, float]] | None:
    """(value, std) of the sums over all bodies, by robust regression; None if they are not identifiable."""
    drive, role = task.drive, task.roles.outputs[0]
    ratios = [drive.value(name_of(s, "ratio")) for s in drive.shafts]
    if task.roles.inputs != ("motor_torque",) or not role.startswith("motor") or any(r != 1.0 for r in ratios):
        return None
    window = FILTER_PERIODS / slowest_resonance(task)
    parts = []
    for e in task.experiments:
        for a, b in e.segments:
            motion = e.signals[role][a:b]
            speed = motion if role.endswith("speed") else np.gradient(motion, e.step)
            parts.append(_filtered_equations(speed, e.signals["motor_torque"][a:b], e.step, window))
    matrix, right = (np.concatenate(each) for each in zip(*parts, strict=True))
    if len(right) < MIN_EQUATIONS:
        return None
    values, std = _cauchy_regression(matrix, right)
    return dict(zip(REGRESSED_TOTALS, zip(values.tolist(), std.tolist(), strict=True), strict=True))


def slowest_resonance(task: Task) -> float:
    """Lowest natural frequency of the chain with closed gaps [Hz]."""
    drive = task.drive
    inertia = np.array(drive.inertias())
    stiffness = np.zeros((len(inertia), len(inertia)))
    for k, shaft in enumerate(drive.shafts):
        both = np.array([1.0, -1.0])
        stiffness[k:k + 2, k:k + 2] += drive.value(name_of(shaft, "stiffness")) * np.outer(both, both)
    root = np.sqrt(np.outer(inertia, inertia))
    squares = np.linalg.eigvalsh(stiffness / root)
    return float(np.sqrt(squares[1])) / 2.0 / np.pi if len(inertia) > 1 else 10.0


def _filtered_equations(speed: np.ndarray, torque: np.ndarray, step: float,
                        window: float) -> tuple[np.ndarray, np.ndarray]:
    """(rows (m, 4), torques (m,)) where the filtered motion keeps its direction."""
    size = max(3, round(window / step))
    if len(speed) < 3 * size:
        return np.zeros((0, 4)), np.zeros(0)
    weights = np.ones(size) / size
    weights = np.convolve(weights, weights)  # a triangle, twice as smooth
    filtered_torque, w, sign = (np.convolve(v, weights, "valid") for v in (torque, speed, np.sign(speed)))
    rows = np.column_stack([np.gradient(w, step), w, sign, np.ones(len(w))])
    good = np.isfinite(rows).all(axis=1) & np.isfinite(filtered_torque) & (np.abs(sign) > MIN_ONE_DIRECTION_SHARE)
    every = max(1, size // 2)
    return rows[good][::every], filtered_torque[good][::every]


def _cauchy_regression(matrix: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, Sequence[float]]:
    """Least squares with Cauchy weights: (values, their std)."""
    size = np.sqrt(np.mean(matrix**2, axis=0))
    size[size == 0.0] = 1.0
    scaled, weight = matrix / size, np.ones(len(right))
    for _ in range(10):
        values = np.linalg.lstsq(scaled * weight[:, None], right * weight, rcond=None)[0]
        error = right - scaled @ values
        error_scale = max(1.48 * float(np.median(np.abs(error))), 1e-12 * float(np.abs(right).max()) + 1e-300)
        weight = 1.0 / np.sqrt(1.0 + (error / (2.0 * error_scale)) ** 2)
    matrix = scaled * weight[:, None]
    std = error_scale * np.sqrt(np.diag(np.linalg.pinv(matrix.T @ matrix, hermitian=True)))
    return values / size, std / size
