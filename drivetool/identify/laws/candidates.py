"""The explanations of a record between which the default fit chooses.

What the motion foretells is taken out first, as laws; what is left is taken as noise, white or with a memory, or
not asked at all (regression, free runs). Each is fitted with the laws and without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.identify.fit import again, by_innovations, by_simulation, coloured
from drivetool.identify.identifiability import only_ratios
from drivetool.identify.laws.across_gap import confirmed, from_free_runs, was_confirmed
from drivetool.identify.laws.fit_with_laws import likelier, near, with_found_laws
from drivetool.identify.laws.foretold import with_laws
from drivetool.identify.laws.influence import influence_of, scores_of
from drivetool.identify.laws.judge import SHARES, Judge, run_length
from drivetool.identify.laws.laws import Law, library, unfelt
from drivetool.identify.laws.own_parameters import nearest_line
from drivetool.identify.laws.regression import Regression, regress, regressable
from drivetool.identify.motion import Motions, motions_of, motions_through
from drivetool.identify.noise import filtered, likely_noise
from drivetool.identify.setup import Outcome, Task, has_gap

FEWEST = 200  # measured values in a row: sixteen blocks of a dozen


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
    blocks      (k,) effective number of blocks that tell each value; endless where that is not asked
    """

    task: Task
    own: np.ndarray
    influence: np.ndarray
    covariance: np.ndarray | None
    outcome: Outcome | None
    factors: np.ndarray
    factor_influence: np.ndarray
    line: np.ndarray
    blocks: np.ndarray


@dataclass(frozen=True)
class Field:
    """All candidates of a record by name.

    laws  that were found; judge: of the candidates; seen: the motion of each body
    task  of the drive without laws; what a law stands for that is a parameter is free
    """

    candidates: Mapping[str, Candidate]
    laws: tuple[Law, ...]
    judge: Judge
    seen: Mapping[str, Motions]
    task: Task

    @property
    def rivals(self) -> tuple[Outcome, Outcome, Outcome]:
        """The likeliest fit without laws, the one with white noise, and the likeliest with laws: see left_out."""
        found = [outcome for name in ("coloured", "white", "coloured, laws", "white, laws")
                 if (outcome := self.candidates[name].outcome) is not None]
        return found[0], found[1], min(found[2:], key=lambda outcome: outcome.fit.value)


def why_alone(white: Outcome) -> str:
    """Why a record has one explanation only, the innovations fit; empty where several are tried."""
    task = white.task
    if white.fit is None or not ("motor.inertia" in task.free or has_gap(task)):
        return "the inertia is held"
    if not any(_longest(e.signals[task.roles.outputs[0]]) >= FEWEST for e in task.experiments):
        return f"no {FEWEST} values of the sensor were measured in a row"
    # A torque that varies, and still none is told by: perhaps it is of another axis, which free runs show.
    if only_ratios(white) and not any(np.ptp(e.signals["motor_torque"][a:b]) for e in task.experiments
                                      for a, b in e.segments):
        return "no torque of known size acts"
    return ""


def _longest(values: np.ndarray) -> int:
    """The longest run of measured values."""
    missing = np.flatnonzero(~np.isfinite(values))
    return int(np.diff(np.concatenate([[-1], missing, [len(values)]])).max()) - 1


def candidates_of(white: Outcome, held: Sequence[str] = ()) -> Field:
    """Fit them all.

    white  the fit without laws, by innovations with white torque noise
    held   names of parameters that may not be freed
    """
    task = white.task
    seen, linear = motions_of(task.experiments, task.roles.outputs[0]), regressable(task)
    plain = regress(task, seen) if linear else None
    white = likelier(white, plain) if plain else white
    found = {"white": white, "coloured": coloured(white)}
    while True:
        motions = motions_of_bodies(found["coloured"], seen)
        every = [law for law in laws_of(task, motions) if law.parameter not in (*held, *task.free)]
        laws, best = with_found_laws(found["coloured"], every, seen, linear)
        freed = [law.parameter for law in laws if law.parameter]
        if not freed:
            break
        white = freed_too(white, freed)
        task, found = white.task, {"white": white, "coloured": coloured(white)}
    smoothings = {e.step: m.smoothing for e, m in zip(task.experiments, seen.each, strict=True)}
    judge = Judge(smoothings, white.fit.noise)
    if laws and has_gap(task) and not confirmed(judge, found["coloured"], best):
        laws, best = (), found["coloured"]
    with_them = regress(task, seen, laws) if linear and laws else plain
    if laws and best.fit.noise.memory is None:
        found |= {"white, laws": best, "coloured, laws": coloured(best)}
    elif laws:
        start = near(best.task.at_point(best.solution.point), white)
        found |= {"white, laws": likelier(start, with_them) if with_them else start, "coloured, laws": best}
    line = nearest_line(task, laws, motions)
    candidates = {name: _of_fit(outcome, line) for name, outcome in found.items()}
    if plain and with_them:
        candidates["regression"] = _of_regression(plain, task, (), line)
        if laws:
            candidates["regression, laws"] = _of_regression(with_them, task, laws, line)
    if not laws:
        candidates |= {f"{name}, laws": c for name, c in candidates.items()}
    candidates["free runs, laws"] = _of_free_runs(best, seen, line)
    if has_gap(task):
        likeliest = min(("coloured, laws", "white, laws"), key=lambda n: candidates[n].outcome.fit.value)
        other = from_free_runs(candidates[likeliest].outcome, candidates["free runs, laws"].task)
        candidates["coloured, laws"] = _of_fit(other, line)
    return Field(candidates, laws, judge, motions, task)


