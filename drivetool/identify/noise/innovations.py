"""The innovations fit: one-step prediction errors under frozen extended-Kalman gains.

Each round computes the gains at the current estimate over the whole record, and freezes them during a
Levenberg-Marquardt fit with exact sensitivities. Then it re-estimates the ratio of torque to sensor noise by
maximum likelihood. Rounds end when nothing moves. Under torque noise, intervals of a plain simulation-error fit
hold in a few per cent of the cases; these hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drivetool.drive.simulation import Filtered, ObserverGains
from drivetool.identify.noise.noise import (
    Noise,
    filtered,
    fit_ratio,
    likelier_ratio,
    minus_log_likelihood,
    minus_log_likelihood_at,
    with_disturbance_state,
)
from drivetool.identify.problem import Point, Problem, Solution, schur, solve

# Rise of the -log likelihood that a later round may cause, since it minimises the restricted one. A choice: above
# their usual difference, below that of two local optima.
MAX_LIKELIHOOD_LOSS = 5.0
# Rounds after which a fit is given up that lies so far above the wanted -log likelihood. A choice: the first round
# is not representative, and no later one gains a thousand.
MIN_ROUNDS_BEFORE_ABANDONING, ABANDON_EXCESS = 2, 1000.0
# Steps of later rounds: across a gap the cost under frozen gains has other local optima, to which many steps lead.
MAX_LATER_STEPS = 4
# Rounds between searches of the noise ratio over its whole range: near the last value alone, a ratio that tends to
# zero takes a dozen rounds.
WHOLE_RANGE_PERIOD = 5
MAX_REPEATED_FITS = 4  # fits in a row until one converges; a choice that bounds the time of a fit that does not


@dataclass(frozen=True)
class Fit:
    """The end of a fit.

    value   -log likelihood; passes: the last Kalman pass per trace
    gain    decrease of the value in the last three rounds; small for a converged fit
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
                    linear: Problem | None = None, max_rounds: int = 12, near_optimum: bool = False,
                    wanted: float = np.inf, estimate_noise: bool = True) -> Fit:
    """Fit from a point.

    noise    first guess; None: estimated at the start point. There a bad start gives a large ratio, which makes the
             fit easy and so acts as a continuation
    linear   the problem whose gains are used in the first rounds instead of its own: without gap and friction they
             are constant, a second path to the optimum
    arrived  the point is near its optimum: few steps a round from the beginning
    wanted   -log likelihood to be reached: a fit far above it after a few rounds is given up
    renewed  whether the noise is estimated too; else it stays as given
    returns  Fit
    """
    if noise is None:
        noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale))
    best: Fit | None = None
    rounds, lowest = 0, []
    passes = filtered(problem, point, noise)
    value = minus_log_likelihood(passes)
    for rounds in range(1, max_rounds + 1):
        source = linear if linear is not None and rounds <= 2 else problem
        gains = [f.gains for f in (passes if source is problem else filtered(source, point, noise))]
        solution = _solve_round(problem, point, gains, noise, rounds + 2 if near_optimum else rounds)
        moved = _distance_in_std(problem, point, solution)
        solution = _with_backtracking(problem, point, value, solution, noise)
        point = solution.point
        converged = near_optimum or rounds >= 2
        whole_range = (rounds == 2 and not near_optimum) or rounds % WHOLE_RANGE_PERIOD == 0
        around = None if whole_range and noise.memory is None else noise.ratio
        fresh = (_sensor_scales(problem, point, fit_ratio(problem, point, noise, around, converged))
                 if estimate_noise else noise)
        change = abs(np.log(fresh.ratio / noise.ratio))
        noise = fresh
        passes = filtered(problem, point, noise)
        value, before = minus_log_likelihood(passes), value
        if rounds >= MIN_ROUNDS_BEFORE_ABANDONING and value > wanted + ABANDON_EXCESS:
            break
        at_rest = moved < 0.05 and (change < 0.05 or (bool(lowest) and abs(value - before) < 0.02))
        lowest.append(min(value, lowest[-1]) if lowest else value)
        if best is None or value < best.value + MAX_LIKELIHOOD_LOSS:
            best = Fit(solution, noise, value, _without_gains(passes), rounds, 0.0, False)
        if at_rest and rounds >= (2 if near_optimum else 3) and source is problem:
            return replace(best, rounds=rounds, converged=True)
    gain = lowest[-4] - lowest[-1] if len(lowest) > 3 else np.inf
    return replace(best, rounds=rounds, gain=float(gain))


