"""Levenberg-Marquardt on block-arrow normal equations, with bounds.

Start states of the traces are eliminated by a Schur complement, so the cost of a step does not
grow with their number. A rejected trial costs a simulation without sensitivities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive.simulation import Gains
from drivetool.identify.problem.problem import Normal, Point, Problem

FAINT = 1e-9  # of an output over a start state, both in SI: what is less has been left by rounding
BOLD = 0.1  # damping below which a step tells how far the minimum is
LEAST = 1e-14  # share of the cost below which a promised decrease is rounding


@dataclass(frozen=True)
class Solution:
    """Where a fit ended: the point, its normal equations, iterations, and whether it converged."""

    point: Point
    normal: Normal
    iterations: int
    converged: bool

    @property
    def cost(self) -> float:
        """Sum of squared weighted residuals."""
        return self.normal.cost


def solve(problem: Problem, point: Point, gains: Sequence[Gains] | None = None, *,
          most: int = 60, relative: float = 1e-8, damping: float = 1e-3,
          hold: np.ndarray | None = None, enough: float = 0.0, least: float = LEAST,
          apart: bool = False) -> Solution:
    """Minimise the weighted squared residuals from a point.

    problem   k parameters, traces with m free start states each
    gains     frozen observers, one per trace, for one-step errors; None: simulation errors
    most      iterations; relative: decrease of the cost at which the fit has converged
    hold      (k,) parameters that do not move
    enough    cost from which on there is nothing left to gain
    least     share of the cost below which a promised decrease is not tried
    apart     whether a trace that a step made worse may keep its start: one that friction or a gap makes hard to
              start does not damp the steps of the others then
    returns   Solution; where the model diverges from the first point on, that point
    """
    normal, ahead = _whole(problem, point, gains), True
    if not np.isfinite(normal.cost):
        return Solution(point, normal, 0, False)
    for iteration in range(1, most + 1):
        trial = _accepted(problem, point, normal, gains, damping, hold, ahead, least, apart)
        if trial is None:
            return Solution(point, normal, iteration, True)
        done = normal.cost - trial.cost < relative * normal.cost or trial.cost < enough
        there = trial.normal or _whole(problem, trial.point, gains)
        if not np.isfinite(there.cost):
            return Solution(point, normal, iteration, False)
        point, normal, damping, ahead = trial.point, there, trial.damping, trial.first
        if done:
            return Solution(point, normal, iteration, True)
    return Solution(point, normal, most, False)


def approach(problem: Problem, point: Point, gains: Sequence[Gains] | None, most: int, *,
             relative: float = 1e-6, damping: float = 1e-3,
             hold: np.ndarray | None = None) -> tuple[Point, float]:
    """A few steps towards the minimum: (point, cost there), no normal equations at the end."""
    normal, cost, ahead = None, np.inf, True
    for left in range(most - 1, -1, -1):
        normal = normal or _whole(problem, point, gains)
        if not np.isfinite(normal.cost):
            return point, cost
        trial = _accepted(problem, point, normal, gains, damping, hold, ahead and left > 0)
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
    """A better point, its cost and the damping to go on with; first: whether it was the first that was tried.

    normal  its normal equations, if they came with the cost
    """

    point: Point
    cost: float
    damping: float
    first: bool
    normal: Normal | None


def _accepted(problem: Problem, point: Point, normal: Normal, gains: Sequence[Gains] | None, damping: float,
              hold: np.ndarray | None, ahead: bool, least: float = LEAST, apart: bool = False) -> _Trial | None:
    """A better point, None if there is none.

    ahead  whether the first trial is simulated with sensitivities at once: they cost less than twice the
           simulation, and where steps have been going well the trial is where the next one begins
    """
    first, before = True, problem.costs(point, gains) if apart else None
    while damping < 1e12:
        step, own = marquardt_step(problem, point, normal, damping, hold)
        # A step clipped at a bound may point uphill (below zero); more damping turns it.
        promise = _promised(normal, step, own)
        if 0.0 <= promise < (least if first and damping < BOLD else LEAST) * normal.cost:
            break
        trial = problem.moved(point, step, own)
        if not _too_far(problem, point, trial):
            there = _whole(problem, trial, gains) if ahead and first else None
            cost = problem.cost(trial, gains) if there is None else there.cost
            if apart and not cost < normal.cost:
                trial, own, there = *_some_stay(problem, point, trial, own, before, gains), None
                cost, promise = problem.cost(trial, gains), _promised(normal, step, own)
            if cost < normal.cost:
                # What was rejected once would be again.
                damping = max(damping * (_trust(normal.cost - cost, promise) if first else 1.0), 1e-12)
                return _Trial(trial, cost, damping, first, there)
            first = False
        damping *= 4.0
    return None


def _some_stay(problem: Problem, point: Point, trial: Point, own: Sequence[np.ndarray], before: np.ndarray,
               gains: Sequence[Gains] | None) -> tuple[Point, list[np.ndarray]]:
    """(the trial, the steps of the start states) with the old start of every trace that got worse.

    before  (traces,) costs at the point
    """
    worse = problem.costs(trial, gains) >= before
    starts = tuple(old if w else new for old, new, w in zip(point.starts, trial.starts, worse, strict=True))
    return replace(trial, starts=starts), [0.0 * step if w else step for step, w in zip(own, worse, strict=True)]


def _trust(lowered: float, promise: float) -> float:
    """By how much the damping changes after a step: it falls where the cost fell as promised.

    promise  by `_promised`, twice what an undamped step can keep
    """
    kept = 2.0 * lowered / promise if promise > 0.0 else 1.0
    return 0.125 if kept > 0.75 else 0.5 if kept > 0.5 else 1.0 if kept > 0.25 else 2.0


def _whole(problem: Problem, trial: Point, gains: Sequence[Gains] | None) -> Normal:
    """The normal equations at a trial, whose cost is infinite where the model or a sensitivity diverges."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        normal = problem.normal(trial, gains)
    finite = np.isfinite(normal.cost) and all(
        np.isfinite(a).all() for a in (normal.shared, normal.slope, np.array(normal.own), np.array(normal.cross)))
    return normal if finite else replace(normal, cost=np.inf)


