"""How far the values of a cause may go while it is looked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.check.candidates import motion, turns
from drivetool.check.model import Model
from drivetool.check.structure import third_of
from drivetool.identify.engine import Task
from drivetool.identify.problem import Problem
from drivetool.identify.third_mass import tip_names

FAST = 0.03  # samples: a lag that is shorter leaves no trace
SLOWEST = 3.0  # lengths of the record: a warm-up that takes longer is a constant by another name
QUICKEST = 0.05  # the same: one that takes less is a start by another name
THIRD = 10.0  # by which inertia, stiffness and damping of a third mass may leave their start
LIGHTEST = 0.002  # damping ratio below which none falls: it would ring through the record, and steel does not


def bounded(problem: Problem, base: Model, task: Task) -> Problem:
    """No lag faster than leaves a trace, no Stribeck speed that the record never leaves behind, no endless warm-up.

    Nor a third mass far from where it was looked for: it would ring as fast as nothing in the record, at length.
    With so short a lag contacts inside a sample take ever longer; with so high a speed, or in so long a time, the
    surplus is constant friction by another name.
    """
    low, high, third = problem.low.copy(), problem.high.copy(), _third(task, base)
    for j, name in enumerate(task.free):
        if name.endswith(".bandwidth"):
            high[j] = min(high[j], 1.0 / (FAST * problem.traces[0].step))
        elif name.endswith(".stribeck_speed"):
            high[j] = min(high[j], motion(base, name.rpartition(".")[0])[0])
        elif name.endswith(".drift_time"):
            low[j], high[j] = (share * motion(base)[1] for share in (QUICKEST, SLOWEST))
        elif name.endswith(".viscous_asymmetry"):
            body = name.rpartition(".")[0]
            most = turns(base, body) * max(float(np.abs(t.inputs[:, 0]).max()) for t in problem.traces)
            most /= motion(base, body)[0]
            low[j], high[j] = max(low[j], -most), min(high[j], most)
        elif name in third:
            low[j], high[j] = max(low[j], third[name][0]), min(high[j], third[name][1])
    return replace(problem, low=low, high=high)


def _third(task: Task, base: Model) -> dict[str, tuple[float, float]]:
    """Bounds of a third mass that the base lacks, from where it starts; looked for damped, it may be so less."""
    if task.drive.bodies == base.task.drive.bodies:
        return {}
    names = tip_names(base.task.drive, third_of(task.drive))
    inertia, stiffness, damping = (task.drive.value(n) for n in names)
    least = 2.0 * LIGHTEST * float(np.sqrt(stiffness * inertia))
    return dict(zip(names, ((inertia / THIRD, inertia * THIRD), (stiffness / THIRD, stiffness * THIRD),
                            (min(damping, least), max(damping, least) * THIRD)), strict=True))
