"""The candidate fits of a record between which the default fit chooses.

Laws that predict held-out data are removed first. The residual is modelled as white noise, as coloured noise, or
not at all (regression, free runs). Each is fitted with the laws and without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.identify.fit import by_innovations, by_simulation, refit, with_coloured_noise
from drivetool.identify.identifiability import only_ratios
from drivetool.identify.laws.across_gap import laws_reduce_free_run_error, optimum_confirmed, restart_from_free_runs
from drivetool.identify.laws.fit_with_laws import fit_with_selected_laws, likelier_of_regression_start, near
from drivetool.identify.laws.free_run_test import MIN_MEANS_PER_RUN, FreeRunTest
from drivetool.identify.laws.influence import influence_of, scores_of
from drivetool.identify.laws.law_selection import with_laws
from drivetool.identify.laws.laws import Law, law_library, measurement_noise_law, places_of
from drivetool.identify.laws.projected_parameters import projection_of_laws
from drivetool.identify.laws.regression import Regression, is_regressable, regress
from drivetool.identify.laws.transmission import NAME as TRANSMISSION_LAW, transmission_law
from drivetool.identify.motion import Motions, motions_of, motions_through
from drivetool.identify.noise import expected_recording_noise, filtered
from drivetool.identify.setup import Outcome, Task, has_gap, reverses, run_length
from drivetool.logs import true_runs
from drivetool.quantity import name_of, quantity_of

OTHER_SHARE = "other shares of a transmission's loss, laws"  # the candidate
MIN_MEASURED_RUN = 200  # measured values in a row: sixteen blocks of a dozen


@dataclass(frozen=True)
class Candidate:
    """One candidate fit.

    task        with its laws, at the fitted values
    own         (k,) values of the drive's free parameters, friction as the line nearest to the whole curve
    influence   (BLOCKS, k) each block's share of their error
    covariance  (k, k) by the information matrix; None: the fit has none
    outcome     of the fit; None of a regression
    factors     (m,) of its laws; factor_influence: (BLOCKS, m) the blocks' shares of their error
    line        (k, k + m) from all fitted values to the drive's own
    blocks      (k,) effective number of blocks that identify each value; infinite where it is not computed
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
class CandidateSet:
    """All candidates of a record by name.

    laws  that were found; judge: free-run test of the candidates; seen: the motion of each body
    task  of the drive without laws; a parameter that a law is equal to is free
    """

    candidates: Mapping[str, Candidate]
    laws: tuple[Law, ...]
    judge: FreeRunTest
    seen: Mapping[str, Motions]
    task: Task

    @property
    def rivals(self) -> tuple[Outcome, Outcome, Outcome]:
        """The likeliest fit without laws, the one with white noise, and the likeliest with laws: see left_out."""
        found = [outcome for name in ("coloured", "white", "coloured, laws", "white, laws")
                 if (outcome := self.candidates[name].outcome) is not None]
        return found[0], found[1], min(found[2:], key=lambda outcome: outcome.fit.value)


def why_single_candidate(white: Outcome) -> str:
    """Why a record has one candidate only, the innovations fit; empty where several are fitted."""
    task = white.task
    if white.fit is None or not ("motor.inertia" in task.free or has_gap(task)):
        return "the inertia is held"
    if not _has_measured_run(task, task.roles.outputs[0]):
        return f"no {MIN_MEASURED_RUN} values of the sensor were measured in a row"
    # If the torque varies and still identifies ratios alone, it may be of another axis, which free runs show.
    if only_ratios(white) and not any(np.ptp(e.signals["motor_torque"][a:b]) for e in task.experiments
                                      for a, b in e.segments):
        return "no torque of known size acts"
    return ""


def _has_measured_run(task: Task, role: str) -> bool:
    """Whether enough values of a sensor in a row were measured in some recording."""
    runs = [true_runs(np.isfinite(e.signals[role])) for e in task.experiments]
    return any(np.diff(run).max(initial=0) >= MIN_MEASURED_RUN for run in runs)


