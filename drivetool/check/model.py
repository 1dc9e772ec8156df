"""One explanation of the records: a drive, its free parameters and its noise, fitted and judged by samples.

Everything is measured in one currency: the log likelihood of one-step predictions, sample by sample.
A fit can count some samples only (a mask); the filter still sees all of them, so that training and
held-out samples interleave in one record without start states in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive.simulate import Filtered, Gains
from drivetool.errors import DriveToolError
from drivetool.identify.engine import Task
from drivetool.identify.least_squares import Solution, solve
from drivetool.identify.noise import (
    ODDS,
    Noise,
    by_parabolas,
    excerpt,
    filtered,
    fit_ratio,
    natural_ratio,
    with_state,
)
from drivetool.identify.noise_scoring import Heard, heard, scored
from drivetool.identify.problem import Point, Problem
from drivetool.identify.setup import first_point

Masks = Sequence[np.ndarray]  # per trace (n,) whether a sample counts

BROKEN = (DriveToolError, np.linalg.LinAlgError, FloatingPointError)  # what a fit that fails may raise
ROUNDS = 5  # of gains and Levenberg-Marquardt, at most
LOUD = 300.0  # times the torque noise that moves the first sensor by its own noise in a sample
WIDE = np.log(3.0) * np.arange(-3, 4)  # of a sensor's noise about the guess
RENEWED, MOVING = 3, 10.0  # rounds after which the noise stays, unless the last one gained so much log likelihood
STEPS = 1  # of the noise a round; the next round goes on
RESTS = 4  # fits of a model that goes on moving, at most
TRIFLING = 0.05  # twice the log likelihood below which another step of a round does not pay
SETTLED = 0.3  # log likelihood below which another round does not pay


@dataclass(frozen=True)
class Model:
    """A fitted explanation.

    code     of the cause it adds to the base, "base" for the base
    task     the drive with its free parameters; problem: the same over the records
    point    the estimate, noise its noise model
    value    -log likelihood over the samples that counted
    moving   by how much the last round of its fit still lowered it
    """

    code: str
    task: Task
    problem: Problem
    point: Point
    noise: Noise
    value: float
    moving: float = 0.0

    @property
    def fitted(self) -> Task:
        """The task at the estimate."""
        return self.task.at_point(self.point)


def everything(problem: Problem) -> list[np.ndarray]:
    """The mask that counts every sample."""
    return [np.ones(t.size, bool) for t in problem.traces]


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
    return _listen(problem, point, noise, masks).value


def fit(code: str, task: Task, problem: Problem, point: Point, noise: Noise, masks: Masks, *,
        rounds: int = ROUNDS, renew: bool = True, hold: np.ndarray | None = None, most: int = 12) -> Model:
    """Fit to the samples of a mask from a point.

    renew   whether noise ratio and sensor noises are estimated anew after the first rounds, and while it gains much
    hold    (k,) parameters that do not move in the first round
    most    steps per round
    """
    value, gain = judge(problem, point, noise, masks), 0.0
    for number in range(rounds):
        solution = _round(problem, point, noise, masks, most, hold if number == 0 else None)
        trial, worth = _backed_off(problem, point, solution.point, noise, masks, value)
        # Not for ever: parameters that absorb slow torque noise lower its ratio, round by round, to nothing.
        if renew and (number < RENEWED or gain > MOVING):
            fresh, better = renewed(problem, trial, noise, masks)
            if better < worth:
                noise, worth = fresh, better
        gain, point, value = value - worth, trial, worth
        if gain < SETTLED and number > 0:
            break
    return Model(code, replace(task, drive=task.drive), problem, point, noise, value, gain)


def at_rest(model: Model, masks: Masks) -> Model:
    """The model fitted on until it moves no more.

    Where the torque noise turns out far weaker than the fit began with, its ratio needs more than one fit.
    """
    for _ in range(RESTS):
        trial = fit(model.code, model.task, model.problem, model.point, model.noise, masks, rounds=3)
        if trial.value > model.value - SETTLED:
            break
        model = trial
    return model


def whitened(model: Model, masks: Masks) -> Model:
    """The model under a torque noise that remembers nothing, fitted until it moves no more."""
    plain = replace(model.noise, memory=None, slow=None)
    # A ratio that was right for noise that remembers may be decades off for noise that does not.
    value, noise = min(((judge(model.problem, model.point, n, masks), n) for n in (
        plain, fit_ratio(model.problem, model.point, plain, quick=True))), key=lambda pair: pair[0])
    return at_rest(replace(model, noise=noise, value=value), masks)


def from_start(task: Task, masks: Masks | None = None, rounds: int = ROUNDS) -> Model:
    """A base: fitted from the values of its drive, to all samples or to those of a mask."""
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    masks = everything(problem) if masks is None else masks
    return fit("base", task, problem, point, first_noise(problem, point, masks), masks, rounds=rounds)


def heard_afresh(model: Model, masks: Masks) -> Model:
    """The model, or the likelier one under the noise that is found where none is known.

    A noise that was begun far from the estimate may have settled where no way leads downhill: all in one sensor.
    A trifle is no reason: parameters that absorb slow torque noise are a little likelier without any.
    """
    if model.noise.memory is not None:
        return model
    noise = first_noise(model.problem, model.point, masks)
    if judge(model.problem, model.point, noise, masks) > model.value - MOVING:
        return model
    return fit(model.code, model.task, model.problem, model.point, noise, masks, rounds=10)


def first_noise(problem: Problem, point: Point, masks: Masks) -> Noise:
    """The noise at a point where none has been fitted: its figures looked for far around."""
    return listened(problem, point, fit_ratio(problem, point, Noise(1.0, None, problem.scale)), masks)


def likeliest_noise(model: Model, masks: Masks) -> Model:
    """The model as it is under the likeliest noise of the samples of a mask: estimated near its own, or anywhere.

    On records that it was not fitted to: where parameters have absorbed the slow part of the torque noise, next to
    none is left of it, and from there no way leads back to what other records have.
    """
    near = renewed(model.problem, model.point, model.noise, masks)
    if model.noise.memory is None:
        noise = first_noise(model.problem, model.point, masks)
        near = min(near, (noise, judge(model.problem, model.point, noise, masks)), key=lambda pair: pair[1])
    return replace(model, noise=near[0], value=near[1])


def renewed(problem: Problem, point: Point, noise: Noise, masks: Masks) -> tuple[Noise, float]:
    """The noise estimated anew at a point, that of all sensors with that of the torque, and its value."""
    middle = natural_ratio(problem, point)
    # Where the sensor counts for nothing any ratio is as likely as one close by: no way leads back downhill.
    if noise.ratio > LOUD * middle:
        noise = fit_ratio(problem, point, replace(noise, memory=None, slow=None), quick=True)
    part, masked = _excerpt(problem, masks)

    def listen(figures: np.ndarray) -> Heard:
        return _listen(part, point, noise.at(figures), masked)

    scales = np.log(noise.scale[1:])
    low, high = (np.concatenate((b, scales + reach)) for b, reach in zip(
        noise.bounds(np.log(middle)), (-ODDS, ODDS), strict=True))
    figures, value = scored(listen, np.concatenate((noise.figures, scales)), low, high, STEPS)
    noise = noise.at(figures)
    return noise, value if part is problem else judge(problem, point, noise, masks)


def _listen(problem: Problem, point: Point, noise: Noise, masks: Masks) -> Heard:
    """What the samples of a mask say, the sensor variance fitted to them."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        passes = filtered(problem, point, noise, keep=False)
        found = heard(np.inf, passes, masks)
        count = len(found.innovations)
        variance = float(np.sum(found.innovations**2 / found.variance)) / max(count, 1)
        value = 0.5 * count * (1.0 + np.log(variance)) + 0.5 * float(np.sum(np.log(found.variance)))
    return replace(found, value=value) if variance > 0.0 and np.isfinite(value) else found


