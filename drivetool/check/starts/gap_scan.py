"""A likelihood scan over the whole range of half gaps: where a fit with a gap may start."""

from __future__ import annotations

import numpy as np

from drivetool.check.fit import Model
from drivetool.identify.backlash import MAX_GAP_STARTS, local_minima
from drivetool.identify.noise import filtered, minus_log_likelihood
from drivetool.identify.problem import Point
from drivetool.identify.setup import problem_of
from drivetool.quantity import with_parts

# Half gaps over the twist by the torque, in steps of 19 %: a stiff shaft twists little, so gaps may be many
# times that.
HALF_GAP_TO_TWIST_GRID = np.geomspace(0.003, 300.0, 67)


def half_gaps(base: Model, name: str, torque: float) -> list[float]:
    """Half gaps at local optima of the likelihood, all else fixed: one Kalman pass each."""
    task = base.fitted
    twist = torque / task.drive.value(with_parts(name, quantity="stiffness"))

    def loss(value: float) -> float:
        problem = problem_of(task.at({name: value}).drive, (), task.roles, base.problem.traces)
        point = Point(np.empty(0), base.point.starts)
        return minus_log_likelihood(filtered(problem, point, base.noise, keep=False))

    values = np.array([loss(share * twist) for share in HALF_GAP_TO_TWIST_GRID])
    return [float(HALF_GAP_TO_TWIST_GRID[i] * twist) for i in local_minima(values)[:MAX_GAP_STARTS]]
