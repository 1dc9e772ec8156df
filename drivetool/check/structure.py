"""A drive with one body more: the third mass, and start states that fit another structure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.check.model import Model
from drivetool.drive.assemble import Assembly, Layout
from drivetool.drive.chain import Drive
from drivetool.identify.engine import Task
from drivetool.identify.problem import Point, Problem

SHARES = (0.2,)  # of the load's inertia that the third mass takes, to start from
TIMES = (0.6, 1.5, 3.0)  # its frequency over that of the first resonance
MOST = 0.4  # of the sampling rate: what rings faster leaves no trace


def with_third_mass(base: Model) -> list[Task]:
    """The base with its last body split in two by one more shaft, at several frequencies."""
    task = base.fitted
    drive = task.drive
    if not drive.shafts or len(drive.bodies) > 2:
        return []
    body, shaft = "tip", f"shaft{len(drive.bodies)}"
    last, first = drive.bodies[-1], drive.bodies[0]
    jl, jm, ks = (drive.value(n) for n in (f"{last}.inertia", f"{first}.inertia", f"{drive.shafts[0]}.stiffness"))
    resonance = np.sqrt(ks * (jl + jm) / (jl * jm))
    found = []
    for share in SHARES:
        for times in TIMES:
            rate = times * resonance
            if rate > 2.0 * np.pi * MOST / base.problem.traces[0].step:
                continue
            inertia = share * jl
            stiffness = rate**2 * inertia * (1.0 - share)
            values = {**drive.values, f"{last}.inertia": (1.0 - share) * jl, f"{body}.inertia": inertia,
                      f"{shaft}.stiffness": stiffness, f"{shaft}.damping": 0.04 * stiffness / rate}
            longer = Drive("three-mass with a tip", (*drive.bodies, body), (*drive.shafts, shaft), values,
                           drive.torque_unit, drive.motion_unit, drive.damping_law)
            new = {f"{body}.inertia", f"{shaft}.stiffness", f"{shaft}.damping"}
            free = tuple(n for n in longer.quantities if n in {*task.free, *new})
            # The load's sensors stay where they were.
            found.append(replace(task, drive=longer, free=free))
    return found


def states_of(task: Task, step: float) -> list[str]:
    """Names of the states of a task's model."""
    layout = Layout(task.free, task.roles.inputs, task.roles.outputs, step, gradient=False)
    return Assembly(task.drive, layout).states


def carried(base: Model, task: Task, problem: Problem) -> Point:
    """The point of another task that keeps what the base knows: start states by their names."""
    old = states_of(base.task, problem.traces[0].step)
    new = states_of(task, problem.traces[0].step)
    starts = []
    for start, trace in zip(base.point.starts, problem.traces, strict=True):
        x = np.zeros(len(new))
        for j, name in enumerate(new):
            if name in old:
                x[j] = start[old.index(name)]
            elif name == "converter":
                x[j] = trace.inputs[0, 0]
            elif name == "motor_speed.filtered":
                x[j] = start[0]
            elif name == "tip.speed":
                x[j] = start[old.index(f"{base.task.drive.bodies[-1]}.speed")]
        starts.append(x)
    return Point(np.array([task.drive.value(n) for n in task.free], float), tuple(starts))
