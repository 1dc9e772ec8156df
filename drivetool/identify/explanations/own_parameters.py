"""The drive's own parameters, read off a fit with laws, so that each means the same with laws and without."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.identify.explanations.laws import Law
from drivetool.identify.explanations.motion import Motions
from drivetool.identify.task import Task

STANDSTILL = 0.01  # of the top speed: below it friction has no line


def nearest_line(task: Task, laws: Sequence[Law], seen: Motions) -> np.ndarray:
    """(k, k + m) from the k free parameters and the laws' m factors to the drive's own parameters.

    Friction is the line Fc + B v nearest to the whole curve over the speeds visited, the inertia its mean over the
    angles visited; the idle torque has the mean of all else.
    source  White 1982: the value nearest to the truth is what a fit of a wrong model estimates
    """
    free, width = list(task.free), sum(law.size for law in laws)
    found = np.hstack([np.eye(len(free)), np.zeros((len(free), width))])
    columns, moving = _columns(seen)
    parts = {"friction": ("motor.viscous", _level(free)), "idle torque": ("motor.idle_torque",)}
    place = len(free)
    for law in laws:
        names = [n for n in parts.get(law.of, ()) if n in free]
        if law.of == "inertia":
            found[free.index("motor.inertia"), place:place + law.size] = law.inertia
        elif names:
            rows = np.column_stack([columns[n] for n in names])[moving]
            share = np.linalg.lstsq(rows, np.concatenate(law.columns)[moving], rcond=None)[0]
            found[[free.index(n) for n in names], place:place + law.size] = share
        place += law.size
    return found


def within_bounds(task: Task, own: np.ndarray, seen: Motions) -> np.ndarray:
    """(k,) own parameters inside their bounds: of friction that falls over the speed, the nearest level is left."""
    free, found = list(task.free), own.copy()
    bounds = np.array([task.drive.quantity(n).bounds for n in free])
    level = _level(free)
    if "motor.viscous" in free and level in free and found[free.index("motor.viscous")] < 0.0:
        columns, moving = _columns(seen)
        flat, speed = columns[level][moving], columns["motor.viscous"][moving]
        found[free.index(level)] += found[free.index("motor.viscous")] * (flat @ speed) / (flat @ flat)
    return np.clip(found, bounds[:, 0], bounds[:, 1])


def _level(free: Sequence[str]) -> str:
    """What holds the level of friction: the idle torque where only one direction was recorded."""
    return "motor.coulomb" if "motor.coulomb" in free else "motor.idle_torque"


def _columns(seen: Motions) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """(what each parameter multiplies, (n,) where the body moves)."""
    speed = seen.all("speed")
    moving = np.isfinite(speed) & (np.abs(speed) > STANDSTILL * seen.top)
    columns = {"motor.viscous": speed, "motor.coulomb": seen.all("side"), "motor.idle_torque": np.ones(len(speed))}
    return columns, moving