def candidates_of(white: Outcome, held: Sequence[str] = ()) -> CandidateSet:
    """Fit them all.

    white  the fit without laws, by innovations with white torque noise
    held   names of parameters that may not be freed
    """
    task = white.task
    seen, linear = motions_of(task.experiments, task.roles.outputs[0]), is_regressable(task)
    plain = regress(task, seen) if linear else None
    white = likelier_of_regression_start(white, plain) if plain else white
    found = {"white": white, "coloured": with_coloured_noise(white)}
    while True:
        motions = motions_of_bodies(found["coloured"], seen)
        every = [law for law in (*laws_of(task, motions), *transmission_law(found["coloured"], motions))
                 if law.parameter not in (*held, *task.free)]
        laws, best = fit_with_selected_laws(found["coloured"], every, seen, linear)
        if turned := _turned_laws(laws, best):  # further laws have turned their sign: they make up for others
            laws, best = fit_with_selected_laws(found["coloured"], [law for law in every if law not in turned],
                                                seen, linear)
        freed = [law.parameter for law in laws if law.parameter]
        if not freed:
            laws, best, rival = with_transmitted_torque(task, laws, best, seen)
            break
        white = refit_with_freed(white, freed)
        task, found = white.task, {"white": white, "coloured": with_coloured_noise(white)}
    smoothings = {e.step: m.smoothing for e, m in zip(task.experiments, seen.each, strict=True)}
    free_run_test = FreeRunTest(smoothings, white.fit.noise).with_bent_runs(task, seen)
    if laws and has_gap(task) and not laws_reduce_free_run_error(free_run_test, found["coloured"], best):
        laws, best = (), found["coloured"]
    with_them = regress(task, seen, laws) if linear and laws else plain
    if laws and best.fit.noise.memory is None:
        found |= {"white, laws": best, "coloured, laws": with_coloured_noise(best)}
    elif laws:
        start = near(best.fitted, white)
        found |= {"white, laws": likelier_of_regression_start(start, with_them) if with_them else start,
                  "coloured, laws": best}
    line = projection_of_laws(task, laws, motions)
    found |= {OTHER_SHARE: rival} if rival and laws else {}
    candidates = {name: _candidate_of_fit(outcome, line) for name, outcome in found.items()}
    if plain and with_them:
        candidates["regression"] = _candidate_of_regression(plain, task, (), line)
        if laws:
            candidates["regression, laws"] = _candidate_of_regression(with_them, task, laws, line)
    if not laws:
        candidates |= {f"{name}, laws": c for name, c in candidates.items()}
    candidates["free runs, laws"] = _candidate_of_free_runs(best, seen, line, free_run_test.length)
    if has_gap(task):
        likeliest = min(("coloured, laws", "white, laws"), key=lambda n: candidates[n].outcome.fit.value)
        other = restart_from_free_runs(candidates[likeliest].outcome, candidates["free runs, laws"].task)
        candidates["coloured, laws"] = _candidate_of_fit(other, line)
    return CandidateSet(candidates, laws, free_run_test, motions, task)


def refit_with_freed(white: Outcome, names: Sequence[str]) -> Outcome:
    """The fit with further parameters free, by a new search: without them it may be in a local optimum.

    Across a gap it starts from the fit before: an optimum that its search has confirmed is not searched again.
    """
    task = white.fitted
    guess = {n: task.drive.values.get(name_of(task.drive.bodies[0], quantity_of(n)), 0.0) for n in names}
    wider = task.at(guess).with_free({*task.free, *names})
    if has_gap(task):
        found = refit(wider, white.fit.noise)
        return found if optimum_confirmed(white) else replace(found, starts=())
    return by_innovations(wider, [{}])


def motions_of_bodies(outcome: Outcome, seen: Motions) -> dict[str, Motions]:
    """The motion of each body, by its own sensor or by the states of a fit; seen: that of the motor."""
    task, found = outcome.task, {outcome.task.drive.bodies[0]: seen}
    measured = {}
    for role in task.roles.outputs[1:]:
        owner, _, kind = role.rpartition("_")
        if kind in ("speed", "angle") and _has_measured_run(task, role):
            measured[task.drive.load if owner == "load" else owner] = role
    passes = None
    for index, body in enumerate(task.drive.bodies[1:], 1):
        if body in measured:
            found[body] = motions_of(task.experiments, measured[body])
            continue
        passes = passes or filtered(outcome.problem, outcome.solution.point, outcome.fit.noise)
        found[body] = motions_through(task.experiments, [f.states[:, index] for f in passes], seen)
    return found


