"""Levenberg-Marquardt on block-arrow normal equations, with bounds.

Start states of the traces are eliminated by a Schur complement, so the cost of a step does not
grow with their number. A rejected trial costs a simulation without sensitivities.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive.simulation import ObserverGains
from drivetool.errors import ImpossibleValues
from drivetool.identify.problem.problem import Normal, Point, Problem

# Of an output over a start state, both in SI: a smaller sensitivity is a rounding error.
MIN_START_SENSITIVITY = 1e-9
# Share of the cost below which a predicted decrease is rounding: some tens of units in the last place.
MIN_RELATIVE_DECREASE = 1e-14


@dataclass(frozen=True)
class Solution:
    """End of a fit: the point, its normal equations, iterations, and whether it converged."""

    point: Point
    normal: Normal
    iterations: int
    converged: bool

    @property
    def cost(self) -> float:
        """Sum of squared weighted residuals."""
        return self.normal.cost


def solve(problem: Problem, point: Point, gains: Sequence[ObserverGains] | None = None, *,
          max_iterations: int = 60, relative: float = 1e-8, damping: float = 1e-3,
          hold: np.ndarray | None = None, target_cost: float = 0.0, keeps_worse: bool = False) -> Solution:
    """Minimise the weighted squared residuals from a point.

    problem   k parameters, traces with m free start states each
    gains     frozen observers, one per trace, for one-step errors; None: simulation errors
    max_iterations  at most; relative: decrease of the cost at which the fit has converged
    hold      (k,) parameters that do not move
    target_cost     below which the fit ends
    keeps_worse     whether a trace that a step made worse keeps its start: a start state that friction or a gap
                    makes hard to fit then does not damp the steps of the others
    returns   Solution; where the model diverges at the first point, that point
    """
    normal, ahead = _normal_or_infinite(problem, point, gains), True
    if not np.isfinite(normal.cost):
        return Solution(point, normal, 0, False)
    for iteration in range(1, max_iterations + 1):
        trial = _accepted_trial(problem, point, normal, gains, damping, hold, ahead, keeps_worse)
        if trial is None:
            return Solution(point, normal, iteration, True)
        done = normal.cost - trial.cost < relative * normal.cost or trial.cost < target_cost
        normal_there = trial.normal or _normal_or_infinite(problem, trial.point, gains)
        if not np.isfinite(normal_there.cost):
            return Solution(point, normal, iteration, False)
        point, normal, damping, ahead = trial.point, normal_there, trial.damping, trial.first
        if done:
            return Solution(point, normal, iteration, True)
    return Solution(point, normal, max_iterations, False)


def take_steps(problem: Problem, point: Point, gains: Sequence[ObserverGains] | None, steps: int, *,
             relative: float = 1e-6, damping: float = 1e-3,
             hold: np.ndarray | None = None) -> tuple[Point, float]:
    """A few steps towards the minimum: (point, cost there), no normal equations at the end."""
    normal, cost, ahead = None, np.inf, True
    for left in range(steps - 1, -1, -1):
        normal = normal or _normal_or_infinite(problem, point, gains)
        if not np.isfinite(normal.cost):
            return point, cost
        trial = _accepted_trial(problem, point, normal, gains, damping, hold, ahead and left > 0)
        if trial is None:
            return point, normal.cost
        done = normal.cost - trial.cost < relative * normal.cost
        point, cost, normal = trial.point, trial.cost, trial.normal
        damping, ahead = trial.damping, trial.first
        if done:
            break
    return point, cost


@dataclass(frozen=True)
class _Trial:
    """A better point, its cost and the next damping; first: whether it was the first trial.

    normal  its normal equations, if they came with the cost
    """

    point: Point
    cost: float
    damping: float
    first: bool
    normal: Normal | None


def _accepted_trial(problem: Problem, point: Point, normal: Normal, gains: Sequence[ObserverGains] | None,
                    damping: float, hold: np.ndarray | None, ahead: bool, keeps_worse: bool = False,
                    ) -> _Trial | None:
    """A better point, None if there is none.

    ahead  whether the first trial is simulated with sensitivities at once: they cost less than twice the
           simulation, and after successful steps the next one begins at the trial
    """
    first, before = True, problem.costs(point, gains) if keeps_worse else None
    while damping < 1e12:
        step, own = marquardt_step(problem, point, normal, damping, hold)
        # A step clipped at a bound may point uphill (below zero); more damping turns it.
        predicted = _predicted_decrease(normal, step, own)
        if 0.0 <= predicted < MIN_RELATIVE_DECREASE * normal.cost:
            break
        trial = problem.moved(point, step, own)
        if not _beyond_linear_range(problem, point, trial):
            with suppress(ImpossibleValues):
                normal_there = _normal_or_infinite(problem, trial, gains) if ahead and first else None
                cost = problem.cost(trial, gains) if normal_there is None else normal_there.cost
                if keeps_worse and not cost < normal.cost:
                    trial, own, normal_there = *_keep_worse_starts(problem, point, trial, own, before, gains), None
                    cost, predicted = problem.cost(trial, gains), _predicted_decrease(normal, step, own)
                if cost < normal.cost:
                    # A damping rejected once would be rejected again.
                    damping *= _damping_factor(normal.cost - cost, predicted) if first else 1.0
                    return _Trial(trial, cost, max(damping, 1e-12), first, normal_there)
            first = False
        damping *= 4.0
    return None


def _keep_worse_starts(problem: Problem, point: Point, trial: Point, own: Sequence[np.ndarray], before: np.ndarray,
                       gains: Sequence[ObserverGains] | None) -> tuple[Point, list[np.ndarray]]:
    """(the trial, the steps of the start states) with the old start of every trace that got worse.

    before  (traces,) costs at the point
    """
    worse = problem.costs(trial, gains) >= before
    starts = tuple(old if w else new for old, new, w in zip(point.starts, trial.starts, worse, strict=True))
    return replace(trial, starts=starts), [0.0 * step if w else step for step, w in zip(own, worse, strict=True)]


def _damping_factor(lowered: float, predicted: float) -> float:
    """Factor of the damping after a step: it falls where the cost fell as predicted.

    predicted  by `_predicted_decrease`, twice the decrease by an undamped step
    """
    gain_ratio = 2.0 * lowered / predicted if predicted > 0.0 else 1.0
    return 0.125 if gain_ratio > 0.75 else 0.5 if gain_ratio > 0.5 else 1.0 if gain_ratio > 0.25 else 2.0


def _normal_or_infinite(problem: Problem, trial: Point, gains: Sequence[ObserverGains] | None) -> Normal:
    """The normal equations at a trial, whose cost is infinite where the model or a sensitivity diverges."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        normal = problem.normal(trial, gains)
    finite = np.isfinite(normal.cost) and all(
        np.isfinite(a).all() for a in (normal.shared, normal.slope, np.array(normal.own), np.array(normal.cross)))
    return normal if finite else replace(normal, cost=np.inf)


