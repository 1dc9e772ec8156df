"""Helpers of the causes: the base with more parameters, and the size of torque, speed and travel in its records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from drivetool.check.starts.start import Bounds, Start
from drivetool.identify.problem import Point
from drivetool.quantity import name_of, names_of, quantity_of

if TYPE_CHECKING:
    from drivetool.check.fit import Model
    from drivetool.identify.setup import Task

# Of the torque's standard deviation, as a start of friction: small enough for a linear step.
NEGLIGIBLE_FRICTION_SHARE = 1e-6
MIN_LAG_SAMPLES = 0.03  # samples. A choice: a shorter lag is below what a record resolves
# Delays and lags in samples; a choice: factors of two, below one sample to a filter's eight.
DELAY_STARTS_IN_SAMPLES = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)


def start_with(base: Model, values: Mapping[str, float], amplitudes: Sequence[str],
               fixed: Sequence[str] = ()) -> Start:
    """The base with more parameters, started at `values`; all but `fixed` are free."""
    task = base.fitted
    drive = replace(task.drive, values={**task.drive.values, **values})
    new = {n for n in values if n not in fixed}
    return Start(replace(task, drive=drive).with_free({*task.free, *new}), tuple(amplitudes))


def is_present(base: Model, name: str) -> bool:
    """Whether a parameter acts in the base or is one of its free ones."""
    drive = base.task.drive
    return name in base.task.free or drive.value(name) not in (None, drive.quantity(name).neutral)


def torque_size(base: Model, owner: str = "") -> float:
    """Standard deviation of the motor torque, or of its value behind the gears at a body or in a shaft."""
    return gear_ratio(base, owner) * float(np.std(np.concatenate([t.inputs[:, 0] for t in base.problem.traces])))


def largest_torque(base: Model, owner: str = "") -> float:
    """The largest motor torque, or its value behind the gears."""
    return gear_ratio(base, owner) * max(float(np.abs(t.inputs[:, 0]).max()) for t in base.problem.traces)


def gear_ratio(base: Model, owner: str = "") -> float:
    """Turns of the motor for one turn of a body, or of the shaft end that the stiffness refers to.

    owner  none, or a sum referred to the motor: one
    """
    drive = base.task.drive
    ends = {**dict(zip(drive.bodies, range(len(drive.bodies)), strict=True)),
            **{shaft: k + 1 for k, shaft in enumerate(drive.shafts)}}
    return abs(drive.gear_ratios()[ends.get(owner, 0)])


def speed_and_duration(base: Model, body: str = "") -> tuple[float, float]:
    """(fastest speed of the motor, 98 % quantile, or of a body behind its gears; longest record [s])."""
    return (float(np.quantile(np.abs(np.concatenate(speeds(base))), 0.98)) / gear_ratio(base, body),
            max(t.size * t.step for t in base.problem.traces))


def speeds(base: Model) -> list[np.ndarray]:
    """Per trace (n,) the motor's speed, interpolated where it was not measured."""
    found = []
    for t in base.problem.traces:
        y = t.outputs[:, 0]
        y = np.interp(np.arange(len(y)), np.flatnonzero(np.isfinite(y)), y[np.isfinite(y)])
        found.append(np.gradient(y, t.step) if base.task.roles.outputs[0].endswith("angle") else y)
    return found


def travel(base: Model) -> float:
    """The largest travel of the motor in a record, from one end to the other."""
    angle = base.task.roles.outputs[0].endswith("angle")
    ways = []
    for t in base.problem.traces:
        y = t.outputs[:, 0]
        ways.append(float(np.nanmax(y) - np.nanmin(y)) if angle
                    else float(np.ptp(np.cumsum(np.nan_to_num(y)))) * t.step)
    return max(ways)


def outer_bodies(base: Model) -> tuple[str, ...]:
    """The bodies whose friction may be distinguishable: the first and the last."""
    bodies = base.task.drive.bodies
    return bodies[:1] if len(bodies) == 1 else (bodies[0], bodies[-1])


def bodies_without(base: Model, end: str, suffix: str) -> list[str]:
    """Of the motor, or of the bodies behind it (`end`: motor, load), those on which a friction does not act yet."""
    bodies = base.task.drive.bodies
    return [b for b in (bodies[:1] if end == "motor" else bodies[1:]) if not is_present(base, name_of(b, suffix))]


def starts_on_any_body(base: Model, suffix: str) -> list[Start]:
    """One amplitude, on any body; none where a body has it."""
    names = names_of(base.task.drive.bodies, suffix)
    if any(is_present(base, n) for n in names):
        return []
    return [start_with(base, {n: 0.0}, (n,)) for n in names]


def likeliest_start(base: Model, starts: Sequence[Start]) -> list[Start]:
    """Of starts that differ in one value, the one under which the records are likeliest, all else held."""
    from drivetool.check.fit import transferred_point
    from drivetool.identify.noise import filtered, minus_log_likelihood
    from drivetool.identify.setup import problem_of

    def loss(start: Start) -> float:
        task = start.task
        problem = problem_of(task.drive, (), task.roles, base.problem.traces)
        point = Point(np.empty(0), transferred_point(base, start.task, problem).starts)
        return minus_log_likelihood(filtered(problem, point, base.noise, keep=False))
    return [min(starts, key=loss)]


def new_values(model: Model, base: Model, *quantities: str) -> Iterable[tuple[str, float]]:
    """(name, value) of the free parameters of a model that its base lacks, of these quantities."""
    return ((n, v) for n, v in zip(model.task.free, model.point.values, strict=True)
            if quantity_of(n) in quantities and n not in base.task.free)


def lag_starts(owner: str, order: float, base: Model) -> list[Start]:
    """A lag of some order, of the likeliest time: the best time depends on the order."""
    name, step = name_of(owner, "bandwidth"), base.problem.traces[0].step
    return likeliest_start(base, [start_with(base, {name: 1.0 / (n * step), name_of(owner, "order"): order}, (),
                                  fixed=(name_of(owner, "order"),)) for n in DELAY_STARTS_IN_SAMPLES])


def shortest_delay(base: Model, name: str) -> Start:
    """A delay, or the lag of a bandwidth, of the shortest tested length."""
    time = DELAY_STARTS_IN_SAMPLES[0] * base.problem.traces[0].step
    return start_with(base, {name: 1.0 / time if quantity_of(name) == "bandwidth" else time}, ())


def lag_bounds(base: Model, task: Task) -> Bounds:
    """No lag shorter than is detectable: contacts within a sample would cost ever more steps."""
    most = 1.0 / (MIN_LAG_SAMPLES * base.problem.traces[0].step)
    return {n: (0.0, most) for n in task.free if quantity_of(n) == "bandwidth"}


def too_short_to_detect(model: Model, base: Model) -> str:
    """Whether a lag is at its lower bound: then the gain comes from the other parameters."""
    high = dict(zip(model.task.free, model.problem.high, strict=True))
    short = any(v > 0.99 * high[n] for n, v in new_values(model, base, "bandwidth"))
    return "its time constant would be too short to be identifiable" if short else ""
