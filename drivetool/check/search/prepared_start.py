"""Where the fit of a cause starts on top of a model, and the gain that one Gauss-Newton step predicts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.causes import FITTED, Cause
from drivetool.check.fit import (
    Masks,
    Model,
    amplitude_std,
    initial_noise,
    linear_step,
    masked_loss,
    on_task,
)
from drivetool.check.starts import Start
from drivetool.drive.simulation import ObserverGains
from drivetool.identify.noise import filtered, filtered_normal_equations, with_disturbance_state
from drivetool.identify.problem import Point, Problem, marquardt_step


@dataclass(frozen=True)
class ReferenceModel:
    """A model without the cause.

    own_gain  of one linear step of its own parameters: zero where it is fitted
    gains     of its filter, per trace; states: their names
    """

    model: Model
    own_gain: float
    gains: tuple[ObserverGains, ...]
    states: tuple[str, ...]


@dataclass(frozen=True)
class PreparedStart:
    """A start that may be fitted.

    model          not fitted yet, after a linear step of the amplitudes; other: after a step of everything
    expected_gain  log likelihood that one linear step would gain over one without the cause (score test)
    std            amplitude -> its standard deviation at the reference model, the cause's others zero
    reference      number of its reference model
    """

    model: Model
    expected_gain: float
    std: Mapping[str, float]
    other: Point | None = None
    reference: int = 0

    @property
    def kind(self) -> tuple[object, ...]:
        """What distinguishes it from starts that differ in numbers only."""
        return (self.reference, *kind_of(self.model))

    def ready(self, masks: Masks) -> Model:
        """The model at the likelier of both points; from zero the step limits would cost many steps."""
        if self.other is None:
            return self.model
        return min((self.model, replace(self.model, point=self.other)),
                   key=lambda m: masked_loss(m.problem, m.point, m.noise, masks))


def reference_model(model: Model) -> ReferenceModel:
    """A model with the filter gains that the starts on top of it are screened under."""
    passes = filtered(model.problem, model.point, model.noise)
    gains = tuple(f.gains for f in passes)
    normal = model.problem.with_memory(model.noise.memory).normal(with_disturbance_state(model.point, model.noise),
                                                                  gains)
    _, _, gain = linear_step(model.problem, normal, np.ones(len(model.task.free), bool))
    return ReferenceModel(model, max(log_gain(gain, model.problem), 0.0), gains, model.problem.states)


def kind_of(model: Model) -> tuple[object, ...]:
    """The free parameters, and the discrete choices in a drive."""
    drive = model.task.drive
    return model.task.free, *(drive.value(n) for n, q in drive.quantities.items() if q.choice)


def prepare_start(reference: ReferenceModel, cause: Cause, start: Start, masks: Masks) -> PreparedStart:
    """A start on top of a reference model, and its expected gain.

    Amplitudes begin at zero, where the filter is that of the reference. Where the likelihood has many local optima,
    the noise of the reference may be far from that of the start: it is re-estimated there.
    """
    own, task = reference.model, start.task
    model = with_cause_bounds(replace(on_task(own, task), code=cause.code, value=np.inf), own)
    problem = model.problem
    if start.amplitudes and problem.states == reference.states:
        value, normal = own.value, problem.with_memory(own.noise.memory).normal(
            with_disturbance_state(model.point, own.noise), reference.gains)
    else:
        model = _reestimate_noise(model, masks) if cause.multimodal else model
        value = masked_loss(problem, model.point, model.noise, masks)
        normal = filtered_normal_equations(problem, model.point, model.noise)
    moves = np.array([n in start.amplitudes or n in own.task.free or not start.amplitudes for n in task.free])
    step, std, gain = linear_step(problem, normal, moves)
    expected_gain = own.value - value + log_gain(gain, problem) - reference.own_gain
    if not start.amplitudes:
        return PreparedStart(model, expected_gain if np.isfinite(expected_gain) else -np.inf, {})
    amplitudes = np.array([n in start.amplitudes and cause.has(n) for n in task.free])
    std = np.where(amplitudes, amplitude_std(problem, normal, amplitudes, moves & ~amplitudes), std)
    values = model.point.values.copy()
    at = [task.free.index(name) for name in start.amplitudes]
    values[at] = np.clip(values[at] + step[at], problem.low[at], problem.high[at])
    if np.all(values[at] == problem.low[at]):
        expected_gain = 0.0
    whole = problem.moved(model.point, *marquardt_step(problem, model.point, normal, 1e-9, ~moves))
    return PreparedStart(replace(model, point=Point(values, model.point.starts)), expected_gain,
                         {n: float(std[j]) for n, j in zip(start.amplitudes, at, strict=True)}, whole)


def best_prepared_start(model: Model, cause: Cause, starts: Iterable[Start], masks: Masks) -> PreparedStart | None:
    """The start of a cause on top of a model with the largest expected gain; None: there is no start."""
    reference = reference_model(model)
    return max((prepare_start(reference, cause, start, masks) for start in starts),
               key=lambda b: b.expected_gain, default=None)


def _reestimate_noise(model: Model, masks: Masks) -> Model:
    """The model under its own noise or, if that is likelier, under one searched over a wide range."""
    noise = replace(initial_noise(model.problem, model.point, masks, quick=True), scale=model.noise.scale)
    other = replace(model, noise=noise)
    return min((model, other), key=lambda m: masked_loss(m.problem, m.point, m.noise, masks))


def log_gain(gain: float, problem: Problem) -> float:
    """The gain of a step with the sensor variance fitted too, from its gain under the present variance.

    Far from an optimum a step may predict a gain above the whole cost: then the prediction counts for nothing.
    """
    degrees = max(problem.count - problem.unknowns, 1)
    share = 2.0 * gain / degrees  # of the cost that the step removes
    return -0.5 * degrees * float(np.log1p(-share)) if share < 1.0 else -np.inf


def with_cause_bounds(model: Model, base: Model) -> Model:
    """The model within the bounds that the causes set, see their files; base: lacks them."""
    task, low, high = model.task, model.problem.low.copy(), model.problem.high.copy()
    for cause in (c for c in FITTED if c.bounds is not None):
        for name, (least, most) in cause.bounds(base, task).items():
            if name in task.free:
                j = task.free.index(name)
                low[j], high[j] = max(low[j], least), min(high[j], most)
    return replace(model, problem=replace(model.problem, low=low, high=high))
