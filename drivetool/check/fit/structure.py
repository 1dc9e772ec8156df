"""A drive with one body more: the third mass, and start states that fit another structure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.check.fit.model import Model
from drivetool.drive import TIP, Drive
from drivetool.identify.laws import split_off, tip_names
from drivetool.identify.problem import Point, Problem
from drivetool.identify.setup import Task

MIDDLE = "middle"


def may_have_tip(drive: Drive) -> bool:
    """Whether the last body can be split in two: a kernel for more than three bodies is no two-mass one."""
    return len(drive.bodies) == 2


def third_of(longer: Drive) -> str:
    """The body that a drive has been given, behind the others or between them."""
    return MIDDLE if MIDDLE in longer.bodies else TIP


def with_tip(base: Model, share: float, times: float, zeta: float) -> Task | None:
    """The base with its last body split in two, see `split_off`."""
    return split_off(base.fitted, base.problem.traces[0].step, share, times, zeta)


def with_large_tip(base: Model, share: float, times: float, zeta: float) -> Task | None:
    """As `with_tip`, but what the base knows stays: its resonance, the one behind a held motor, and all inertia.

    A large third mass that is split off only shifts them, and the records are thousands of units less likely.
    None, too, where no drive with this third mass has them.

    source  the load as the motor's shaft feels it, (1 - s) + s / (1 - (w/w2)^2) times its inertia: Den Hartog
            1956, Mechanical Vibrations, section 3.2
    """
    task, old = with_tip(base, share, times, zeta), base.fitted.drive
    if task is None:
        return None
    first, last, shaft = old.bodies[0], old.bodies[-1], old.shafts[0]
    jm, jl, ks, cs = (old.value(n) for n in (f"{first}.inertia", f"{last}.inertia", f"{shaft}.stiffness",
                                             f"{shaft}.damping"))
    gear = old.turns()[-1] ** 2
    held, free = ks / jl, ks * (1.0 / jl + 1.0 / (gear * jm))  # squares of the frequencies
    own = times**2 * free
    at_held, at_free = ((1.0 - share) + share / (1.0 - square / (own * (1.0 - share))) for square in (held, free))
    left = at_free * free - at_held * held
    if min(at_held, at_free, left) <= 0.0:
        return None
    load = (gear * jm + jl) / (1.0 + held * at_held * at_free / left)
    stiffer = held * load * at_held / ks
    inertia, stiffness, damping = tip_names(old)
    values = {f"{first}.inertia": (gear * jm + jl - load) / gear, f"{last}.inertia": (1.0 - share) * load,
              f"{shaft}.stiffness": stiffer * ks, f"{shaft}.damping": stiffer * cs, inertia: share * load,
              stiffness: own * share * (1.0 - share) * load, damping: 2.0 * zeta * np.sqrt(own) * share * load}
    return task.at({n: v for n, v in values.items() if n in task.free})


def with_middle(base: Model, share: float, place: float) -> Task:
    """The base with a body in its shaft, whose lowest resonance stays where it is.

    Where the load has a sensor of its own a mass in front of that is another thing than one behind it.

    share  of the last body's inertia that goes to the new one
    place  of the twist, that is between the motor and the new one
    """
    task = base.fitted
    drive, shaft = task.drive, task.drive.shafts[0]
    first, last = drive.bodies
    jm, jl, ks, cs = (drive.value(n) for n in (f"{first}.inertia", f"{last}.inertia", f"{shaft}.stiffness",
                                               f"{shaft}.damping"))
    masses = np.array([jm * drive.turns()[-1] ** 2, share * jl, (1.0 - share) * jl])
    shafts = np.array([ks / place, ks / (1.0 - place)])
    across = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]) / np.sqrt(masses)
    lowest = np.linalg.eigvalsh(across.T @ (shafts[:, None] * across))[1]
    scale = ks * (1.0 / masses[0] + 1.0 / jl) / lowest
    inertia, stiffness, damping = tip_names(drive, MIDDLE)
    values = {**drive.values, f"{last}.inertia": masses[2], inertia: masses[1],
              f"{shaft}.stiffness": scale * shafts[0], stiffness: scale * shafts[1],
              f"{shaft}.damping": cs / place, damping: cs / (1.0 - place)}
    longer = Drive("three-mass with a middle", (first, MIDDLE, last), (shaft, stiffness.split(".")[0]), values,
                   drive.torque_unit, drive.motion_unit, drive.damping_law, records=drive.records,
                   input_unit=drive.input_unit, constants=drive.constants)
    return replace(task, drive=longer, free=tuple(
        n for n in longer.quantities if n in {*task.free, inertia, stiffness, damping}))


def without_middle(task: Task, before: Drive) -> Task:
    """The task with its middle mass one with the last body again, and the two shafts in series one."""
    inertia, stiffness, damping = tip_names(before, MIDDLE)
    shaft, last, values = before.shafts[0], before.bodies[-1], dict(task.drive.values)
    values[f"{last}.inertia"] += values.pop(inertia)
    for own, further in ((f"{shaft}.stiffness", stiffness), (f"{shaft}.damping", damping)):
        one, other = values[own], values.pop(further)
        values[own] = one * other / (one + other) if one + other > 0.0 else 0.0
    drive = replace(before, values=values)
    return replace(task, drive=drive, free=tuple(n for n in drive.quantities if n in task.free))


def without_third(task: Task, before: Drive) -> Task:
    """The task as it was before a third mass was split off."""
    return (without_middle if third_of(task.drive) == MIDDLE else without_tip)(task, before)


def without_tip(task: Task, before: Drive) -> Task:
    """The task with its third mass one with the last body again; what acts on the one acts on the other.

    before  the drive before that was split off
    """
    names, last = tip_names(before), before.bodies[-1]
    values: dict[str, float] = {}
    for name, value in task.drive.values.items():
        own = name.replace(f"{TIP}.", f"{last}.")
        summed = own != name or f"{TIP}.{own.removeprefix(f'{last}.')}" in task.drive.values
        values |= {own: values.get(own, 0.0) + value if summed else value} if name not in names[1:] else {}
    free = {n.replace(f"{TIP}.", f"{last}.") for n in task.free if n not in names}
    drive = replace(before, values=values)
    return replace(task, drive=drive, free=tuple(n for n in drive.quantities if n in free))


def carried(base: Model, task: Task, problem: Problem) -> Point:
    """The point of another task that keeps what the base knows: start states by their names."""
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
            elif name in (f"{TIP}.speed", f"{MIDDLE}.speed"):
                x[j] = start[old.index(f"{base.task.drive.bodies[-1]}.speed")]
        if third_of(task.drive) == MIDDLE and MIDDLE not in base.task.drive.bodies:
            _shared(x, new, task.drive)
        starts.append(x)
    return Point(np.array([task.drive.value(n) for n in task.free], float), tuple(starts))


def _shared(x: np.ndarray, states: list[str], drive: Drive) -> None:
    """Share the twist of what was one shaft between the two that it has become."""
    one, other = (drive.value(f"{s}.stiffness") for s in drive.shafts)
    at = [states.index(f"{s}.twist") for s in drive.shafts]
    x[at] = x[at[0]] * np.array([other, one]) / (one + other)
