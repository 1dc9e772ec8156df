"""What a record says about a drive before any shaft is looked at: total inertia and friction.

Seen through a filter slower than its slowest resonance, a drive is one body: torque = inertia *
acceleration + viscous * speed + Coulomb * sign + idle torque. That is linear in the unknowns and
needs no start values, so it takes the largest errors out of rough ones. How the totals are shared
between the bodies is left as it was.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.identify.setup import Task

PERIODS = 2.0  # of the slowest resonance that the filter is long
ONE_WAY = 0.99  # share of the filter's window in which the motion must have one direction
KNOWN = 0.3  # relative std up to which a figure counts
LEAST = 12  # equations
TOTALS = ("inertia", "viscous", "coulomb", "idle_torque")


def balanced(task: Task) -> Task:
    """The task with its free inertias and frictions scaled so that their sums agree with the record.

    Held values and carried masses stay. Where the record does not tell a sum, or torques other than the motor's
    act, nothing changes.
    """
    found = totals(task)
    if found is None:
        return task
    new: dict[str, float] = {}
    carried = sum(task.drive.inertias()) - sum(task.drive.value(f"{b}.inertia") or 0.0 for b in task.drive.bodies)
    for suffix, (value, std) in found.items():
        names = [n for n in task.drive.quantities if n.endswith(f".{suffix}")
                 and (n in task.drive.values or n in task.free)]
        free = [n for n in names if n in task.free]
        rest = value - sum(task.drive.value(n) or 0.0 for n in names if n not in free)
        rest -= carried if suffix == "inertia" else 0.0
        if not free or rest <= 0.0 or not std < KNOWN * value:
            continue
        now = sum(task.drive.value(n) or 0.0 for n in free)
        for n in free:
            new[n] = (task.drive.value(n) or 0.0) * rest / now if now > 0.0 else rest / len(free)
    return task.at(new)


def totals(task: Task) -> dict[str, tuple[float, float]] | None:
    """(value, std) of the sums over all bodies, by robust regression; None if they cannot be told."""
    drive, role = task.drive, task.roles.outputs[0]
    ratios = [drive.value(f"{s}.ratio") for s in drive.shafts]
    if task.roles.inputs != ("motor_torque",) or not role.startswith("motor") or any(r != 1.0 for r in ratios):
        return None
    window = PERIODS / slowest_resonance(task)
    rows, torques = [], []
    for e in task.experiments:
        for a, b in e.segments:
            motion = e.signals[role][a:b]
            speed = motion if role.endswith("speed") else np.gradient(motion, e.step)
            row, torque = _equations(speed, e.signals["motor_torque"][a:b], e.step, window)
            rows.append(row)
            torques.append(torque)
    matrix, right = np.concatenate(rows), np.concatenate(torques)
    if len(right) < LEAST:
        return None
    values, std = _robust(matrix, right)
    return dict(zip(TOTALS, zip(values.tolist(), std.tolist(), strict=True), strict=True))


def slowest_resonance(task: Task) -> float:
    """Lowest natural frequency of the chain with closed gaps [Hz]."""
    drive = task.drive
    inertia = np.array(drive.inertias())
    stiffness = np.zeros((len(inertia), len(inertia)))
    for k, shaft in enumerate(drive.shafts):
        both = np.array([1.0, -1.0])
        stiffness[k:k + 2, k:k + 2] += drive.value(f"{shaft}.stiffness") * np.outer(both, both)
    root = np.sqrt(np.outer(inertia, inertia))
    squares = np.linalg.eigvalsh(stiffness / root)
    return float(np.sqrt(squares[1])) / 2.0 / np.pi if len(inertia) > 1 else 10.0


def _equations(speed: np.ndarray, torque: np.ndarray, step: float,
               window: float) -> tuple[np.ndarray, np.ndarray]:
    """(rows (m, 4), torques (m,)) where the filtered motion keeps its direction."""
    size = max(3, round(window / step))
    if len(speed) < 3 * size:
        return np.zeros((0, 4)), np.zeros(0)
    weights = np.ones(size) / size
    weights = np.convolve(weights, weights)  # a triangle, twice as smooth
    u, w, sign = (np.convolve(v, weights, "valid") for v in (torque, speed, np.sign(speed)))
    rows = np.column_stack([np.gradient(w, step), w, sign, np.ones(len(w))])
    good = np.isfinite(rows).all(axis=1) & np.isfinite(u) & (np.abs(sign) > ONE_WAY)
    every = max(1, size // 2)
    return rows[good][::every], u[good][::every]


def _robust(matrix: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, Sequence[float]]:
    """Least squares with Cauchy weights: (values, their std)."""
    size = np.sqrt(np.mean(matrix**2, axis=0))
    size[size == 0.0] = 1.0
    scaled, weight = matrix / size, np.ones(len(right))
    for _ in range(10):
        values = np.linalg.lstsq(scaled * weight[:, None], right * weight, rcond=None)[0]
        error = right - scaled @ values
        spread = max(1.48 * float(np.median(np.abs(error))), 1e-12 * float(np.abs(right).max()) + 1e-300)
        weight = 1.0 / np.sqrt(1.0 + (error / (2.0 * spread)) ** 2)
    matrix = scaled * weight[:, None]
    std = spread * np.sqrt(np.diag(np.linalg.pinv(matrix.T @ matrix, hermitian=True)))
    return values / size, std / size