def _predicted_decrease(normal: Normal, step: np.ndarray, own: Sequence[np.ndarray]) -> float:
    """Upper bound of the decrease of the cost by a step, if the problem were linear."""
    return float(-2.0 * (normal.slope @ step + sum(a @ b for a, b in zip(normal.own_slope, own, strict=True))))


def blocked_by_bounds(problem: Problem, point: Point, normal: Normal) -> np.ndarray:
    """(k,) whether a parameter sits on a bound and the cost falls beyond it."""
    at_low = (point.values <= problem.low) & (normal.slope > 0.0)
    at_high = (point.values >= problem.high) & (normal.slope < 0.0)
    return at_low | at_high


def schur(normal: Normal, damping: float = 0.0) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """(matrix (k, k), slope (k,), inverse own blocks) with the start states eliminated.

    damping  of the start states, relative to their own information; even a small one would act as a
             prior where start states and parameters are collinear
    """
    matrix, slope = normal.shared.copy(), normal.slope.copy()
    if not normal.own:
        return matrix, slope, []
    inverses = _start_block_inverses(np.array(normal.own), damping)
    cross = np.array(normal.cross)
    eliminated = cross @ inverses
    matrix -= np.einsum("skm,slm->kl", eliminated, cross)
    slope -= np.einsum("skm,sm->k", eliminated, np.array(normal.own_slope))
    return matrix, slope, list(inverses)


def _start_block_inverses(own: np.ndarray, damping: float) -> np.ndarray:
    """Inverses of start-state blocks (traces, m, m); a state without influence does not move."""
    size = np.sqrt(np.einsum("sii->si", own))
    size[size < MIN_START_SENSITIVITY] = 1.0
    square = size[:, :, None] * size[:, None, :]
    scaled = own / square + damping * np.eye(own.shape[1])
    values, vectors = np.linalg.eigh(scaled)
    identifiable = np.abs(values) > 1e-13 * np.abs(values).max(axis=1, keepdims=True)
    inverse_values = np.divide(1.0, values, out=np.zeros_like(values), where=identifiable)
    return (vectors * inverse_values[:, None, :]) @ vectors.transpose(0, 2, 1) / square


def marquardt_step(problem: Problem, point: Point, normal: Normal, damping: float,
                   hold: np.ndarray | None = None) -> tuple[np.ndarray, list[np.ndarray]]:
    """((k,) step inside the bounds, steps of the start states per trace); hold: (k,) fixed parameters."""
    matrix, slope, inverses = schur(normal, damping + 1e-12)
    size = nonzero_scale(np.sqrt(np.diag(normal.shared)))
    move = ~blocked_by_bounds(problem, point, normal) & (np.diag(normal.shared) > 0.0)
    if hold is not None:
        move &= ~hold
    step = np.zeros(len(slope))
    if move.any():
        i = np.flatnonzero(move)
        scaled = matrix[np.ix_(i, i)] / np.outer(size[i], size[i]) + damping * np.eye(len(i))
        step[i] = -np.linalg.lstsq(scaled, slope[i] / size[i], rcond=1e-14)[0] / size[i]
    bounded = np.clip(point.values + step, problem.low, problem.high) - point.values
    own = [-inverse @ (own_slope + cross.T @ bounded) for cross, inverse, own_slope
           in zip(normal.cross, inverses, normal.own_slope, strict=True)]
    return bounded, own


def nonzero_scale(size: np.ndarray) -> np.ndarray:
    """Sizes (k,) to divide by: one in the place of zero."""
    return np.where(size == 0.0, 1.0, size)


def _beyond_linear_range(problem: Problem, point: Point, trial: Point) -> bool:
    """Whether a step exceeds half the value: the model is not linear over more than that."""
    change = np.abs(trial.values - point.values)
    if np.any(change > 0.5 * np.abs(point.values) + problem.size):
        return True
    return not all(np.all(np.isfinite(s)) for s in trial.starts)