def _promised(normal: Normal, step: np.ndarray, own: Sequence[np.ndarray]) -> float:
    """By how much a step would lower the cost if the problem were linear, at most."""
    return float(-2.0 * (normal.slope @ step + sum(a @ b for a, b in zip(normal.own_slope, own, strict=True))))


def blocked(problem: Problem, point: Point, normal: Normal) -> np.ndarray:
    """(k,) whether a parameter sits on a bound and the cost falls beyond it."""
    at_low = (point.values <= problem.low) & (normal.slope > 0.0)
    at_high = (point.values >= problem.high) & (normal.slope < 0.0)
    return at_low | at_high


def schur(normal: Normal, damping: float = 0.0) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """(matrix (k, k), slope (k,), inverse own blocks) with the start states eliminated.

    damping  of the start states, relative to their own information; a trace of it would pass for
             knowledge where start states and parameters trade against each other
    """
    matrix, slope = normal.shared.copy(), normal.slope.copy()
    if not normal.own:
        return matrix, slope, []
    inverses = _inverses(np.array(normal.own), damping)
    cross = np.array(normal.cross)
    taken = cross @ inverses
    matrix -= np.einsum("skm,slm->kl", taken, cross)
    slope -= np.einsum("skm,sm->k", taken, np.array(normal.own_slope))
    return matrix, slope, list(inverses)


def _inverses(own: np.ndarray, damping: float) -> np.ndarray:
    """Inverses of start-state blocks (traces, m, m); a state without influence does not move."""
    size = np.sqrt(np.einsum("sii->si", own))
    size[size < FAINT] = 1.0
    square = size[:, :, None] * size[:, None, :]
    scaled = own / square + damping * np.eye(own.shape[1])
    values, vectors = np.linalg.eigh(scaled)
    told = np.abs(values) > 1e-13 * np.abs(values).max(axis=1, keepdims=True)
    over = np.divide(1.0, values, out=np.zeros_like(values), where=told)
    return (vectors * over[:, None, :]) @ vectors.transpose(0, 2, 1) / square


def marquardt_step(problem: Problem, point: Point, normal: Normal, damping: float,
                   hold: np.ndarray | None = None) -> tuple[np.ndarray, list[np.ndarray]]:
    """((k,) step inside the bounds, steps of the start states per trace); hold: (k,) what does not move."""
    matrix, slope, inverses = schur(normal, damping + 1e-12)
    size = np.sqrt(np.diag(normal.shared))
    size[size == 0.0] = 1.0
    move = ~blocked(problem, point, normal) & (np.diag(normal.shared) > 0.0)
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


def _too_far(problem: Problem, point: Point, trial: Point) -> bool:
    """Half the value at most: the model is not linear over more than that."""
    change = np.abs(trial.values - point.values)
    if np.any(change > 0.5 * np.abs(point.values) + problem.size):
        return True
    return not all(np.all(np.isfinite(s)) for s in trial.starts)
