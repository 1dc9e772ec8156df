"""What the files of the causes share: the base with more parameters, and how large things are in its records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from drivetool.check.starts.start import Bounds, Start

if TYPE_CHECKING:
    from drivetool.check.fit import Model
    from drivetool.identify.setup import Task

FAST = 0.03  # samples: a lag that is shorter leaves no trace
LATE = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # delays and lags in samples


def added(base: Model, values: Mapping[str, float], amplitudes: Sequence[str], held: Sequence[str] = ()) -> Start:
    """The base with more parameters: `values` start them, all but `held` are free."""
    task = base.fitted
    drive = replace(task.drive, values={**task.drive.values, **values})
    new = {n for n in values if n not in held}
    free = tuple(n for n in drive.quantities if n in {*task.free, *new})
    return Start(replace(task, drive=drive, free=free), tuple(amplitudes))


def present(base: Model, name: str) -> bool:
    """Whether a parameter acts in the base or is one of its free ones."""
    drive = base.task.drive
    return name in base.task.free or drive.value(name) not in (None, drive.quantity(name).neutral)


def torque_size(base: Model, owner: str = "") -> float:
    """Spread of the motor torque, or of what the gears make of it at a body or in a shaft."""
    return turns(base, owner) * float(np.std(np.concatenate([t.inputs[:, 0] for t in base.problem.traces])))


def largest_torque(base: Model, owner: str = "") -> float:
    """The largest torque of the motor, or what the gears make of it."""
    return turns(base, owner) * max(float(np.abs(t.inputs[:, 0]).max()) for t in base.problem.traces)


def turns(base: Model, owner: str = "") -> float:
    """Of the motor for one of a body, or of the end of a shaft that has its stiffness.

    owner  none, or a sum that the motor feels: one
    """
    drive = base.task.drive
    ends = {**dict(zip(drive.bodies, range(len(drive.bodies)), strict=True)),
            **{shaft: k + 1 for k, shaft in enumerate(drive.shafts)}}
    return abs(drive.turns()[ends.get(owner, 0)])


def motion(base: Model, body: str = "") -> tuple[float, float]:
    """(fastest speed of the motor, 98 % quantile, or of a body behind its gears; longest record [s])."""
    return (float(np.quantile(np.abs(np.concatenate(speeds(base))), 0.98)) / turns(base, body),
            max(t.size * t.step for t in base.problem.traces))


def speeds(base: Model) -> list[np.ndarray]:
    """Per trace (n,) the motor's speed, along a line where it was not measured."""
    found = []
    for t in base.problem.traces:
        y = t.outputs[:, 0]
        y = np.interp(np.arange(len(y)), np.flatnonzero(np.isfinite(y)), y[np.isfinite(y)])
        found.append(np.gradient(y, t.step) if base.task.roles.outputs[0].endswith("angle") else y)
    return found


def travel(base: Model) -> float:
    """The largest way of the motor in a record, from one end to the other."""
    angle = base.task.roles.outputs[0].endswith("angle")
    ways = []
    for t in base.problem.traces:
        y = t.outputs[:, 0]
        ways.append(float(np.nanmax(y) - np.nanmin(y)) if angle
                    else float(np.ptp(np.cumsum(np.nan_to_num(y)))) * t.step)
    return max(ways)


def outer_bodies(base: Model) -> tuple[str, ...]:
    """The bodies at which friction may be told apart: the last one only with more than one body."""
    bodies = base.task.drive.bodies
    return bodies[:1] if len(bodies) == 1 else (bodies[0], bodies[-1])


def bodies_without(base: Model, end: str, suffix: str) -> list[str]:
    """Of the motor, or of the bodies behind it (`end`: motor, load), those on which a friction does not act yet."""
    bodies = base.task.drive.bodies
    return [b for b in (bodies[:1] if end == "motor" else bodies[1:]) if not present(base, f"{b}.{suffix}")]


def on_any_body(base: Model, suffix: str) -> list[Start]:
    """One amplitude, on any body; none where a body has it."""
    names = [f"{body}.{suffix}" for body in base.task.drive.bodies]
    if any(present(base, n) for n in names):
        return []
    return [added(base, {n: 0.0}, (n,)) for n in names]


def likeliest(base: Model, starts: Sequence[Start]) -> list[Start]:
    """Of starts that differ in one value, the one under which the records are likeliest, all else held."""
    from drivetool.check.fit import carried
    from drivetool.identify.noise import filtered, minus_log_likelihood
    from drivetool.identify.problem import Point
    from drivetool.identify.setup import problem_of

    def loss(start: Start) -> float:
        task = start.task
        problem = problem_of(task.drive, (), task.roles, base.problem.traces)
        point = Point(np.empty(0), carried(base, start.task, problem).starts)
        return minus_log_likelihood(filtered(problem, point, base.noise, keep=False))
    return [min(starts, key=loss)]


def new_values(model: Model, base: Model, suffixes: str | tuple[str, ...]) -> Iterable[tuple[str, float]]:
    """(name, value) of the free parameters of a model that its base lacks and that end so."""
    return ((n, v) for n, v in zip(model.task.free, model.point.values, strict=True)
            if n.endswith(suffixes) and n not in base.task.free)


def of_lag(owner: str, order: float, base: Model) -> list[Start]:
    """A lag of some order, of the time that is likeliest: one that is taken for another order ends up elsewhere."""
    name, step = f"{owner}.bandwidth", base.problem.traces[0].step
    return likeliest(base, [added(base, {name: 1.0 / (n * step), f"{owner}.order": order}, (),
                                  held=(f"{owner}.order",)) for n in LATE])


def hardly_late(base: Model, name: str) -> Start:
    """A delay, or the lag of a bandwidth, of the shortest length that is tried."""
    time = LATE[0] * base.problem.traces[0].step
    return added(base, {name: 1.0 / time if name.endswith("bandwidth") else time}, ())


def no_faster(base: Model, task: Task) -> Bounds:
    """No lag faster than leaves a trace: contacts inside a sample would take ever longer."""
    most = 1.0 / (FAST * base.problem.traces[0].step)
    return {n: (0.0, most) for n in task.free if n.endswith(".bandwidth")}


def traceless(model: Model, base: Model) -> str:
    """Whether a lag is as short as is looked for: then the rest of its fit gains, and it is none."""
    high = dict(zip(model.task.free, model.problem.high, strict=True))
    short = any(v > 0.99 * high[n] for n, v in new_values(model, base, ".bandwidth"))
    return "it would be too short to leave a trace" if short else ""