def freed_too(white: Outcome, names: Sequence[str]) -> Outcome:
    """The fit with further parameters free, from everywhere: without them it may have gone astray.

    Across a gap from where it was: a place that its search has confirmed is not searched for again.
    """
    task = white.task.at_point(white.solution.point)
    guess = {n: task.drive.values.get(f"{task.drive.bodies[0]}.{n.partition('.')[2]}", 0.0) for n in names}
    free = tuple(n for n in task.drive.quantities if n in {*task.free, *names})
    wider = replace(task.at(guess), free=free)
    if has_gap(task):
        found = again(wider, white.fit.noise)
        return found if was_confirmed(white) else replace(found, starts=())
    return by_innovations(wider, [{}])


def motions_of_bodies(outcome: Outcome, seen: Motions) -> dict[str, Motions]:
    """The motion of each body, by its own sensor or by the states of a fit; seen: that of the motor."""
    task, found = outcome.task, {outcome.task.drive.bodies[0]: seen}
    measured = {}
    for role in task.roles.outputs[1:]:
        owner, _, kind = role.rpartition("_")
        if kind in ("speed", "angle") and any(_longest(e.signals[role]) >= FEWEST for e in task.experiments):
            measured[task.drive.load if owner == "load" else owner] = role
    passes = None
    for place, body in enumerate(task.drive.bodies[1:], 1):
        if body in measured:
            found[body] = motions_of(task.experiments, measured[body])
            continue
        passes = passes or filtered(outcome.problem, outcome.solution.point, outcome.fit.noise)
        found[body] = motions_through(task.experiments, [f.states[:, place] for f in passes], seen)
    return found


def laws_of(task: Task, motions: Mapping[str, Motions]) -> list[Law]:
    """Every law on every body."""
    found = list(unfelt(likely_noise(task.experiments, "motor_torque")))
    for body, seen in motions.items():
        among = f", on the {body}" if len(motions) > 1 else ""
        found += library(seen, task.drive.motion_unit == "rad", body, among)
    return found


def _of_fit(outcome: Outcome, line: np.ndarray) -> Candidate:
    covariance, influence = influence_of(outcome)
    return _candidate(outcome.task.at_point(outcome.solution.point), outcome.solution.point.values, influence,
                      covariance, outcome, line)


def _of_free_runs(best: Outcome, seen: Motions, line: np.ndarray) -> Candidate:
    """The fit to free runs, each with an idle torque of its own; that of the drive is as it was before."""
    start = best.task.at_point(best.solution.point)
    fitted, length = tuple(n for n in start.free if not n.endswith(".idle_torque")), run_length(start)
    lag = min([seen.lag, *(max(t.size // SHARES, 1) for t in start.traces(length))])
    outcome = by_simulation(replace(start, free=fitted), length, [{}], near=True, lag=lag,
                            own=len(fitted) < len(start.free))
    _, influence = influence_of(best)
    before = _candidate(best.task, best.solution.point.values, influence.copy(), None, best, line)
    places, blocks = [start.free.index(n) for n in fitted], np.full(len(start.free), np.inf)
    if (scores := scores_of(outcome)) is None:
        influence[:, places] = np.nan
    else:
        influence[:, places], blocks[places] = scores.influence, scores.blocks
    values = np.array([outcome.drive.values[n] for n in start.free])
    task = start.at(dict(zip(start.free, values, strict=True)))
    found = _candidate(task, values, influence, None, outcome, line)
    # What laws have of the idle torque, the runs cannot tell from their own.
    idle = np.array([n.endswith(".idle_torque") for n in start.free[:len(line)]])
    return replace(found, own=np.where(idle, before.own, found.own), blocks=blocks[:len(line)],
                   influence=np.where(idle, before.influence, found.influence))


def _of_regression(found: Regression, task: Task, laws: tuple[Law, ...], line: np.ndarray) -> Candidate:
    at = with_laws(task, laws).at(dict(zip(found.names, found.values, strict=True)))
    return _candidate(at, found.values, found.influence, None, None, line)


def _candidate(task: Task, values: np.ndarray, influence: np.ndarray, covariance: np.ndarray | None,
               outcome: Outcome | None, line: np.ndarray) -> Candidate:
    k = len(line)
    to = line[:, :len(values)]  # without laws it is one to one
    return Candidate(task, to @ values, influence @ to.T, None if covariance is None else to @ covariance @ to.T,
                     outcome, values[k:], influence[:, k:], to, np.full(k, np.inf))
