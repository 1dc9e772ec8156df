"""One explanation of the records: a drive, its free parameters and its noise, fitted to some samples.

The fit is that of `identify`: everything is measured in its currency, the log likelihood of one-step predictions.
A fit can count some samples only (a mask); the filter still sees all of them, so that training and held-out samples
interleave in one record without start states in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive.simulation import Filtered
from drivetool.errors import DriveToolError
from drivetool.identify.fit import COLOUR_GAIN, looks_coloured
from drivetool.identify.noise import (
    Noise,
    by_parabolas,
    excerpt,
    filtered,
    fit_innovations,
    fit_ratio,
    minus_log_likelihood,
    remembering,
    with_state,
)
from drivetool.identify.problem import Point, Problem, approach
from drivetool.identify.setup import Task, first_point

Masks = Sequence[np.ndarray]  # per trace (n,) whether a sample counts

BROKEN = (DriveToolError, np.linalg.LinAlgError, FloatingPointError)  # what a fit that fails may raise
WIDE = np.log(3.0) * np.arange(-3, 4)  # of how loud a sensor may be against the guess
CLEARLY = 10.0  # log likelihood by which another noise is worth a fit: absorbed torque noise gains a few
FIRST = 3  # rounds of a first fit
MOST, COLOURED = 12, 4  # rounds of gains and least squares, and of those under a noise that remembers
SLOWER = 0.7  # of the rate at which torque noise forgets
WORSE = 0.25  # of the error of free runs, by which it may grow


@dataclass(frozen=True)
class Model:
    """A fitted explanation.

    code   of the cause it adds to the base, "base" for the base
    task   the drive with its free parameters; problem: the same over the records
    point  the estimate, noise its noise model
    value  -log likelihood over the samples that counted
    """

    code: str
    task: Task
    problem: Problem
    point: Point
    noise: Noise
    value: float

    @property
    def fitted(self) -> Task:
        """The task at the estimate."""
        return self.task.at_point(self.point)


def everything(problem: Problem) -> list[np.ndarray]:
    """The mask that counts every sample."""
    return [np.ones(t.size, bool) for t in problem.traces]


def counted(problem: Problem, masks: Masks) -> Problem:
    """The problem of the samples of a mask."""
    return replace(problem, counts=tuple(masks))


def losses(passes: Sequence[Filtered], variance: float) -> list[np.ndarray]:
    """Per trace (n,): -log likelihood of each sample, up to a constant, 0 where nothing was measured.

    variance  of the first sensor
    """
    found = []
    for f in passes:
        known = np.isfinite(f.innovations)
        e = np.where(known, f.innovations, 0.0)
        with np.errstate(over="ignore", invalid="ignore"):  # of a filter that ran away
            each = 0.5 * e**2 / (f.variance * variance) + 0.5 * np.log(f.variance * variance)
        found.append(np.where(known, each, 0.0).sum(axis=1))
    return found


def spread(passes: Sequence[Filtered], masks: Masks) -> float:
    """Variance of the first sensor that makes the samples of a mask most likely."""
    squares, count = 0.0, 0
    for f, mask in zip(passes, masks, strict=True):
        e, v = f.innovations[mask], f.variance[mask]
        known = np.isfinite(e)
        with np.errstate(over="ignore"):
            squares += float(np.sum(e[known] ** 2 / v[known]))
        count += int(known.sum())
    return squares / max(count, 1)


def over(model: Model, keep: Sequence[int]) -> Model:
    """The model over some of its traces."""
    return replace(model, problem=replace(model.problem, traces=tuple(model.problem.traces[i] for i in keep)),
                   point=Point(model.point.values, tuple(model.point.starts[i] for i in keep)))


def sensor_std(model: Model, output: int = 0) -> float:
    """Std of a sensor's white noise, of the first one if none is said, as the model has it."""
    passes = filtered(model.problem, model.point, model.noise, keep=False)
    return float(np.sqrt(spread(passes, everything(model.problem))) * model.noise.scale[output])


def total(each: Sequence[np.ndarray], masks: Masks) -> float:
    """Sum over the samples of a mask; infinite where the filter ran away."""
    value = float(sum(loss[mask].sum() for loss, mask in zip(each, masks, strict=True)))
    return value if np.isfinite(value) else np.inf


