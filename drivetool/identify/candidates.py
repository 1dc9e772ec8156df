"""The explanations of a record between which the default fit chooses.

What the motion foretells is taken out first, as laws; what is left is taken as noise, white or with a memory, or not
asked at all (regression, free runs). Each is fitted with the laws and without.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.identify.engine import by_simulation, coloured
from drivetool.identify.foretold import MOST, foretold, with_laws
from drivetool.identify.influence import influence_of, sandwich
from drivetool.identify.innovations import fit_innovations, settle
from drivetool.identify.judge import Judge
from drivetool.identify.laws import Law, library
from drivetool.identify.log_noise import likely_noise
from drivetool.identify.motion import Motion, motion_of, smoothing_of, top_speed
from drivetool.identify.noise import Noise, fit_ratio
from drivetool.identify.regression import Regression, regress, regressable
from drivetool.identify.setup import first_point
from drivetool.identify.task import Outcome, Task

FREE_RUN = 1.0  # s, of the segments of the fit to free runs
ROUNDS = 4  # of looking for laws: those that are taken out show others
ELSEWHERE = 3.0  # standard deviations between a fit and the regression from which another start is worth its time
FEWEST = 200  # measured values in a row: sixteen blocks of a dozen
QUICK = 6  # rounds of a fit on the way
STANDSTILL = 0.01  # of the top speed: below it friction has no line


@dataclass(frozen=True)
class Candidate:
    """One explanation.

    task        with its laws, at the fitted values
    own         (k,) values of the drive's free parameters, friction as the line nearest to the whole curve
    influence   (BLOCKS, k) each block's share of their error
    covariance  (k, k) by the information matrix; None: the fit has none
    outcome     of the fit; None of a regression
    factors     (m,) of its laws, and the blocks' shares of their error
    """

    name: str
    task: Task
    own: np.ndarray
    influence: np.ndarray
    covariance: np.ndarray | None
    outcome: Outcome | None
    factors: np.ndarray
    factors_influence: np.ndarray


def nearest_line(task: Task, laws: Sequence[Law], motions: Sequence[Motion], top: float) -> np.ndarray:
    """(k, k + m) from the free parameters and the laws' factors to the drive's own parameters.

    Friction is the line Fc + B v nearest to the whole curve over the speeds visited, the inertia its mean over
    the angles visited, the idle torque has the mean of all else. So each means the same with laws and without.
    """
    found = np.hstack([np.eye(len(task.free)), np.zeros((len(task.free), sum(law.size for law in laws)))])
    speed, side = (np.concatenate([getattr(x, n) for x in motions]) for n in ("speed", "side"))
    moving = np.isfinite(speed) & (np.abs(speed) > STANDSTILL * top)
    one = np.ones(len(speed))
    shapes = {"idle torque": {"motor.idle_torque": one}, "friction": {"motor.viscous": speed, "motor.coulomb": side}}
    if "motor.coulomb" not in task.free:  # then the motion has one direction, or that friction is known
        shapes["friction"] = {"motor.viscous": speed, "motor.idle_torque": one}
    column = len(task.free)
    for law in laws:
        lines = {n: c[moving] for n, c in shapes.get(law.of, {}).items() if n in task.free}
        if law.inertia is not None:
            found[task.free.index("motor.inertia"), column:column + law.size] = law.inertia
        elif lines:
            share = np.linalg.lstsq(np.column_stack(list(lines.values())), np.concatenate(law.columns)[moving],
                                    rcond=None)[0]
            found[[task.free.index(n) for n in lines], column:column + law.size] = share
        column += law.size
    return found


@dataclass(frozen=True)
class Field:
    """All candidates of a record by name, and what they share."""

    candidates: dict[str, Candidate]
    laws: tuple[Law, ...]
    judge: Judge
    line: np.ndarray


def explainable(white: Outcome) -> bool:
    """Whether there are several explanations: of a drive of one body that moves, and of enough of a record."""
    task = white.task
    if white.fit is None or len(task.drive.bodies) > 1 or "motor.inertia" not in task.free:
        return False
    return any(_longest(e.signals[task.roles.outputs[0]]) >= FEWEST for e in task.experiments)


def _longest(values: np.ndarray) -> int:
    """The longest run of measured values."""
    missing = np.flatnonzero(~np.isfinite(values))
    return int(np.diff(np.concatenate([[-1], missing, [len(values)]])).max()) - 1


def candidates_of(task: Task, white: Outcome) -> Field:
    """Fit them all.

    task   without laws; white: its fit by innovations with white torque noise
    """
    role = task.roles.outputs[0]
    smoothing = smoothing_of(task.experiments, role)
    top = top_speed(task.experiments, role, smoothing)
    motions = tuple(motion_of(e, role, smoothing, top) for e in task.experiments)
    linear = regressable(task)

    def least_squares(some: Sequence[Law]) -> Regression | None:
        return regress(task, motions, smoothing, some) if linear else None

    white = _better(white, least_squares(()))
    found = {"white": white, "coloured": coloured(white)}
    laws, best = _with_found_laws(found["coloured"], library(
        motions, top, task.drive.motion_unit == "rad", likely_noise(task.experiments, "motor_torque")), least_squares)
    if laws:
        start = best.task.at_point(best.solution.point)
        found["white, laws"] = best if best.fit.noise.memory is None else _better(
            _from(start, white), least_squares(laws))
        found["coloured, laws"] = best if best.fit.noise.memory is not None else coloured(best)
    else:
        found |= {f"{name}, laws": outcome for name, outcome in found.items()}
    start = best.task.at_point(best.solution.point)
    found["free runs, laws"] = _by_free_runs(start, smoothing.window if role.endswith("angle") else 0)
    line = nearest_line(task, laws, motions, top)
    plain = np.eye(len(task.free))
    candidates = {}
    for name, outcome in found.items():
        covariance, shares = influence_of(outcome)
        values = outcome.solution.point.values
        if outcome.task.free != start.free and outcome.fit is None:  # the idle torque is that of the fit before
            place = [start.free.index(n) for n in outcome.task.free]
            _, wide = influence_of(best)
            wide[:, place] = shares
            shares, values = wide, np.array([outcome.drive.values[n] for n in start.free])
            outcome = replace(outcome, task=replace(outcome.task, free=start.free))
        to = line if laws and name.endswith("laws") else plain
        candidates[name] = Candidate(name, outcome.task.at(dict(zip(outcome.task.free, values, strict=True))), to @ values, shares @ to.T,
                                     to @ covariance @ to.T if outcome.fit else None, outcome,
                                     values[len(plain):], shares[:, len(plain):])
    if linear:
        for name, some in (("regression", ()), ("regression, laws", laws)):
            r = least_squares(some)
            to = line if some else plain
            at = with_laws(task, some).at(dict(zip(r.names, r.values, strict=True)))
            candidates[name] = Candidate(name, at, to @ r.values, r.influence @ to.T, None, None,
                                         r.values[len(plain):], r.influence[:, len(plain):])
    return Field(candidates, tuple(laws), Judge(smoothing, white.fit.noise), line)


def _by_free_runs(task: Task, lag: int) -> Outcome:
    """Fit to free runs, each with an idle torque of its own; the drive's stays as it is."""
    idle = "motor.idle_torque"
    return by_simulation(replace(task, free=tuple(n for n in task.free if n != idle)), FREE_RUN, [{}], near=True,
                         lag=lag, own=idle in task.free)


