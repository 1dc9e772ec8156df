"""The innovations fit: one-step errors under frozen extended-Kalman gains.

Gains are computed at the current estimate over the whole record, frozen during a
Levenberg-Marquardt fit with exact sensitivities, then the ratio of torque to sensor noise is
re-estimated by maximum likelihood, and so on until nothing moves. Under torque noise a plain
simulation-error fit states intervals that hold a few per cent of the time; this one's hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive.simulation import Filtered, Gains
from drivetool.identify.noise.noise import (
    Noise,
    filtered,
    fit_ratio,
    likelier_ratio,
    minus_log_likelihood,
    with_state,
)
from drivetool.identify.problem import Point, Problem, Solution, schur, solve

WORSE = 5.0  # by which a later round may raise the -log likelihood: it serves the restricted one
EARLY, HOPELESS = 2, 1000.0  # rounds after which a fit that far above what is wanted is given up
# Later rounds take few steps: across a gap the frozen-gain cost has other valleys to run off to.
FEW = 4
ANEW = 5  # rounds after which the noise is sought everywhere again: near the last, one that is none takes a dozen


@dataclass(frozen=True)
class Fit:
    """Where a fit ended.

    value   -log likelihood; passes: the last Kalman pass per trace
    gain    by how much the last three rounds lowered the value; a settled fit has stopped doing so
    """

    solution: Solution
    noise: Noise
    value: float
    passes: tuple[Filtered, ...]
    rounds: int
    gain: float
    converged: bool

    @property
    def point(self) -> Point:
        """The estimate."""
        return self.solution.point


def fit_innovations(problem: Problem, point: Point, noise: Noise | None = None, *,
                    linear: Problem | None = None, most: int = 12, arrived: bool = False,
                    wanted: float = np.inf, renewed: bool = True) -> Fit:
    """Fit from a point.

    noise    first guess; None: estimated at the start point, where a large ratio found for a bad
             start makes the fit easy and so acts as a continuation
    linear   the problem whose gains are used in the first round instead of its own: without gap
             and friction they are constant, a second way into the optimum
    arrived  the point is near its optimum: few steps a round from the beginning
    wanted   -log likelihood to be reached: what is far above it after a few rounds is given up
    renewed  whether the noise is estimated too; else it stays as it is given
    returns  Fit
    """
    if noise is None:
        noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale))
    best: Fit | None = None
    rounds, lowest, before = 0, [], np.inf
    for rounds in range(1, most + 1):
        source = linear if linear is not None and rounds <= 2 else problem
        gains = [f.gains for f in filtered(source, point, noise)]
        solution = _solve(problem, point, gains, noise, rounds + 2 if arrived else rounds)
        moved = _distance(problem, point, solution)
        solution = _backed_off(problem, point, solution, noise)
        point = solution.point
        settled = arrived or rounds >= 2
        wide = (rounds == 2 and not arrived) or rounds % ANEW == 0
        around = None if wide and noise.memory is None else noise.ratio
        fresh = fit_ratio(problem, point, noise, around, settled) if renewed else noise
        fresh = _sensor_scales(problem, point, fresh) if renewed else noise
        change = abs(np.log(fresh.ratio / noise.ratio))
        noise = fresh
        passes = filtered(problem, point, noise, keep=False)
        value = minus_log_likelihood(passes)
        if rounds >= EARLY and value > wanted + HOPELESS:
            break
        still = moved < 0.05 and (change < 0.05 or (bool(lowest) and abs(value - before) < 0.02))
        before = value
        lowest.append(min(value, lowest[-1]) if lowest else value)
        if best is None or value < best.value + WORSE:
            best = Fit(solution, noise, value, tuple(passes), rounds, 0.0, False)
        if still and rounds >= (2 if arrived else 3) and source is problem:
            return replace(best, rounds=rounds, converged=True)
    gain = lowest[-4] - lowest[-1] if len(lowest) > 3 else np.inf
    return replace(best, rounds=rounds, gain=float(gain))


def until_settled(problem: Problem, fit: Fit, runs: int) -> Fit:
    """The fit, gone on with where it was stopped before it came to rest: on its way the noise is not its own.

    runs  of further fits at most
    """
    for _ in range(runs):
        if fit.converged:
            break
        fit = fit_innovations(problem, fit.point, fit.noise, arrived=True)
    return fit


def settle(problem: Problem, fit: Fit) -> Fit:
    """Repeat the last round with a tight tolerance, so that two ways in end in the same digits.

    Before that, the noise is sought everywhere once more.
    """
    fit = sought_everywhere(problem, fit)
    gains = [f.gains for f in filtered(problem, fit.point, fit.noise)]
    solution = solve(problem.with_memory(fit.noise.memory), with_state(fit.point, fit.noise),
                     gains, relative=1e-11)
    solution = replace(solution, point=_without_state(problem, solution.point, fit.noise))
    passes = filtered(problem, solution.point, fit.noise, keep=False)
    value = minus_log_likelihood(passes)
    if value > fit.value + WORSE:
        return fit
    return replace(fit, solution=solution, passes=tuple(passes), value=value)


def sought_everywhere(problem: Problem, fit: Fit) -> Fit:
    """The fit, or one from a noise ratio that is likelier: the last rounds looked near their own only."""
    elsewhere = likelier_ratio(problem, fit.point, fit.noise)
    if elsewhere is None:
        return fit
    further = fit_innovations(problem, fit.point, elsewhere, arrived=True)
    # The plain likelihood may be worse by a little where the restricted one is better.
    return further if further.value < fit.value + WORSE else fit


def _solve(problem: Problem, point: Point, gains: Sequence[Gains], noise: Noise, rounds: int) -> Solution:
    tolerance = 1e-5 if rounds == 1 else 1e-7  # `settle` does the last digits
    solution = solve(problem.with_memory(noise.memory), with_state(point, noise), gains,
                     relative=tolerance, hold=problem.later if rounds == 1 else None,
                     most=60 if rounds <= 2 else FEW)
    return replace(solution, point=_without_state(problem, solution.point, noise))


def _without_state(problem: Problem, point: Point, noise: Noise) -> Point:
    if noise.memory is None:
        return point
    return Point(point.values, tuple(s[:-1] for s in point.starts))


def _backed_off(problem: Problem, before: Point, solution: Solution, noise: Noise) -> Solution:
    """The solution, or a point on the way to it, where the likelihood itself does not get worse.

    Across a gap, frozen gains can lead to where new gains would tell another story.
    """
    def value(point: Point) -> float:
        return minus_log_likelihood(filtered(problem, point, noise, keep=False))

    limit, share, point = value(before) + WORSE, 1.0, solution.point
    while value(point) > limit and share > 0.05:
        share *= 0.4
        point = Point(before.values + share * (solution.point.values - before.values), tuple(
            a + share * (b - a) for a, b in zip(before.starts, solution.point.starts, strict=True)))
    return solution if share == 1.0 else replace(solution, point=point)


def _distance(problem: Problem, before: Point, solution: Solution) -> float:
    """The furthest any parameter moved, in its standard deviations."""
    if not len(before.values):
        return 0.0
    matrix, _, _ = schur(solution.normal)
    if not np.all(np.isfinite(matrix)):  # where the model diverges nothing is known
        return np.inf
    variance = solution.cost / max(problem.count - problem.unknowns, 1)
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-200))
    inverse = np.linalg.pinv(matrix / np.outer(size, size), rcond=1e-13, hermitian=True)
    std = np.sqrt(np.maximum(variance * np.diag(inverse), 1e-300)) / size
    return float(np.max(np.abs(solution.point.values - before.values) / std))


def _sensor_scales(problem: Problem, point: Point, noise: Noise) -> Noise:
    """Rescale the sensors so that their normalised innovations have one variance."""
    if len(noise.scale) == 1:
        return noise
    passes = filtered(problem, point, noise, keep=False)
    spread = []
    for m in range(len(noise.scale)):
        z = np.concatenate([f.innovations[:, m] / np.sqrt(f.variance[:, m]) for f in passes])
        spread.append(np.sqrt(np.nanmean(z**2)))
    scale = noise.scale * np.array(spread) / spread[0]
    return replace(noise, scale=scale)