def judge(problem: Problem, point: Point, noise: Noise, masks: Masks) -> float:
    """-log likelihood of the samples of a mask, the sensor variance fitted to them."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return minus_log_likelihood(filtered(counted(problem, masks), point, noise, keep=False))


def begun(code: str, task: Task, problem: Problem, point: Point, noise: Noise) -> Model:
    """An explanation that has not been fitted."""
    return Model(code, task, problem, point, noise, np.inf)


def fit(model: Model, masks: Masks, *, most: int = MOST, renewed: bool = True, goal: float = np.inf) -> Model:
    """The model fitted to the samples of a mask, from where it is.

    most  rounds; renewed: whether its noise is fitted, too, as long as it stands in for nothing
    goal  value to be reached: what is far above it after a few rounds is given up
    """
    found = fit_innovations(counted(model.problem, masks), model.point, model.noise, arrived=True, most=most,
                            renewed=renewed, wanted=goal)
    after = replace(model, point=found.point, noise=found.noise, value=found.value)
    if renewed and stands_in(after, model):
        return fit(model, masks, most=most, renewed=False, goal=goal)
    return after


def few_steps(model: Model, masks: Masks, most: int) -> Model:
    """The model after some steps under the gains of its noise."""
    problem = counted(model.problem, masks)
    with np.errstate(over="ignore", invalid="ignore"):
        gains = [f.gains for f in filtered(problem, model.point, model.noise)]
        remembering_ = problem.with_memory(model.noise.memory)
        point, _ = approach(remembering_, with_state(model.point, model.noise), gains, most)
    if model.noise.memory is not None:
        point = Point(point.values, tuple(s[:-1] for s in point.starts))
    return replace(model, point=point, value=judge(problem, point, model.noise, masks))


def from_start(task: Task, masks: Masks | None = None, most: int = MOST) -> Model:
    """A drive fitted from its values to all samples or those of a mask; without rounds, under the noise there."""
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    masks = everything(problem) if masks is None else masks
    model = begun("base", task, problem, point, first_noise(problem, point, masks))
    if not most:
        return replace(model, value=judge(problem, point, model.noise, masks))
    return _heard_anew(fit(model, masks, most=most), masks, most)


def _heard_anew(model: Model, masks: Masks, most: int) -> Model:
    """The model, or the same fitted on under the noise that is found far around it, where that is clearly likelier.

    A noise that was begun far from the estimate may have settled where no way leads downhill: all in one sensor.
    """
    if model.noise.memory is not None:
        return model
    noise = _listened(counted(model.problem, masks), model.point, first_noise(model.problem, model.point, masks))
    if judge(model.problem, model.point, noise, masks) > model.value - CLEARLY:
        return model
    again = fit(replace(model, noise=noise), masks, most=most)
    return min((model, again), key=lambda m: m.value)


def _listened(problem: Problem, point: Point, noise: Noise) -> Noise:
    """The noise with each further sensor as loud as makes the samples most likely, looked for far around.

    Not as loud as its own innovations: a sensor that is trusted too much makes the others look loud.
    """
    part = excerpt(problem)
    for m in range(1, len(noise.scale)):
        def louder(log: float, m: int = m, noise: Noise = noise) -> Noise:
            scale = noise.scale.copy()
            scale[m] *= np.exp(log)
            return replace(noise, scale=scale)

        def value(log: float, of=louder) -> float:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                return minus_log_likelihood(filtered(part, point, of(log), keep=False))

        noise = louder(by_parabolas(value, WIDE, close=0.02))
    return noise


def first_noise(problem: Problem, point: Point, masks: Masks, quick: bool = False) -> Noise:
    """The noise at a point where none has been fitted: looked for far around."""
    with np.errstate(over="ignore", invalid="ignore"):
        return fit_ratio(counted(problem, masks), point, Noise(1.0, None, problem.scale), quick=quick)


def heard(model: Model, masks: Masks) -> Model:
    """The model, or the same under the torque noise that what it leaves asks for, if it is likelier so.

    Slow torque noise can stand in for a law, so it is asked of every explanation alike, and last: a memory must be
    worth its parameter where there was none, and stays where there was one only as long as it is.
    """
    problem = counted(model.problem, masks)
    if model.noise.memory is not None:
        return _white_again(model, problem, masks)
    if not looks_coloured(filtered(problem, model.point, model.noise, keep=False)):
        return model
    noise = remembering(problem, model.point, model.noise, lambda n: judge(model.problem, model.point, n, masks))
    if judge(model.problem, model.point, noise, masks) > model.value - COLOUR_GAIN:
        return model
    trial = fit(replace(model, noise=noise), masks, most=COLOURED, renewed=False)
    if trial.value > model.value - COLOUR_GAIN:
        return model
    return fit(trial, masks, most=COLOURED)


def stands_in(after: Model, before: Model) -> bool:
    """Whether torque noise wanders far more slowly now, and free runs err more: it stands in for friction, say."""
    now, then = after.noise.memory, before.noise.memory
    return (now is not None and then is not None and 1.0 - now < SLOWER * (1.0 - then)
            and runs_worse(after, before))


def runs_worse(after: Model, before: Model) -> bool:
    """Whether free runs over the records that both were fitted to err clearly more."""
    return _run_error(after) > (1.0 + WORSE) * _run_error(before)


def _run_error(model: Model) -> float:
    """Rms error of the first output in free runs over the records, from the start states as they are."""
    traces, plants = model.problem.traces, model.problem.plants(model.point.values, False)
    with np.errstate(over="ignore", invalid="ignore"):
        errors = [plant.outputs(t, s)[:, 0] - t.outputs[:, 0] for plant, t, s in zip(
            plants, traces, model.point.starts, strict=True)]
        error = float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))
    return error if np.isfinite(error) else np.inf


def _white_again(model: Model, problem: Problem, masks: Masks) -> Model:
    """A model whose noise remembers, or the same under white noise where that leaves nothing that asks for more."""
    noise = fit_ratio(problem, model.point, replace(model.noise, memory=None, slow=None), quick=True)
    white = replace(model, noise=noise)
    if looks_coloured(filtered(problem, white.point, noise, keep=False)):
        return model
    trial = fit(white, masks, most=COLOURED)
    return trial if trial.value < model.value + COLOUR_GAIN else model


def likeliest_noise(model: Model, masks: Masks) -> Model:
    """The model as it is under the likeliest noise of the samples of a mask: estimated near its own, or anywhere.

    On records that it was not fitted to: where parameters have absorbed the slow part of the torque noise, next to
    none is left of it, and from there no way leads back to what other records have.
    """
    problem = counted(model.problem, masks)
    tried = [fit_ratio(problem, model.point, model.noise, None if model.noise.memory else model.noise.ratio)]
    if model.noise.memory is None:
        tried.append(replace(first_noise(model.problem, model.point, masks), scale=model.noise.scale))
    value, _, noise = min((judge(model.problem, model.point, n, masks), i, n) for i, n in enumerate(tried))
    return replace(model, noise=noise, value=value)
