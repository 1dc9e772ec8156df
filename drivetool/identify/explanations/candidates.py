"""The explanations of a record between which the default fit chooses.

What the motion foretells is taken out first, as laws; what is left is taken as noise, white or with a memory, or
not asked at all (regression, free runs). Each is fitted with the laws and without.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivetool.identify.engine import by_simulation, coloured
from drivetool.identify.explanations.fit_with_laws import likelier, near, with_found_laws
from drivetool.identify.explanations.foretold import with_laws
from drivetool.identify.explanations.influence import influence_of
from drivetool.identify.explanations.judge import Judge, run_length
from drivetool.identify.explanations.laws import Law, library
from drivetool.identify.explanations.log_noise import likely_noise
from drivetool.identify.explanations.motion import Motions, motions_of
from drivetool.identify.explanations.own_parameters import nearest_line
from drivetool.identify.explanations.regression import Regression, regress, regressable
from drivetool.identify.task import Outcome, Task
from drivetool.identify.told_together import only_ratios

FEWEST = 200  # measured values in a row: sixteen blocks of a dozen
IDLE = "motor.idle_torque"


@dataclass(frozen=True)
class Candidate:
    """One explanation.

    task        with its laws, at the fitted values
    own         (k,) values of the drive's free parameters, friction as the line nearest to the whole curve
    influence   (BLOCKS, k) each block's share of their error
    covariance  (k, k) by the information matrix; None: the fit has none
    outcome     of the fit; None of a regression
    factors     (m,) of its laws; factor_influence: (BLOCKS, m) the blocks' shares of their error
    line        (k, k + m) from all fitted values to the drive's own
    """

    task: Task
    own: np.ndarray
    influence: np.ndarray
    covariance: np.ndarray | None
    outcome: Outcome | None
    factors: np.ndarray
    factor_influence: np.ndarray
    line: np.ndarray


@dataclass(frozen=True)
class Field:
    """All candidates of a record by name, the laws that were found, the judge, and the motion."""

    candidates: Mapping[str, Candidate]
    laws: tuple[Law, ...]
    judge: Judge
    seen: Motions


def why_alone(white: Outcome) -> str:
    """Why a record has one explanation only, the innovations fit; empty where several are tried."""
    task = white.task
    if len(task.drive.bodies) > 1:
        return "other explanations are tried on drives of one body so far"
    if white.fit is None or "motor.inertia" not in task.free:
        return "the inertia is held"
    if not any(_longest(e.signals[task.roles.outputs[0]]) >= FEWEST for e in task.experiments):
        return f"no {FEWEST} values of the sensor were measured in a row"
    if only_ratios(white):
        return "no torque of known size acts"
    return ""


def _longest(values: np.ndarray) -> int:
    """The longest run of measured values."""
    missing = np.flatnonzero(~np.isfinite(values))
    return int(np.diff(np.concatenate([[-1], missing, [len(values)]])).max()) - 1


def candidates_of(task: Task, white: Outcome) -> Field:
    """Fit them all.

    task   without laws; white: its fit by innovations with white torque noise
    """
    seen, linear = motions_of(task.experiments, task.roles.outputs[0]), regressable(task)
    plain = regress(task, seen) if linear else None
    white = likelier(white, plain) if plain else white
    found = {"white": white, "coloured": coloured(white)}
    every = library(seen, task.drive.motion_unit == "rad", likely_noise(task.experiments, "motor_torque"))
    laws, best = with_found_laws(found["coloured"], every, seen, linear)
    with_them = regress(task, seen, laws) if linear and laws else plain
    if laws and best.fit.noise.memory is None:
        found |= {"white, laws": best, "coloured, laws": coloured(best)}
    elif laws:
        start = near(best.task.at_point(best.solution.point), white)
        found |= {"white, laws": likelier(start, with_them) if with_them else start, "coloured, laws": best}
    line = nearest_line(task, laws, seen)
    candidates = {name: _of_fit(outcome, line) for name, outcome in found.items()}
    if plain and with_them:
        candidates["regression"] = _of_regression(plain, task, (), line)
        if laws:
            candidates["regression, laws"] = _of_regression(with_them, task, laws, line)
    if not laws:
        candidates |= {f"{name}, laws": c for name, c in candidates.items()}
    candidates["free runs, laws"] = _of_free_runs(best, seen, line)
    return Field(candidates, laws, Judge(seen.smoothing, white.fit.noise), seen)


def _of_fit(outcome: Outcome, line: np.ndarray) -> Candidate:
    covariance, influence = influence_of(outcome)
    return _candidate(outcome.task.at_point(outcome.solution.point), outcome.solution.point.values, influence,
                      covariance, outcome, line)


def _of_free_runs(best: Outcome, seen: Motions, line: np.ndarray) -> Candidate:
    """The fit to free runs, each with an idle torque of its own; that of the drive stays as it was before."""
    start = best.task.at_point(best.solution.point)
    fitted = tuple(n for n in start.free if n != IDLE)
    outcome = by_simulation(replace(start, free=fitted), run_length(start), [{}], near=True, lag=seen.lag,
                            own=IDLE in start.free)
    _, influence = influence_of(best)
    _, influence[:, [start.free.index(n) for n in fitted]] = influence_of(outcome)
    values = np.array([outcome.drive.values[n] for n in start.free])
    task = start.at(dict(zip(start.free, values, strict=True)))
    return _candidate(task, values, influence, None, outcome, line)


def _of_regression(found: Regression, task: Task, laws: tuple[Law, ...], line: np.ndarray) -> Candidate:
    at = with_laws(task, laws).at(dict(zip(found.names, found.values, strict=True)))
    return _candidate(at, found.values, found.influence, None, None, line)


def _candidate(task: Task, values: np.ndarray, influence: np.ndarray, covariance: np.ndarray | None,
               outcome: Outcome | None, line: np.ndarray) -> Candidate:
    k = len(line)
    to = line[:, :len(values)]  # without laws it is one to one
    return Candidate(task, to @ values, influence @ to.T, None if covariance is None else to @ covariance @ to.T,
                     outcome, values[k:], influence[:, k:], to)
