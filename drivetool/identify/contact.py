"""What the shaft does in a record: its torque, and how often its gap opens and is crossed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivetool.drive.assemble import Assembly, Layout
from drivetool.identify.engine import Task
from drivetool.identify.noise import Noise, filtered, fit_ratio
from drivetool.identify.problem import Point
from drivetool.identify.setup import first_states


@dataclass(frozen=True)
class Contact:
    """Shaft torque and contact of one shaft over the records, from filtered states.

    least, most  shaft torque [torque unit] if the gap were closed
    reverses     whether it changes sign
    opened       times the contact was lost; crossed: times the other side was reached
    open_share   share of the samples in the gap
    """

    least: float
    most: float
    reverses: bool
    opened: int
    crossed: int
    open_share: float


def contact(task: Task, shaft: int) -> Contact:
    """The contact of a shaft, from a Kalman pass with the drive as it is."""
    problem = task.problem(free=())
    point = Point(np.empty(0), first_states(task.drive, task.roles, problem.traces))
    noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale))
    layout = Layout((), task.roles.inputs, task.roles.outputs, problem.traces[0].step, gradient=False)
    plain = Assembly(task.drive, layout)
    spring = np.zeros(plain.nx)
    for j, dual in plain.spring(shaft, damped=task.drive.damping_law == "inside").items():
        spring[j] = dual.v
    reach = plain.shafts[shaft][0].v * (plain.gaps[shaft].v if shaft in plain.gaps else 0.0)
    torque, sides = [], []
    for passed in filtered(problem, point, noise):
        settled = passed.states[len(passed.states) // 50:]  # past the guess of the start state
        torque.append(settled @ spring)
        sides.append(np.where(torque[-1] > reach, 1, np.where(torque[-1] < -reach, -1, 0)))
    opened = crossed = 0
    for s in sides:
        steps = s[np.flatnonzero(np.diff(s, prepend=s[0] - 1))]
        opened += int(np.sum((steps[:-1] != 0) & (steps[1:] != steps[:-1])))
        touched = steps[steps != 0]
        crossed += int(np.sum(touched[1:] != touched[:-1]))
    all_torque, all_sides = np.concatenate(torque), np.concatenate(sides)
    # Robust ends: a filter's single outlier is not a sign change.
    least, most = np.quantile(all_torque, [0.001, 0.999])
    return Contact(float(least), float(most), bool(least < 0.0 < most), opened, crossed,
                   float(np.mean(all_sides == 0)))