def _with_found_laws(best: Outcome, every: Sequence[Law], least_squares: Callable[[Sequence[Law]], Regression | None],
                     ) -> tuple[tuple[Law, ...], Outcome]:
    """(the laws that the motion foretells, the fit with them)."""
    laws: tuple[Law, ...] = ()
    for _ in range(ROUNDS):
        more, factors = foretold(best.task, best.solution.point, best.fit.noise,
                                 [law for law in every if law not in laws], MOST - len(laws))
        if not more:
            break
        laws += tuple(more)
        start = with_laws(best.task.at_point(best.solution.point), more, factors=factors)
        best = _better(_from(start, best, QUICK), least_squares(laws))
    return laws, best if best.converged else _from(best.task.at_point(best.solution.point), best)


def _better(fit: Outcome, by: Regression | None) -> Outcome:
    """The likelier of a fit and, where that is elsewhere, of one from where the regression is."""
    if by is None:
        return fit
    covariance, _ = influence_of(fit)
    off = np.abs(fit.solution.point.values - by.values)
    if np.all(off < ELSEWHERE * np.sqrt(sandwich(by.influence).diagonal() + covariance.diagonal())):
        return fit
    values = np.clip(by.values, fit.problem.low, fit.problem.high)
    task = fit.task.at(dict(zip(by.names, values, strict=True)))
    problem, noise = fit.problem, fit.fit.noise
    point = first_point(task.drive, problem, task.roles)
    # Sought everywhere: that of a fit which went astray hides what is right here.
    fresh = fit_ratio(problem, point, Noise(1.0, None, noise.scale))
    other = fit_innovations(problem, point, replace(noise, ratio=fresh.ratio), arrived=True, most=QUICK)
    other = settle(problem, other) if other.converged else other
    others = [_from(task, fit, QUICK), Outcome(task, problem, other.solution, other, fit.starts, other.converged)]
    return min([fit, *others], key=lambda o: o.fit.value)


def _from(task: Task, before: Outcome, most: int = 12) -> Outcome:
    """Innovations fit from the values and the noise of an earlier one, of so many rounds at most."""
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    point = replace(point, starts=before.solution.point.starts)
    fit = fit_innovations(problem, point, before.fit.noise, arrived=True, most=most)
    fit = settle(problem, fit) if fit.converged else fit
    return Outcome(task, problem, fit.solution, fit, before.starts, fit.converged)
