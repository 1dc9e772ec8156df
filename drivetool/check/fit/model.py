"""One model of the records: a drive, its free parameters and its noise, fitted to some samples.

The fit is that of `identify`, and gains are in its unit, the log likelihood of one-step predictions.
A fit can count some samples only (a mask); the filter still sees all of them, so that training and held-out samples
interleave in one record without start states in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive.simulation import Filtered
from drivetool.errors import DriveToolError
from drivetool.identify.fit import MIN_COLOUR_GAIN, looks_coloured
from drivetool.identify.noise import (
    Noise,
    filtered,
    first_samples_of,
    fit_correlated_noise,
    fit_innovations,
    fit_ratio,
    minimise_by_parabolas,
    minus_log_likelihood,
    with_disturbance_state,
)
from drivetool.identify.problem import Point, Problem, take_steps
from drivetool.identify.setup import Task, first_point

Masks = Sequence[np.ndarray]  # per trace (n,) whether a sample counts

FIT_ERRORS = (DriveToolError, np.linalg.LinAlgError, FloatingPointError)  # exceptions of a fit that fails
# Factors of a sensor's noise over the guess, 1/27 to 27: a wrong guess is off by an order of magnitude.
LOG_NOISE_SCALE_GRID = np.log(3.0) * np.arange(-3, 4)
# Log likelihood by which another noise is worth a fit: absorbed torque noise gains a few units.
MIN_NOISE_GAIN = 10.0
FIRST_FIT_ITERATIONS = 3  # iterations of a first fit. A choice: enough to rank the starts
# Iterations of gains and least squares, and of those under an AR(1) noise. A choice: limits the cost of a fit
# that does not converge.
MAX_FIT_ITERATIONS, COLOURED_FIT_ITERATIONS = 12, 4
# Ratio of the decay rates of AR(1) torque noise after and before a fit. A choice: noise that slows by more than
# 30 % may replace a law.
MAX_NOISE_RATE_RATIO = 0.7
# Relative growth of the free-run error. A choice: smaller changes may come from noise.
MAX_RUN_ERROR_INCREASE = 0.25


@dataclass(frozen=True)
class Model:
    """A fitted model.

    code   of the cause it adds to the base, "base" for the base
    task   the drive with its free parameters; problem: the same over the records
    point  the estimate; noise: its noise model
    value  -log likelihood over the samples that counted; infinite before a fit
    """

    code: str
    task: Task
    problem: Problem
    point: Point
    noise: Noise
    value: float = np.inf

    @property
    def fitted(self) -> Task:
        """The task at the estimate."""
        return self.task.at_point(self.point)


def all_samples(problem: Problem) -> list[np.ndarray]:
    """The mask that counts every sample."""
    return [np.ones(t.size, bool) for t in problem.traces]


def masked_problem(problem: Problem, masks: Masks) -> Problem:
    """The problem of the samples of a mask."""
    return replace(problem, counts=tuple(masks))


def sample_losses(passes: Sequence[Filtered], variance: float) -> list[np.ndarray]:
    """Per trace (n,): -log likelihood of each sample, up to a constant, 0 where nothing was measured.

    variance  of the first sensor
    """
    found = []
    for f in passes:
        known = np.isfinite(f.innovations)
        e = np.where(known, f.innovations, 0.0)
        with np.errstate(over="ignore", invalid="ignore"):  # of a filter that diverged
            each = 0.5 * e**2 / (f.variance * variance) + 0.5 * np.log(f.variance * variance)
        found.append(np.where(known, each, 0.0).sum(axis=1))
    return found


def sensor_variance(passes: Sequence[Filtered], masks: Masks) -> float:
    """Variance of the first sensor that makes the samples of a mask most likely."""
    squares, count = 0.0, 0
    for f, mask in zip(passes, masks, strict=True):
        e, v = f.innovations[mask], f.variance[mask]
        known = np.isfinite(e)
        with np.errstate(over="ignore"):
            squares += float(np.sum(e[known] ** 2 / v[known]))
        count += int(known.sum())
    return squares / max(count, 1)


def over_traces(model: Model, keep: Sequence[int]) -> Model:
    """The model over some of its traces."""
    return replace(model, problem=replace(model.problem, traces=tuple(model.problem.traces[i] for i in keep)),
                   point=Point(model.point.values, tuple(model.point.starts[i] for i in keep)))


def sensor_std(model: Model, output: int = 0) -> float:
    """Standard deviation of a sensor's white noise by the model; the default is the first sensor."""
    passes = filtered(model.problem, model.point, model.noise, keep=False)
    return float(np.sqrt(sensor_variance(passes, all_samples(model.problem))) * model.noise.scale[output])