def _excerpt(problem: Problem, masks: Masks) -> tuple[Problem, Masks]:
    """Enough of the samples for the figures of a noise, and what counts of them."""
    part = excerpt(problem)
    return part, [mask[:t.size] for mask, t in zip(masks, part.traces, strict=True)]


def listened(problem: Problem, point: Point, noise: Noise, masks: Masks) -> Noise:
    """The noise with each further sensor as loud as makes the samples of a mask most likely, looked for far around.

    Not as loud as its own innovations: a sensor that is trusted too much makes the others look loud.
    """
    part, masked = _excerpt(problem, masks)
    for m in range(1, len(noise.scale)):
        def louder(log: float, m: int = m, noise: Noise = noise) -> Noise:
            scale = noise.scale.copy()
            scale[m] *= np.exp(log)
            return replace(noise, scale=scale)

        def value(log: float, of=louder) -> float:
            return judge(part, point, of(log), masked)

        noise = louder(by_parabolas(value, WIDE, close=0.02))
    return noise


def _round(problem: Problem, point: Point, noise: Noise, masks: Masks, most: int,
           hold: np.ndarray | None) -> Solution:
    """Levenberg-Marquardt under frozen gains; samples that do not count have no weight."""
    with np.errstate(over="ignore", invalid="ignore"):
        passes = filtered(problem, point, noise)
    gains = [Gains(f.gains.gain, f.gains.weight * mask[:, None]) for f, mask in zip(passes, masks, strict=True)]
    trifle = TRIFLING / problem.count
    solution = solve(problem.with_memory(noise.memory), with_state(point, noise), gains, relative=trifle, most=most,
                     hold=hold, least=trifle)
    if noise.memory is None:
        return solution
    starts = tuple(s[:-1] for s in solution.point.starts)
    return replace(solution, point=Point(solution.point.values, starts))


def _backed_off(problem: Problem, before: Point, after: Point, noise: Noise, masks: Masks,
                value: float) -> tuple[Point, float]:
    """The furthest point on the way that is more likely under its own gains, and its value."""
    share = 1.0
    while share > 0.02:
        starts = tuple(a + share * (b - a) for a, b in zip(before.starts, after.starts, strict=True))
        point = Point(before.values + share * (after.values - before.values), starts)
        worth = judge(problem, point, noise, masks)
        if worth <= value:
            return point, worth
        share *= 0.35
    return before, value
