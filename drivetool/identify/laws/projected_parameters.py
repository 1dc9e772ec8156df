"""The drive's own parameters, projected from a fit with laws, so that each means the same with laws and without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from drivetool.identify.laws.laws import Law, places_of
from drivetool.identify.motion import Motions
from drivetool.identify.plateaus import STANDSTILL_SPEED_SHARE
from drivetool.identify.setup import Task
from drivetool.quantity import name_of, owner_of, quantity_of

# Parameter of a body -> the sum over all bodies that may be fitted in its place.
SUM_OF_BODIES = {"viscous": "total.viscous", "idle_torque": "total.idle_torque"}


def projection_of_laws(task: Task, laws: Sequence[Law], seen: Mapping[str, Motions]) -> np.ndarray:
    """(k, k + m) projection of the k free parameters and the laws' m factors to the drive's own parameters.

    Friction is the line Fc + B v nearest to the whole curve over the speeds visited. The inertia is its mean over
    the angles visited. The idle torque has the mean of all else.
    seen    the motion of each body
    source  White 1982: the value nearest to the truth is what a fit of a wrong model estimates
    """
    free, width = list(task.free), sum(law.size for law in laws)
    found = np.hstack([np.eye(len(free)), np.zeros((len(free), width))])
    for law, own in zip(laws, places_of(laws, len(free)), strict=True):
        if law.of == "inertia" and name_of(law.body, "inertia") in free:
            found[free.index(name_of(law.body, "inertia")), own] = law.inertia
        parts = {"friction": ("viscous", _friction_constant_name(task, law.body)),
                 "idle torque": ("idle_torque",)}.get(law.of, ())
        names = {part: name for part in parts if (name := _free_parameter_of(task, law.body, part))}
        if names:
            columns, moving = _friction_regressors(seen[law.body])
            rows = np.column_stack([columns[part] for part in names])[moving]
            share = np.linalg.lstsq(rows, np.concatenate([law.on_grid(k) for k in range(len(law.columns))])[moving],
                                    rcond=None)[0]
            for name, row in zip(names.values(), share, strict=True):
                found[free.index(name), own] = row * _referred_factor(task, law.body, name)
    return found


def projected_within_bounds(task: Task, own: np.ndarray, seen: Mapping[str, Motions]) -> np.ndarray:
    """(k,) own parameters inside their bounds: friction that falls over the speed becomes the nearest constant."""
    free, found = list(task.free), own.copy()
    bounds = np.array([task.drive.quantity(n).bounds for n in free])
    for body, motions in seen.items():
        part = _friction_constant_name(task, body)
        viscous, constant = _free_parameter_of(task, body, "viscous"), _free_parameter_of(task, body, part)
        if viscous and constant and found[free.index(viscous)] < 0.0:
            columns, moving = _friction_regressors(motions)
            constant_column, speed = columns[part][moving], columns["viscous"][moving]
            change = found[free.index(viscous)] * (constant_column @ speed) / (constant_column @ constant_column)
            found[free.index(constant)] += (change * _referred_factor(task, body, constant)
                                            / _referred_factor(task, body, viscous))
            found[free.index(viscous)] = 0.0
    return np.clip(found, bounds[:, 0], bounds[:, 1])


def _friction_constant_name(task: Task, body: str) -> str:
    """Parameter that holds the constant part of friction: the idle torque where one direction was recorded."""
    return "coulomb" if _free_parameter_of(task, body, "coulomb") else "idle_torque"


def _free_parameter_of(task: Task, body: str, part: str) -> str:
    """The free parameter that contains a part of a body's torque: the body's, the sum, or the motor's."""
    first = task.drive.bodies[0]
    names = (name_of(body, part), SUM_OF_BODIES.get(part, name_of(first, part)))
    return next((n for n in names if n in task.free), "")


def _referred_factor(task: Task, body: str, name: str) -> float:
    """Factor of a body's torque in a parameter, referred through the gears."""
    part = quantity_of(name)
    return 1.0 if owner_of(name) == body else task.drive.referred_share(name_of(body, part))


def _friction_regressors(seen: Motions) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """(regressor of each parameter, (n,) where the body moves)."""
    speed = seen.all("speed")
    moving = np.isfinite(speed) & (np.abs(speed) > STANDSTILL_SPEED_SHARE * seen.top)
    return {"viscous": speed, "coulomb": seen.all("side"), "idle_torque": np.ones(len(speed))}, moving
