"""Shaft torque in a record, and how often the shaft's gap opens and is crossed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Assembly, Layout
from drivetool.finding import Finding
from drivetool.identify.noise import Noise, filtered, fit_ratio
from drivetool.identify.setup import Task, first_point, with_trial_values
from drivetool.quantity import name_of, names_of


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


def contact_of(task: Task, shaft: int) -> Contact:
    """The contact of a shaft, from a Kalman pass with the drive as it is."""
    problem = task.problem(free=())
    point = first_point(task.drive, problem, task.roles)
    noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale))
    plain, spring = shaft_torque_row(task, shaft, problem.traces[0].step)
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


def shaft_torque_row(task: Task, shaft: int, step: float) -> tuple[Assembly, np.ndarray]:
    """(the drive's equations, (nx,) torque of a shaft over its states if its gap were closed)."""
    plain = Assembly(task.drive, Layout((), task.roles.inputs, task.roles.outputs, step, gradient=False))
    spring = np.zeros(plain.nx)
    for j, dual in plain.in_contact(shaft).items():
        spring[j] = dual.v
    return plain, spring


def opened_gap_findings(task: Task, treatment: str) -> list[Finding]:
    """Findings on shafts whose torque changes sign in the records, unless their half gap is stated as zero.

    lacking  how the step treats a gap, in words
    """
    found = []
    for i, shaft in enumerate(task.drive.shafts):
        name = name_of(shaft, "half_gap")
        if task.drive.values.get(name) == 0.0:
            continue
        seen = contact_of(with_closed_gaps(task), i)
        if seen.reverses:
            found.append(Finding(
                "warning", "gap-may-open",
                f"The torque of {shaft} reaches from {seen.least:.3g} to {seen.most:.3g} {task.drive.torque_unit}: "
                f"a backlash gap, if present, opens where it changes sign, and {treatment}.",
                {"least_shaft_torque": seen.least, "largest_shaft_torque": seen.most},
                "Use torque steps upward from a constant speed; if there is no gap, state it with "
                f"--set {name}=0."))
    return found


def with_closed_gaps(task: Task) -> Task:
    """The task with the gaps closed."""
    names = names_of(task.drive.shafts, "half_gap")
    return replace(task, drive=with_trial_values(task.drive, names, np.zeros(len(names))))
