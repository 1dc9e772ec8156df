"""The drive's own parameters, read off a fit with laws, so that each means the same with laws and without."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.identify.laws import Law
from drivetool.identify.motion import Motions
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
    speed, side = seen.all("speed"), seen.all("side")
    moving = np.isfinite(speed) & (np.abs(speed) > STANDSTILL * seen.top)
    columns = {"motor.viscous": speed, "motor.coulomb": side, "motor.idle_torque": np.ones(len(speed))}
    # With one direction of motion only, Coulomb friction is not free, and is in the idle torque.
    friction = ("motor.viscous", "motor.coulomb" if "motor.coulomb" in free else "motor.idle_torque")
    parts = {"friction": friction, "idle torque": ("motor.idle_torque",)}
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
