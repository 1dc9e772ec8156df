"""The drive's own parameters, read off a fit with laws, so that each means the same with laws and without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.identify.laws.laws import Law
from drivetool.identify.motion import Motions
from drivetool.identify.setup import Task

STANDSTILL = 0.01  # of the top speed: below it friction has no line
# Parameters of a body, and the sum over all bodies that may be fitted in their place.
SUMS = {"viscous": "total.viscous", "idle_torque": "total.idle_torque"}


def nearest_line(task: Task, laws: Sequence[Law], seen: Mapping[str, Motions]) -> np.ndarray:
    """(k, k + m) from the k free parameters and the laws' m factors to the drive's own parameters.

    Friction is the line Fc + B v nearest to the whole curve over the speeds visited, the inertia its mean over the
    angles visited; the idle torque has the mean of all else.
    seen    the motion of each body
    source  White 1982: the value nearest to the truth is what a fit of a wrong model estimates
    """
    free, width = list(task.free), sum(law.size for law in laws)
    found = np.hstack([np.eye(len(free)), np.zeros((len(free), width))])
    place = len(free)
    for law in laws:
        own = slice(place, place + law.size)
        place += law.size
        if law.of == "inertia" and f"{law.body}.inertia" in free:
            found[free.index(f"{law.body}.inertia"), own] = law.inertia
        parts = {"friction": ("viscous", _level(task, law.body)), "idle torque": ("idle_torque",)}.get(law.of, ())
        names = {part: name for part in parts if (name := _fitted(task, law.body, part))}
        if names:
            columns, moving = _columns(seen[law.body])
            rows = np.column_stack([columns[part] for part in names])[moving]
            share = np.linalg.lstsq(rows, np.concatenate(law.columns)[moving], rcond=None)[0]
            for name, row in zip(names.values(), share, strict=True):
                found[free.index(name), own] = row * _felt(task, law.body, name)
    return found


def within_bounds(task: Task, own: np.ndarray, seen: Mapping[str, Motions]) -> np.ndarray:
    """(k,) own parameters inside their bounds: of friction that falls over the speed, the nearest level is left."""
    free, found = list(task.free), own.copy()
    bounds = np.array([task.drive.quantity(n).bounds for n in free])
    for body, motions in seen.items():
        part = _level(task, body)
        viscous, level = _fitted(task, body, "viscous"), _fitted(task, body, part)
        if viscous and level and found[free.index(viscous)] < 0.0:
            columns, moving = _columns(motions)
            flat, speed = columns[part][moving], columns["viscous"][moving]
            change = found[free.index(viscous)] * (flat @ speed) / (flat @ flat)
            found[free.index(level)] += change * _felt(task, body, level) / _felt(task, body, viscous)
            found[free.index(viscous)] = 0.0
    return np.clip(found, bounds[:, 0], bounds[:, 1])


def _level(task: Task, body: str) -> str:
    """What holds the level of friction: the idle torque where only one direction was recorded."""
    return "coulomb" if _fitted(task, body, "coulomb") else "idle_torque"


def _fitted(task: Task, body: str, part: str) -> str:
    """The free parameter that has a part of a body's torque in it, of the body, the sum, or the motor."""
    first = task.drive.bodies[0]
    names = (f"{body}.{part}", SUMS.get(part, f"{first}.{part}"))
    return next((n for n in names if n in task.free), "")


def _felt(task: Task, body: str, name: str) -> float:
    """What a parameter has of one of a body's, behind the gears."""
    part = name.partition(".")[2]
    return 1.0 if name.startswith(f"{body}.") else task.drive.felt_share(f"{body}.{part}")


def _columns(seen: Motions) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """(what each parameter multiplies, (n,) where the body moves)."""
    speed = seen.all("speed")
    moving = np.isfinite(speed) & (np.abs(speed) > STANDSTILL * seen.top)
    return {"viscous": speed, "coulomb": seen.all("side"), "idle_torque": np.ones(len(speed))}, moving