def until_converged(problem: Problem, fit: Fit, runs: int) -> Fit:
    """The fit, continued if it was stopped before it converged: until then the noise is not its own.

    runs  maximum number of further fits
    """
    for _ in range(runs):
        if fit.converged:
            break
        fit = fit_innovations(problem, fit.point, fit.noise, near_optimum=True)
    return fit


def refit_with_tight_tolerance(problem: Problem, fit: Fit) -> Fit:
    """Repeat the last round with a tight tolerance, so that two paths end at the same digits.

    Before that, the noise ratio is searched over its whole range once more.
    """
    fit = with_global_noise_search(problem, fit)
    gains = [f.gains for f in filtered(problem, fit.point, fit.noise)]
    solution = solve_under_noise(problem, fit.point, gains, fit.noise, relative=1e-11)
    passes = filtered(problem, solution.point, fit.noise, keep=False)
    value = minus_log_likelihood(passes)
    if value > fit.value + MAX_LIKELIHOOD_LOSS:
        return fit
    return replace(fit, solution=solution, passes=tuple(passes), value=value)


def with_global_noise_search(problem: Problem, fit: Fit) -> Fit:
    """The fit, or one from a likelier noise ratio: the last rounds searched near their own ratio only."""
    elsewhere = likelier_ratio(problem, fit.point, fit.noise)
    if elsewhere is None:
        return fit
    further = fit_innovations(problem, fit.point, elsewhere, near_optimum=True)
    # The plain likelihood may be worse by a little where the restricted one is better.
    return further if further.value < fit.value + MAX_LIKELIHOOD_LOSS else fit


def _solve_round(problem: Problem, point: Point, gains: Sequence[ObserverGains], noise: Noise,
                 rounds: int) -> Solution:
    # `refit_with_tight_tolerance` does the last digits.
    return solve_under_noise(problem, point, gains, noise, relative=1e-5 if rounds == 1 else 1e-7,
                             hold=problem.later if rounds == 1 else None,
                             max_iterations=60 if rounds <= 2 else MAX_LATER_STEPS)


def solve_under_noise(problem: Problem, point: Point, gains: Sequence[ObserverGains], noise: Noise,
                      **options: Any) -> Solution:
    """The solution of `solve` under the gains of a noise, whose state is in its equations and not in its point."""
    solution = solve(problem.with_memory(noise.memory), with_disturbance_state(point, noise), gains, **options)
    if noise.memory is None:
        return solution
    return replace(solution, point=Point(solution.point.values, tuple(s[:-1] for s in solution.point.starts)))


def _without_gains(passes: Sequence[Filtered]) -> tuple[Filtered, ...]:
    """The passes as without `keep`: a fit, which lives longer, needs no gains and states, the largest arrays."""
    return tuple(replace(f, gains=replace(f.gains, gain=f.gains.gain[:0].copy()), states=f.states[:0].copy())
                 for f in passes)


def _with_backtracking(problem: Problem, before: Point, value: float, solution: Solution,
                       noise: Noise) -> Solution:
    """The solution, or a point on the way to it, where the likelihood itself does not get worse.

    Across a gap, frozen gains can lead to a point that new gains make unlikely.

    value  -log likelihood before
    """
    limit, share = value + MAX_LIKELIHOOD_LOSS, 1.0
    point = solution.point
    while minus_log_likelihood_at(problem, point, noise) > limit and share > 0.05:
        share *= 0.4
        point = Point(before.values + share * (solution.point.values - before.values), tuple(
            a + share * (b - a) for a, b in zip(before.starts, solution.point.starts, strict=True)))
    return solution if share == 1.0 else replace(solution, point=point)


def _distance_in_std(problem: Problem, before: Point, solution: Solution) -> float:
    """The largest move of a parameter, in its standard deviations."""
    if not len(before.values):
        return 0.0
    matrix, _, _ = schur(solution.normal)
    if not np.all(np.isfinite(matrix)):  # the model diverges there
        return np.inf
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-200))
    inverse = np.linalg.pinv(matrix / np.outer(size, size), rcond=1e-13, hermitian=True)
    std = np.sqrt(np.maximum(problem.variance(solution.cost) * np.diag(inverse), 1e-300)) / size
    return float(np.max(np.abs(solution.point.values - before.values) / std))


def _sensor_scales(problem: Problem, point: Point, noise: Noise) -> Noise:
    """Rescale the sensors so that their normalised innovations have one variance."""
    if len(noise.scale) == 1:
        return noise
    normalised = np.concatenate([f.innovations / np.sqrt(f.variance)
                                 for f in filtered(problem, point, noise, keep=False)])
    stds = [np.sqrt(np.nanmean(z**2)) for z in normalised.T]
    return replace(noise, scale=noise.scale * np.array(stds) / stds[0])
