"""A cheap look at the whole range of half gaps: where a fit with a gap may start."""

from __future__ import annotations

import numpy as np

from drivetool.check.fit import Model
from drivetool.identify.backlash import valleys
from drivetool.identify.noise import filtered, minus_log_likelihood
from drivetool.identify.problem import Point
from drivetool.identify.setup import problem_of

GAPS = np.geomspace(0.003, 300.0, 67)  # half gaps over the twist that the torque makes: a stiff shaft twists little
KEPT = 3  # valleys that are worth a fit


def half_gaps(base: Model, name: str, torque: float) -> list[float]:
    """Half gaps at which the likelihood has its valleys, all else held: one Kalman pass each."""
    task = base.fitted
    twist = torque / task.drive.value(name.split(".")[0] + ".stiffness")

    def look(value: float) -> float:
        problem = problem_of(task.at({name: value}).drive, (), task.roles, base.problem.traces)
        point = Point(np.empty(0), base.point.starts)
        return minus_log_likelihood(filtered(problem, point, base.noise, keep=False))

    values = np.array([look(share * twist) for share in GAPS])
    return [float(GAPS[i] * twist) for i in valleys(values)[:KEPT]]
