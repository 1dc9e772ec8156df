"""Where the fit of a cause begins on top of a model, and what one linear step from there promises."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.causes import FITTED, Cause
from drivetool.check.fit import Masks, Model, alone, begun, carried, first_noise, judge, linear_step
from drivetool.check.starts import Start
from drivetool.drive.simulation import Gains
from drivetool.identify.noise import filtered, normal_under, with_state
from drivetool.identify.problem import Point, Problem, marquardt_step
from drivetool.identify.setup import Task, problem_of


@dataclass(frozen=True)
class Stand:
    """A model without the cause.

    own    what a linear step of its own parameters gains: nothing where it is fitted
    gains  of its filter, per trace; states: their names
    """

    model: Model
    own: float
    gains: tuple[Gains, ...]
    states: tuple[str, ...]


@dataclass(frozen=True)
class Begun:
    """A start that may be fitted.

    model    not fitted yet, where a linear step of the amplitudes leads; other: where one of everything does
    promise  log likelihood that one linear step would gain over one without the cause
    std      amplitude -> its standard deviation at the stand, the cause's others zero
    stand    number of its stand
    """

    cause: Cause
    model: Model
    promise: float
    std: Mapping[str, float]
    other: Point | None = None
    stand: int = 0

    @property
    def kind(self) -> tuple[object, ...]:
        """What tells it from a start that differs in numbers only."""
        return (self.stand, *kind_of(self.model))

    def ready(self, masks: Masks) -> Model:
        """The model at the likelier of both points; from zero the limits of the usual steps would take many."""
        if self.other is None:
            return self.model
        return min((self.model, replace(self.model, point=self.other)),
                   key=lambda m: judge(m.problem, m.point, m.noise, masks))


def stand_at(model: Model) -> Stand:
    """A model as a stand."""
    passes = filtered(model.problem, model.point, model.noise)
    gains = tuple(f.gains for f in passes)
    normal = model.problem.with_memory(model.noise.memory).normal(with_state(model.point, model.noise), gains)
    _, _, gain = linear_step(model.problem, normal, np.ones(len(model.task.free), bool))
    return Stand(model, max(log_gain(gain, model.problem), 0.0), gains, model.problem.states)


def kind_of(model: Model) -> tuple[object, ...]:
    """What is fitted, and the choices in a drive that are no numbers to be fitted."""
    drive = model.task.drive
    return model.task.free, *(drive.value(n) for n, q in drive.quantities.items() if q.choice)


def begin(stand: Stand, cause: Cause, start: Start, masks: Masks) -> Begun:
    """A start on top of a stand, and what it promises.

    Amplitudes begin at zero, where the filter is that of the stand. Where the likelihood is rough the noise of the
    stand may be far from that of the start: it is heard there too.
    """
    own, task = stand.model, start.task
    problem = bounded(problem_of(task.drive, task.free, task.roles, own.problem.traces), own, task)
    model = begun(cause.code, task, problem, carried(own, task, problem), own.noise)
    if start.amplitudes and problem.states == stand.states:
        value, normal = own.value, problem.with_memory(own.noise.memory).normal(
            with_state(model.point, own.noise), stand.gains)
    else:
        model = _heard(model, masks) if cause.rough else model
        value = judge(problem, model.point, model.noise, masks)
        normal = normal_under(problem, model.point, model.noise)
    moves = np.array([n in start.amplitudes or n in own.task.free or not start.amplitudes for n in task.free])
    step, std, gain = linear_step(problem, normal, moves)
    promise = own.value - value + log_gain(gain, problem) - stand.own
    if not start.amplitudes:
        return Begun(cause, model, promise if np.isfinite(promise) else -np.inf, {})
    told = np.array([n in start.amplitudes and cause.has(n) for n in task.free])
    std = np.where(told, alone(problem, normal, told, moves & ~told), std)
    values = model.point.values.copy()
    at = [task.free.index(name) for name in start.amplitudes]
    values[at] = np.clip(values[at] + step[at], problem.low[at], problem.high[at])
    if np.all(values[at] == problem.low[at]):
        promise = 0.0
    whole = problem.moved(model.point, *marquardt_step(problem, model.point, normal, 1e-9, ~moves))
    return Begun(cause, replace(model, point=Point(values, model.point.starts)), promise,
                 {n: float(std[j]) for n, j in zip(start.amplitudes, at, strict=True)}, whole)


def most_promising(model: Model, cause: Cause, starts: Iterable[Start], masks: Masks) -> Begun | None:
    """Of the starts of a cause on top of a model the one that promises most; None: there is no start."""
    stand = stand_at(model)
    return max((begin(stand, cause, start, masks) for start in starts), key=lambda b: b.promise, default=None)


def _heard(model: Model, masks: Masks) -> Model:
    """The model under its own noise or, if that is likelier, one that is looked for far around."""
    noise = replace(first_noise(model.problem, model.point, masks, quick=True), scale=model.noise.scale)
    other = replace(model, noise=noise)
    return min((model, other), key=lambda m: judge(m.problem, m.point, m.noise, masks))


def log_gain(gain: float, problem: Problem) -> float:
    """What a step gains with the sensor variance fitted too, from what it gains under that at hand.

    Far from an optimum a step promises more than all there is: then it promises nothing that counts.
    """
    degrees = max(problem.count - problem.unknowns, 1)
    share = 2.0 * gain / degrees  # of the cost that goes
    return -0.5 * degrees * float(np.log1p(-share)) if share < 1.0 else -np.inf


def bounded(problem: Problem, base: Model, task: Task) -> Problem:
    """The problem of a task within the bounds that the causes set, see their files; base: that lacks them."""
    low, high = problem.low.copy(), problem.high.copy()
    for cause in (c for c in FITTED if c.bounds is not None):
        for name, (least, most) in cause.bounds(base, task).items():
            if name in task.free:
                j = task.free.index(name)
                low[j], high[j] = max(low[j], least), min(high[j], most)
    return replace(problem, low=low, high=high)