def laws_of(task: Task, motions: Mapping[str, Motions]) -> list[Law]:
    """Every law on every body over its motion.

    Where the sign of the speed is noise, a law of it feeds the sensor's noise back. A body that sticks does not
    notice; one with bristles moves, and such a law seems to predict its sensor.
    """
    found = list(measurement_noise_law(expected_recording_noise(task.experiments, "motor_torque")))
    for body, seen in motions.items():
        name_suffix = f", on the {body}" if len(motions) > 1 else ""
        if name_of(body, "bristle_stiffness") in task.drive.values:
            seen = replace(seen, each=tuple(replace(m, side=m.side * ~m.slow) for m in seen.each))
        found += law_library(seen, task.drive.motion_unit == "rad", body, name_suffix)
    return found


def _turned_laws(laws: Sequence[Law], best: Outcome) -> list[Law]:
    """Losses whose fitted factor is negative, as none is."""
    first = len(best.task.free) - sum(law.size for law in laws)
    return [law for law, place in zip(laws, places_of(laws, first), strict=True)
            if law.name.startswith(TRANSMISSION_LAW) and not best.solution.point.values[place.start] > 0.0]


def with_transmitted_torque(task: Task, laws: tuple[Law, ...], best: Outcome,
                            seen: Motions) -> tuple[tuple[Law, ...], Outcome, Outcome | None]:
    """(laws, fit, rival) with the torque transmitted of the fit with the laws, if one of them depends on it.

    The torque of the fit without them, in which they were found, has its errors. The rival has other shares: no
    record tells them from those of one efficiency.
    """
    if not any(law.name.startswith(TRANSMISSION_LAW) for law in laws):
        return laws, best, None
    motions, values = motions_of_bodies(best, seen), best.solution.point.values
    plain, factors = task.at(dict(zip(task.free, values, strict=False))), values[len(task.free):]
    fits = []
    for one_efficiency in (False, True):
        again = {law.name: law for law in transmission_law(best, motions, one_efficiency)}
        laws = tuple(again.get(law.name, law) for law in laws)
        fits.append(near(with_laws(plain, laws, factors), best))
    return laws, fits[1], fits[0]


def _candidate_of_fit(outcome: Outcome, line: np.ndarray) -> Candidate:
    covariance, influence = influence_of(outcome)
    return _projected_candidate(outcome.fitted, outcome.solution.point.values,
                                influence, covariance, outcome, line)


def _candidate_of_free_runs(best: Outcome, seen: Motions, line: np.ndarray, length: float) -> Candidate:
    """The fit to free runs, each with an idle torque of its own; the drive's idle torque keeps its value."""
    start, length = best.fitted, run_length(best.fitted, length)
    constant = {"idle_torque"} if reverses(start.experiments) else {"idle_torque", "coulomb"}
    fitted = tuple(n for n in start.free if quantity_of(n) not in constant)
    lag = min([seen.lag, *(max(t.size // MIN_MEANS_PER_RUN, 1) for t in start.traces(length))])
    outcome = by_simulation(replace(start, free=fitted), length, [{}], near_optimum=True, lag=lag,
                            constant_torques=len(fitted) < len(start.free))
    _, influence = influence_of(best)
    best_candidate = _projected_candidate(best.task, best.solution.point.values, influence.copy(), None, best, line)
    places, blocks = [start.free.index(n) for n in fitted], np.full(len(start.free), np.inf)
    if (scores := scores_of(outcome)) is None:
        influence[:, places] = np.nan
    else:
        influence[:, places], blocks[places] = scores.influence, scores.blocks
    values = np.array([outcome.drive.values[n] for n in start.free])
    found = _projected_candidate(replace(outcome.fitted, free=start.free), values, influence, None, outcome, line)
    # The share of laws in the idle torque is collinear with the runs' own idle torques.
    idle = np.array([quantity_of(n) in constant for n in start.free[:len(line)]])
    return replace(found, own=np.where(idle, best_candidate.own, found.own), blocks=blocks[:len(line)],
                   influence=np.where(idle, best_candidate.influence, found.influence))


def _candidate_of_regression(found: Regression, task: Task, laws: tuple[Law, ...], line: np.ndarray) -> Candidate:
    at = with_laws(task, laws).at(dict(zip(found.names, found.values, strict=True)))
    return _projected_candidate(at, found.values, found.influence, None, None, line)


def _projected_candidate(task: Task, values: np.ndarray, influence: np.ndarray, covariance: np.ndarray | None,
                         outcome: Outcome | None, line: np.ndarray) -> Candidate:
    k = len(line)
    projection = line[:, :len(values)]  # without laws it is one to one
    return Candidate(task, projection @ values, influence @ projection.T,
                     None if covariance is None else projection @ covariance @ projection.T,
                     outcome, values[k:], influence[:, k:], projection, np.full(k, np.inf))
