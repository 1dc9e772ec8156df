"""A drive with one more body: the third mass, and start states for another structure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.check.fit.model import Model
from drivetool.drive import END_MASS, Drive
from drivetool.identify.laws import third_mass_names, with_split_load
from drivetool.identify.problem import Point, Problem
from drivetool.identify.setup import Task, problem_of
from drivetool.quantity import name_of, owner_of, with_parts

INTERMEDIATE_MASS = "middle"


def may_have_third_mass(drive: Drive) -> bool:
    """Whether the last body can be split in two: a kernel for more than three bodies is no two-mass one."""
    return len(drive.bodies) == 2


def third_mass_of(longer: Drive) -> str:
    """The body that was added to a drive, behind the others or between them."""
    return INTERMEDIATE_MASS if INTERMEDIATE_MASS in longer.bodies else END_MASS


def with_end_mass(base: Model, share: float, frequency_ratio: float, zeta: float) -> Task | None:
    """The base with its last body split in two, see `split_off`."""
    return with_split_load(base.fitted, base.problem.traces[0].step, share, frequency_ratio, zeta)


def with_large_end_mass(base: Model, share: float, frequency_ratio: float, zeta: float) -> Task | None:
    """As `with_end_mass`, with the resonance, the anti-resonance (motor held) and the total inertia of the base.

    A large third mass that is only split off shifts them, and the records are thousands of units less likely.
    None, too, where no drive with this third mass has them.

    source  the load inertia referred to the motor's shaft, times (1 - s) + s / (1 - (w/w2)^2): Den Hartog
            1956, Mechanical Vibrations, section 3.2
    """
    task, old = with_end_mass(base, share, frequency_ratio, zeta), base.fitted.drive
    if task is None:
        return None
    first, last, shaft = old.bodies[0], old.bodies[-1], old.shafts[0]
    jm, jl, ks, cs = (old.value(n)
                      for n in (name_of(first, "inertia"), name_of(last, "inertia"), name_of(shaft, "stiffness"),
                                name_of(shaft, "damping")))
    gear = old.gear_ratios()[-1] ** 2
    held, free = ks / jl, ks * (1.0 / jl + 1.0 / (gear * jm))  # squares of the frequencies
    own = frequency_ratio**2 * free
    at_held, at_free = ((1.0 - share) + share / (1.0 - square / (own * (1.0 - share))) for square in (held, free))
    remaining = at_free * free - at_held * held
    if min(at_held, at_free, remaining) <= 0.0:
        return None
    load = (gear * jm + jl) / (1.0 + held * at_held * at_free / remaining)
    stiffer = held * load * at_held / ks
    inertia, stiffness, damping = third_mass_names(old)
    values = {name_of(first, "inertia"): (gear * jm + jl - load) / gear,
              name_of(last, "inertia"): (1.0 - share) * load,
              name_of(shaft, "stiffness"): stiffer * ks, name_of(shaft, "damping"): stiffer * cs,
              inertia: share * load,
              stiffness: own * share * (1.0 - share) * load, damping: 2.0 * zeta * np.sqrt(own) * share * load}
    return task.at({n: v for n, v in values.items() if n in task.free})


def with_intermediate_mass(base: Model, share: float, twist_share: float) -> Task:
    """The base with a body in its shaft and the same lowest resonance.

    Where the load has its own sensor, a mass in front of it differs from one behind it.

    share        of the last body's inertia that goes to the new one
    twist_share  of the twist between the motor and the new body
    """
    task = base.fitted
    drive, shaft = task.drive, task.drive.shafts[0]
    first, last = drive.bodies
    jm, jl, ks, cs = (drive.value(n)
                      for n in (name_of(first, "inertia"), name_of(last, "inertia"), name_of(shaft, "stiffness"),
                                name_of(shaft, "damping")))
    masses = np.array([jm * drive.gear_ratios()[-1] ** 2, share * jl, (1.0 - share) * jl])
    shafts = np.array([ks / twist_share, ks / (1.0 - twist_share)])
    incidence = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]) / np.sqrt(masses)
    lowest = np.linalg.eigvalsh(incidence.T @ (shafts[:, None] * incidence))[1]
    scale = ks * (1.0 / masses[0] + 1.0 / jl) / lowest
    inertia, stiffness, damping = third_mass_names(drive, INTERMEDIATE_MASS)
    values = {**drive.values, name_of(last, "inertia"): masses[2], inertia: masses[1],
              name_of(shaft, "stiffness"): scale * shafts[0], stiffness: scale * shafts[1],
              name_of(shaft, "damping"): cs / twist_share, damping: cs / (1.0 - twist_share)}
    longer = Drive("three-mass with a middle", (first, INTERMEDIATE_MASS, last), (shaft, owner_of(stiffness)),
                   values,
                   drive.torque_unit, drive.motion_unit, drive.damping_law, records=drive.records,
                   input_unit=drive.input_unit, constants=drive.constants)
    return replace(task, drive=longer).with_free({*task.free, inertia, stiffness, damping})


def without_intermediate_mass(task: Task, before: Drive) -> Task:
    """The task with its intermediate mass merged into the last body, and the two shafts in series into one."""
    inertia, stiffness, damping = third_mass_names(before, INTERMEDIATE_MASS)
    shaft, last, values = before.shafts[0], before.bodies[-1], dict(task.drive.values)
    values[name_of(last, "inertia")] += values.pop(inertia)
    for own, further in ((name_of(shaft, "stiffness"), stiffness), (name_of(shaft, "damping"), damping)):
        one, other = values[own], values.pop(further)
        values[own] = one * other / (one + other) if one + other > 0.0 else 0.0
    drive = replace(before, values=values)
    return replace(task, drive=drive).with_free(task.free)


def without_third_mass(task: Task, before: Drive) -> Task:
    """The task as it was before a third mass was split off."""
    return (without_intermediate_mass if third_mass_of(task.drive) == INTERMEDIATE_MASS
            else without_end_mass)(task, before)


def without_end_mass(task: Task, before: Drive) -> Task:
    """The task with its third mass merged into the last body; what acts on the one acts on the other.

    before  the drive before that was split off
    """
    names, last = third_mass_names(before), before.bodies[-1]
    values: dict[str, float] = {}
    for name, value in task.drive.values.items():
        own = with_parts(name, owner=last) if owner_of(name) == END_MASS else name
        summed = own != name or with_parts(own, owner=END_MASS) in task.drive.values
        values |= {own: values.get(own, 0.0) + value if summed else value} if name not in names[1:] else {}
    free = {with_parts(n, owner=last) if owner_of(n) == END_MASS else n for n in task.free if n not in names}
    return replace(task, drive=replace(before, values=values)).with_free(free)


def transferred_point(base: Model, task: Task, problem: Problem) -> Point:
    """The base's estimate as a point of another task: start states by their names."""
    old, new = list(base.problem.states), list(problem.states)
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
            elif name in (f"{END_MASS}.speed", f"{INTERMEDIATE_MASS}.speed"):
                x[j] = start[old.index(f"{base.task.drive.bodies[-1]}.speed")]
        if third_mass_of(task.drive) == INTERMEDIATE_MASS and INTERMEDIATE_MASS not in base.task.drive.bodies:
            _split_twist(x, new, task.drive)
        starts.append(x)
    return Point(np.array([task.drive.value(n) for n in task.free], float), tuple(starts))


def on_task(model: Model, task: Task) -> Model:
    """A model at its estimate as that of another task over the same records, not fitted yet."""
    problem = problem_of(task.drive, task.free, task.roles, model.problem.traces)
    return replace(model, task=task, problem=problem, point=transferred_point(model, task, problem))


def _split_twist(x: np.ndarray, states: list[str], drive: Drive) -> None:
    """Split the twist of one shaft between the two that replace it."""
    one, other = (drive.value(name_of(s, "stiffness")) for s in drive.shafts)
    at = [states.index(f"{s}.twist") for s in drive.shafts]
    x[at] = x[at[0]] * np.array([other, one]) / (one + other)