def total_loss(each: Sequence[np.ndarray], masks: Masks) -> float:
    """Sum over the samples of a mask; infinite where the filter diverged."""
    value = float(sum(loss[mask].sum() for loss, mask in zip(each, masks, strict=True)))
    return value if np.isfinite(value) else np.inf


def masked_loss(problem: Problem, point: Point, noise: Noise, masks: Masks) -> float:
    """-log likelihood of the samples of a mask, the sensor variance fitted to them."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return minus_log_likelihood(filtered(masked_problem(problem, masks), point, noise, keep=False))


def fit(model: Model, masks: Masks, *, max_iterations: int = MAX_FIT_ITERATIONS, refit_noise: bool = True,
        goal: float = np.inf) -> Model:
    """The model fitted to the samples of a mask, from its present point.

    max_iterations  of the fit; refit_noise: whether its noise is fitted too, as long as that replaces no law
    goal            value to be reached: a fit that is far above it after a few iterations stops
    """
    found = fit_innovations(masked_problem(model.problem, masks), model.point, model.noise, near_optimum=True,
                            max_rounds=max_iterations,
                            estimate_noise=refit_noise, wanted=goal)
    after = replace(model, point=found.point, noise=found.noise, value=found.value)
    if refit_noise and noise_absorbs_effect(after, model):
        return fit(model, masks, max_iterations=max_iterations, refit_noise=False, goal=goal)
    return after


def gauss_newton_iterations(model: Model, masks: Masks, max_steps: int) -> Model:
    """The model after some steps under the gains of its noise."""
    problem = masked_problem(model.problem, masks)
    with np.errstate(over="ignore", invalid="ignore"):
        gains = [f.gains for f in filtered(problem, model.point, model.noise)]
        with_memory = problem.with_memory(model.noise.memory)
        point, _ = take_steps(with_memory, with_disturbance_state(model.point, model.noise), gains, max_steps)
    if model.noise.memory is not None:
        point = Point(point.values, tuple(s[:-1] for s in point.starts))
    return replace(model, point=point, value=masked_loss(problem, point, model.noise, masks))


def fit_from_start(task: Task, masks: Masks | None = None, max_iterations: int = MAX_FIT_ITERATIONS) -> Model:
    """A drive fitted from its values to all samples or those of a mask; for zero iterations its noise only."""
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    masks = all_samples(problem) if masks is None else masks
    model = Model("base", task, problem, point, initial_noise(problem, point, masks))
    if not max_iterations:
        return replace(model, value=masked_loss(problem, point, model.noise, masks))
    return _reestimate_noise_widely(fit(model, masks, max_iterations=max_iterations), masks, max_iterations)


def _reestimate_noise_widely(model: Model, masks: Masks, max_iterations: int) -> Model:
    """The model, or one fitted on under a noise searched over a wide range, where that is clearly likelier.

    A noise that started far from the estimate may be in a local optimum: all of it in one sensor.
    """
    if model.noise.memory is not None:
        return model
    noise = _sensor_noise_over_range(masked_problem(model.problem, masks), model.point,
                                     initial_noise(model.problem, model.point, masks))
    if masked_loss(model.problem, model.point, noise, masks) > model.value - MIN_NOISE_GAIN:
        return model
    again = fit(replace(model, noise=noise), masks, max_iterations=max_iterations)
    return min((model, again), key=lambda m: m.value)


def _sensor_noise_over_range(problem: Problem, point: Point, noise: Noise) -> Noise:
    """The noise with the likeliest scale of each further sensor, searched over a wide range.

    Its own innovations are no estimate: one sensor with too small a noise inflates those of the others.
    """
    part = first_samples_of(problem)
    for m in range(1, len(noise.scale)):
        def louder(log: float, m: int = m, noise: Noise = noise) -> Noise:
            scale = noise.scale.copy()
            scale[m] *= np.exp(log)
            return replace(noise, scale=scale)

        def value(log: float, of=louder) -> float:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                return minus_log_likelihood(filtered(part, point, of(log), keep=False))

        noise = louder(minimise_by_parabolas(value, LOG_NOISE_SCALE_GRID, tolerance=0.02))
    return noise


def initial_noise(problem: Problem, point: Point, masks: Masks, quick: bool = False) -> Noise:
    """The noise at a point where none has been fitted, searched over a wide range."""
    with np.errstate(over="ignore", invalid="ignore"):
        return fit_ratio(masked_problem(problem, masks), point, Noise(1.0, None, problem.scale), quick=quick)


def reestimate_noise(model: Model, masks: Masks) -> Model:
    """The model, or the same under AR(1) torque noise where its residuals are correlated and that is likelier.

    Slow torque noise can replace a law, so every model gets the same test, after its fit. An AR(1) pole must gain
    more than its parameter costs, and is dropped when it no longer does.
    """
    problem = masked_problem(model.problem, masks)
    if model.noise.memory is not None:
        return _refit_with_white_noise(model, problem, masks)
    if not looks_coloured(filtered(problem, model.point, model.noise, keep=False)):
        return model
    noise = fit_correlated_noise(problem, model.point, model.noise,
                                 lambda n: masked_loss(model.problem, model.point, n, masks))
    if masked_loss(model.problem, model.point, noise, masks) > model.value - MIN_COLOUR_GAIN:
        return model
    trial = fit(replace(model, noise=noise), masks, max_iterations=COLOURED_FIT_ITERATIONS, refit_noise=False)
    if trial.value > model.value - MIN_COLOUR_GAIN:
        return model
    return fit(trial, masks, max_iterations=COLOURED_FIT_ITERATIONS)


def noise_absorbs_effect(after: Model, before: Model) -> bool:
    """Whether the torque noise became far slower and the free-run error larger: it replaces friction, say."""
    now, then = after.noise.memory, before.noise.memory
    return (now is not None and then is not None and 1.0 - now < MAX_NOISE_RATE_RATIO * (1.0 - then)
            and free_runs_clearly_worse(after, before))


def free_runs_clearly_worse(after: Model, before: Model) -> bool:
    """Whether the free-run error over the records of both fits is clearly larger."""
    return _run_error(after) > (1.0 + MAX_RUN_ERROR_INCREASE) * _run_error(before)


def _run_error(model: Model) -> float:
    """Rms error of the first output in free runs over the records, from the start states as they are."""
    traces, plants = model.problem.traces, model.problem.plants(model.point.values, False)
    with np.errstate(over="ignore", invalid="ignore"):
        errors = [plant.outputs(t, s)[:, 0] - t.outputs[:, 0] for plant, t, s in zip(
            plants, traces, model.point.starts, strict=True)]
        error = float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))
    return error if np.isfinite(error) else np.inf


def _refit_with_white_noise(model: Model, problem: Problem, masks: Masks) -> Model:
    """A model with AR(1) noise, or the same under white noise where that leaves white residuals."""
    noise = fit_ratio(problem, model.point, replace(model.noise, memory=None, slow=None), quick=True)
    white = replace(model, noise=noise)
    if looks_coloured(filtered(problem, white.point, noise, keep=False)):
        return model
    trial = fit(white, masks, max_iterations=COLOURED_FIT_ITERATIONS)
    return trial if trial.value < model.value + MIN_COLOUR_GAIN else model


def with_likeliest_noise(model: Model, masks: Masks) -> Model:
    """The model as it is under the likeliest noise of the samples of a mask, from its own noise or a wide search.

    For records that it was not fitted to: parameters may have absorbed the slow torque noise of the training
    records, and a local search from a noise of almost zero does not find that of other records.
    """
    problem = masked_problem(model.problem, masks)
    candidates = [fit_ratio(problem, model.point, model.noise, None if model.noise.memory else model.noise.ratio)]
    if model.noise.memory is None:
        candidates.append(replace(initial_noise(model.problem, model.point, masks), scale=model.noise.scale))
    value, _, noise = min((masked_loss(model.problem, model.point, n, masks), i, n)
                          for i, n in enumerate(candidates))
    return replace(model, noise=noise, value=value)
