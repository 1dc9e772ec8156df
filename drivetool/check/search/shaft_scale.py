"""The scale of a shaft torque sensor, fitted together with the drive and with all that was found.

Held against the motor alone it comes out to a few per cent where the record is short. What that leaves tells as
much as a missing law, but without the laws that are missing another scale may stand in for them: so it is asked
last.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from drivetool.check.faults import BLAMED, SCALE, rescaled
from drivetool.check.fit import BROKEN, Masks, Model, everything, fit, judge, unlikely
from drivetool.check.search.decision import LEAST, SURPLUS
from drivetool.check.search.result import Searched
from drivetool.drive import GEARED
from drivetool.identify.noise import by_parabolas
from drivetool.identify.problem import Point
from drivetool.logs import Experiment

ROLE = "shaft_torque"
STEP = 0.01  # relative change of the scale, of a first step
FAR = 0.3  # beyond, the motor alone tells it
CLOSE = 5e-4  # of a scale to one that was tried, for which another fit does not pay
POWERS = {"inertia": 2, **GEARED}  # of the turns of the motor for one of a body, by which what it has counts less
ROUNDS = 4  # of a fit with another scale
TRIED = 3  # widths over which the curvature is looked at


class Scaled(NamedTuple):
    """The records with another scale of their shaft torque.

    factor   by which the sensor is too large; std its standard error
    records, values  with the factor undone, and the drive fitted to those
    """

    factor: float
    std: float
    records: tuple[Experiment, ...]
    values: Mapping[str, float]


def scale_beside(search: Searched, records: Sequence[Experiment]) -> Scaled | None:
    """The scale of the shaft torque beside what was found, None where there is no sensor or it is right.

    records  that the search was over
    """
    model = search.model
    if ROLE not in model.task.roles.outputs:
        return None
    with suppress(*BROKEN):
        log, std, lead, other = likeliest(model, everything(model.problem))
        factor = float(np.exp(log))
        sure = unlikely(lead, 1) > np.log(1.0 / search.options.error_budget)
        if abs(factor - 1.0) > max(SCALE, BLAMED * factor * std) and sure:
            return Scaled(factor, factor * std, rescaled(records, factor), other.fitted.drive.values)
    return None


def likeliest(model: Model, masks: Masks) -> tuple[float, float, float, Model]:
    """(log of the factor that makes all that was measured most likely, its std, what it gains, the model so).

    A torque noise that makes up for a wrong scale bends the likelihood away from a parabola: so downhill by ever
    longer steps first. The std is infinite where it has no maximum nearby.
    """
    count, known = measured_samples(model, masks), {0.0: with_scale(model, 1.0, masks)}

    def at(log: float) -> float:
        if log not in known:
            near = min(known, key=lambda other: abs(other - log))
            known[log] = with_scale(known[near], float(np.exp(log - near)), masks)
        return known[log].value + count * log

    side = STEP if at(STEP) < at(-STEP) else -STEP
    way = [-side, 0.0, side]
    while at(way[-1]) < at(way[-2]) and abs(way[-1]) < FAR:
        way.append(3.0 * way[-1] - 2.0 * way[-2])
    log = by_parabolas(at, np.array(way), close=CLOSE)
    return log, _width(at, log), at(0.0) - at(log), known[log]


def _width(value: Callable[[float], float], at: float) -> float:
    """Standard deviation by the curvature over about three of them on either side."""
    reach = STEP
    for _ in range(TRIED):
        bend = (value(at - reach) - 2.0 * value(at) + value(at + reach)) / reach**2
        if not bend > 0.0:
            return np.inf
        std = float(1.0 / np.sqrt(bend))
        if reach < 4.0 * std:
            return std
        reach = 3.0 * std
    return std


def with_scale(model: Model, factor: float, masks: Masks) -> Model:
    """The model fitted to its records with their shaft torque divided by a factor."""
    column = model.task.roles.outputs.index(ROLE)
    over = np.where(np.arange(len(model.noise.scale)) == column, factor, 1.0)
    traces = tuple(replace(t, outputs=t.outputs / over) for t in model.problem.traces)
    problem, noise = replace(model.problem, traces=traces), replace(model.noise, scale=model.noise.scale / over)
    start = min((model.point, _shared_anew(model, factor)), key=lambda p: judge(problem, p, noise, masks))
    return fit(replace(model, problem=problem, point=start, noise=noise), masks, most=ROUNDS)


def _shared_anew(model: Model, factor: float) -> Point:
    """All behind the shaft smaller by the factor, and what that loses given to the motor: it moves as before."""
    drive, own = model.fitted.drive, dict(zip(model.task.free, model.point.values.tolist(), strict=True))
    motor, turns = drive.bodies[0], dict(zip(drive.bodies, drive.turns(), strict=True))
    for name, value in list(own.items()):
        owner, _, suffix = name.rpartition(".")
        if owner in drive.shafts and suffix in ("stiffness", "damping"):
            own[name] = value / factor
        elif owner in drive.bodies[1:] and suffix in POWERS:
            own[name] = value / factor
            if f"{motor}.{suffix}" in own:
                own[f"{motor}.{suffix}"] += (value - own[name]) * turns[owner] ** -POWERS[suffix]
    values = np.clip(np.array(list(own.values())), model.problem.low, model.problem.high)
    return replace(model.point, values=values)


def measured_samples(model: Model, masks: Masks) -> int:
    """How many samples of the shaft torque count."""
    column = model.task.roles.outputs.index(ROLE)
    return sum(int(np.isfinite(t.outputs[mask, column]).sum())
               for t, mask in zip(model.problem.traces, masks, strict=True))


def likelier_so(again: Searched, search: Searched, factor: float) -> bool:
    """Whether a search over records with a factor undone explains all that was measured better than one without."""
    samples = measured_samples(search.model, everything(search.model.problem))
    lead = search.model.value - again.model.value - samples * float(np.log(abs(factor)))
    return lead > LEAST + SURPLUS * (1 + len(again.model.task.free) - len(search.model.task.free))
