"""Which candidate fit of a record the default fit reports, and how uncertain the drive's parameters then are.

Laws that predict held-out data are removed first, the residual is modelled as noise, and free runs choose. Where
credible candidates differ by more than their noise, that is structural error: it is stated as its own part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.finding import Finding
from drivetool.identify.estimate import Z95, Z95_ONE_SIDED, Covariance, FoundLaw, Parameter
from drivetool.identify.fit import with_coloured_noise
from drivetool.identify.laws.candidates import (
    OTHER_SHARE,
    Candidate,
    CandidateSet,
    candidates_of,
    why_single_candidate,
)
from drivetool.identify.laws.held_out import held_out_errors
from drivetool.identify.laws.influence import FEW_BLOCKS_FACTOR, sandwich_covariance, with_standard_deviations
from drivetool.identify.laws.laws import (
    MEASUREMENT_NOISE,
    MIN_REPORTED_SHARE,
    model_error,
    places_of,
    significant_laws,
)
from drivetool.identify.laws.projected_parameters import projected_within_bounds
from drivetool.identify.motion import NOISE_SHARE
from drivetool.identify.noise import Fit, filtered, fit_ratio, minus_log_likelihood
from drivetool.identify.problem import solve
from drivetool.identify.setup import Options, Outcome, Task, first_point, has_gap, run_length
from drivetool.quantity import quantity_of

# From the most efficient estimator, where its noise model is right, to the most robust.
PREFERENCE_ORDER = ("coloured, laws", "white, laws", "regression, laws")
COMPARED_CANDIDATES = (*PREFERENCE_ORDER, "free runs, laws", OTHER_SHARE)
WITHOUT_LAWS = ("coloured", "white", "regression")
MEASURED_TORQUE_CANDIDATES = ("regression, laws", "regression")  # not biased by noise of the logged torque
# Free-run error over the least, up to which the more efficient fit is taken. A choice: more hides wrong noise.
MAX_PREFERRED_ERROR_RATIO = 1.2
# The same over the fit to free runs, above which that is taken. A choice: it has the least error by construction.
MAX_FREE_RUN_ERROR_RATIO = 1.5
# Over the least one, up to which a candidate's disagreement counts as structural. A choice: beyond, it is wrong.
MAX_CREDIBLE_ERROR_RATIO = 2.0
# Of the error of straight lines, from which the torque explains nothing: 0.9 for another axis, 0.7 with load steps.
NO_EXPLANATION_RATIO = 0.85
# The same for held-out parts. Of 23 simulated joints whose neighbour moves all but one have 0.59 and more. Drives
# that lack a law have 0.4 and less, under load steps that exceed the motor's torque up to 0.6.
NO_EXPLANATION_RATIO_HELD_OUT = 0.55
# Of the error of straight lines, a choice: up to it the torque explains the record and no part is held out.
CLEAR_EXPLANATION_RATIO = 0.1
# Fit [%] of a free run over the whole record, beyond a straight line, from which the torque explains the motion. A
# choice: a straight line, which a constant torque gives by itself, fits 0 %.
MIN_EXPLAINED_FIT = 50.0
# Effective blocks whose scatter estimates an error: the t quantile of 95 % is 4.3 for three, and 12.7 for two.
MIN_EFFECTIVE_BLOCKS = 3.0
# Half-widths that a disagreement adds: two wrong fits share part of their error, so it is doubled.
DISAGREEMENT_FACTOR = 2.0
# Parameters of several bodies that are identifiable from free runs with a constant torque each.
FREE_RUN_IDENTIFIABLE = ("inertia", "carried_mass", "stiffness", "damping", "half_gap")
RESIDUAL_SENTENCES = {"coloured": "the residual is modelled as coloured torque noise",
        "white": "the residual is modelled as white torque noise",
        "regression": "the residual is not modelled: least squares of the torque over the motion",
        "free runs": "the drive is fitted to free runs"}
WRONG_MODEL = "The drive model does not describe this machine, or torque and motion belong to different axes."
# std_structure over std_noise: 17 % of 24 right models exceed it, 44 % of 18 without their law; at one 75 and 78 %.
MAX_STRUCTURE_TO_NOISE = 3.0
# Log likelihood by which coloured noise must be likelier to count as a missing law. By chance the two further noise
# parameters gain as much once in 20000 (chi-square of two).
MIN_COLOURED_NOISE_GAIN = 10.0


@dataclass(frozen=True)
class Explanation:
    """The candidate chosen.

    sentence       which, and why
    outcome        its fit, with its laws
    own            the drive without laws, at its own parameters
    std_noise      (k,) standard deviations by noise; std_structure: (k,) by the disagreement of the candidates
    covariance     (k, k) of both together
    line           (k, n) from all that the outcome fits to the drive's own parameters
    laws           that were found
    figures        fit of free runs to the speed [%]: of the drive alone, and with the laws
    findings       what follows for the drive
    worthless      whether the logged torque does not explain the motion
    lacks          whether the drive lacks a law that the findings name
    asked          (k,) whether a parameter was compared with other candidates; None: all were
    """

    sentence: str
    outcome: Outcome
    own: Task
    std_noise: np.ndarray
    std_structure: np.ndarray
    covariance: np.ndarray
    line: np.ndarray
    laws: tuple[FoundLaw, ...]
    figures: Mapping[str, float]
    findings: tuple[Finding, ...]
    torque_explains_nothing: bool
    lacks_law: bool
    asked: np.ndarray | None = None


@dataclass(frozen=True)
class DefaultFit:
    """Result of the default fit.

    explanation  None: the record has one candidate only, and alone says why
    rivals       the likeliest fit without laws, the one with white noise, and the likeliest with laws
    """

    explanation: Explanation | None
    rivals: tuple[Outcome, Outcome, Outcome]
    alone: str = ""

    @property
    def outcome(self) -> Outcome:
        """The fit that is reported."""
        return self.explanation.outcome if self.explanation else self.rivals[0]


def default_fit(white: Outcome, options: Options, one_sided_gap: bool = False) -> DefaultFit:
    """The candidate chosen for a record, or the innovations fit where there is no other.

    white      the fit without laws, by innovations with white torque noise; one by simulation stays as it is
    options    hold, criterion: other candidates are fitted by default only
    one_sided_gap  whether the half gap has a lower bound only
    """
    is_default = options.criterion == "auto"
    why_single = ("the half gap has only a lower bound, as the gap was not crossed" if one_sided_gap else
                  why_single_candidate(white))
    if is_default and not why_single:
        field = candidates_of(white, options.hold)
        if explanation := choose_explanation(field):
            return DefaultFit(explanation, field.rivals)
        why_single = "no other candidate model can be simulated"
    plain = with_coloured_noise(white)
    return DefaultFit(None, (plain, white, plain),
                      f"Fitted by innovations alone: {why_single}." if is_default else "")


def choose_explanation(field: CandidateSet) -> Explanation | None:
    """Choose among the candidates; None where none of them can be simulated."""
    task = field.task
    measured = any(e.torque_is == "measurement" for e in task.experiments) and "regression" in field.candidates
    # Without laws a candidate has two names.
    known = {id(c): _free_run_error(field, c) for c in {id(c): c for c in field.candidates.values()}.values()}
    errors = {name: known[id(c)] for name, c in field.candidates.items()}
    if not np.isfinite([errors[n] for n in (MEASURED_TORQUE_CANDIDATES if measured else PREFERENCE_ORDER)
                        if n in errors]).any():
        return None
    gap = has_gap(task)
    # Across a gap free runs have confirmed the laws before. They are a comparison and choose no noise model.
    name = "coloured, laws" if gap else choose_candidate(errors, measured)
    if not np.isfinite(errors[name]):
        return None
    c = field.candidates[name]
    noise, structure, covariance = parameter_uncertainty(field, errors, name, task.free, measured)
    outcome = (c.outcome if c.outcome is not None and c.outcome.fit is not None
               else _innovations_outcome_at(c, field))
    own = task.at(dict(zip(task.free, projected_within_bounds(task, c.own, field.seen), strict=True)))
    laws = _found_laws(field, c) if name.endswith("laws") else ()
    # With a measured torque no innovations fit is a candidate, however likely.
    likelier = not measured and (_minus_log_likelihood_of(field, name)
                                 - _minus_log_likelihood_of(field, "coloured, laws") > MIN_COLOURED_NOISE_GAIN)
    findings, lacks_law = _missing_law_findings(field.candidates[name], likelier, laws, noise, structure, task)
    figures = {"speed_fit_percent": field.judge.fit_percent(own)}
    if laws:
        figures["speed_fit_percent_with_laws"] = field.judge.fit_percent(c.task)
    straight = field.judge.straight_line_error(task)
    # The fit to free runs shows best what the torque explains; across a gap the other may be far off.
    error, why_nothing = min(errors[name], errors["free runs, laws"]) if gap else errors[name], ""
    if error > NO_EXPLANATION_RATIO * straight > 0.0:
        why_nothing = ("The logged torque explains nothing of the motion in any fit: the errors of short free runs "
                       "are as large as those of a constant acceleration.")
    elif errors[name] > CLEAR_EXPLANATION_RATIO * straight and len(task.drive.bodies) == 1:  # calibrated for one
        held_out, line = held_out_errors(field)
        if held_out > NO_EXPLANATION_RATIO_HELD_OUT * line > 0.0:
            error, straight = held_out, line
            why_nothing = ("The logged torque does not explain the held-out parts of the record: the error of free "
                           f"runs there is {error / straight:.2f} times that of a constant acceleration.")
        elif _inertia_at_lower_bound(own):
            why_nothing = "The estimated inertia is at its lower bound, and the fit is poor."
    if why_nothing and _fit_beyond_line(field, figures["speed_fit_percent"]) >= MIN_EXPLAINED_FIT:
        why_nothing = ""
    if why_nothing:
        findings = (*findings, _explains_nothing_finding(why_nothing, error, straight))
    sentence = _choice_sentence(field, errors, name, laws, measured)
    return Explanation(sentence, outcome, own, noise, structure, covariance, c.line, laws, figures, findings,
                       bool(why_nothing), lacks_law, _has_comparison(field, errors, task.free, measured))


def _free_run_error(field: CandidateSet, c: Candidate) -> float:
    """Error of its free runs; infinite for a candidate whose sensitivities diverge."""
    error = field.judge.error(c.task) if np.isfinite(c.influence).all() and np.isfinite(c.own).all() else np.inf
    return float(error) if np.isfinite(error) else np.inf


def _fit_beyond_line(field: CandidateSet, fit: float) -> float:
    """Fit [%] of a free run of the whole record beyond a straight line; fit: beyond a constant, without laws."""
    task = field.task
    line = field.judge.straight_line_error(task, max(t.size * t.step for t in task.traces()))
    spread = float(np.nanstd(field.seen[task.drive.bodies[0]].all("speed")))
    return 100.0 - (100.0 - fit) * spread / line if line > 0.0 else 0.0


def _explains_nothing_finding(why: str, error: float, straight: float) -> Finding:
    return Finding(
        "failure", "explains-nothing", f"{why} {WRONG_MODEL}",
        {"error": error, "error of straight lines": straight},
        "Check the channels, units and signs; run drivetool inspect; try another --drive.")


def _inertia_at_lower_bound(own: Task) -> bool:
    """Whether an inertia is at its lower bound."""
    names = [n for n in own.free if quantity_of(n) in ("inertia", "carried_mass")]
    return any(own.drive.values[n] <= own.drive.quantity(n).bounds[0] for n in names)


def choose_candidate(errors: Mapping[str, float], measured: bool = False) -> str:
    """The candidate to report.

    errors    of the free runs of each
    measured  whether the logged torque is a measurement, whose noise does not act on the drive
    """
    pool = [n for n in (MEASURED_TORQUE_CANDIDATES if measured else (*PREFERENCE_ORDER, *WITHOUT_LAWS))
            if n in errors]
    least = min(errors[n] for n in pool)
    name = next((n for n in (pool if measured else PREFERENCE_ORDER) if n in errors and errors[
        n] <= MAX_PREFERRED_ERROR_RATIO * least),
                None)
    name = name or min(pool, key=errors.__getitem__)
    return name if errors[name] <= MAX_FREE_RUN_ERROR_RATIO * errors["free runs, laws"] else "free runs, laws"


def parameter_uncertainty(field: CandidateSet, errors: Mapping[str, float], name: str, free: Sequence[str],
           measured: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(std by noise (k,), std by structure (k,), covariance of both (k, k)) of the drive's own parameters."""
    c = field.candidates[name]
    by_blocks = sandwich_covariance(c.influence)
    base = by_blocks if c.covariance is None else c.covariance
    noise = np.sqrt(np.maximum(np.diag(by_blocks), np.diag(base)))
    compared = ("regression, laws", "free runs, laws") if measured else COMPARED_CANDIDATES
    compared = ("free runs, laws", OTHER_SHARE) if has_gap(field.task) else compared
    disagreements, is_inertia = [], np.array([quantity_of(n) == "inertia" for n in free])
    for other in compared:
        if other in field.candidates and other != name and _credible(errors, other, measured):
            d = field.candidates[other]
            difference = np.where(_comparable_parameters(field, other, free), c.own - d.own, 0.0)
            noise_part = np.sqrt(np.diag(sandwich_covariance(c.influence - d.influence))) / FEW_BLOCKS_FACTOR
            if "regression, laws" in (name, other):
                # Sensor noise biases a regression downwards: the inertia, as its cut-off allows.
                noise_part = noise_part + NOISE_SHARE * is_inertia * np.abs(c.own)
            disagreements.append(np.sign(difference) * np.maximum(np.abs(difference) - noise_part, 0.0))
    rows = np.array(disagreements).reshape(-1, len(c.own))
    structure = DISAGREEMENT_FACTOR / Z95 * (np.abs(rows).max(axis=0) if len(rows) else np.zeros(len(c.own)))
    return noise, structure, with_standard_deviations(base, noise) + with_standard_deviations(rows.T @ rows,
                                                                                              structure)


def _credible(errors: Mapping[str, float], name: str, measured: bool) -> bool:
    """Whether the free-run error of a candidate is small enough."""
    # The fit to free runs has the least error by construction, and so sets no bound for the others.
    least = min(errors[n] for n in (MEASURED_TORQUE_CANDIDATES if measured else (*PREFERENCE_ORDER, *WITHOUT_LAWS))
                if n in errors)
    return errors[name] <= MAX_CREDIBLE_ERROR_RATIO * least


def _has_comparison(field: CandidateSet, errors: Mapping[str, float], free: Sequence[str],
                    measured: bool) -> np.ndarray:
    """(k,) whether a parameter was compared with another candidate; without a gap it always is."""
    if not has_gap(field.task):
        return np.ones(len(free), bool)
    return _comparable_parameters(field, "free runs, laws", free) & _credible(errors, "free runs, laws", measured)


def _comparable_parameters(field: CandidateSet, other: str, free: Sequence[str]) -> np.ndarray:
    """(k,) whether a candidate identifies a parameter well enough to be compared.

    The friction of several bodies is hardly identifiable from free runs with a constant torque each. What is
    identified from a few moments alone, as a mass from one torque step, has an error that no scatter shows.
    """
    identified = field.candidates[other].blocks >= MIN_EFFECTIVE_BLOCKS
    if other != "free runs, laws" or len(field.task.drive.bodies) == 1:
        return identified
    return identified & np.array([quantity_of(n) in FREE_RUN_IDENTIFIABLE for n in free])


def _innovations_outcome_at(c: Candidate, field: CandidateSet) -> Outcome:
    """A candidate without a noise model, as an innovations fit at the same values."""
    task, problem = c.task, c.task.problem()
    starts = field.candidates["white"].outcome.solution.point.starts
    point = replace(first_point(task.drive, problem, task.roles), starts=starts)
    noise = fit_ratio(problem, point, field.judge.noise)
    gains = [f.gains for f in filtered(problem, point, noise)]
    solution = solve(problem, point, gains, max_iterations=0)
    passes = tuple(filtered(problem, solution.point, noise, keep=False))
    fit = Fit(solution, noise, minus_log_likelihood(passes), passes, 0, 0.0, True)
    return Outcome.of_fit(task, problem, fit)


def _found_laws(field: CandidateSet, c: Candidate) -> tuple[FoundLaw, ...]:
    """The laws with their factors and the standard deviations from the blocks."""
    std = np.sqrt(np.diag(sandwich_covariance(c.factor_influence)))
    return tuple(FoundLaw.of(law.name, c.factors[own], std[own])
                 for law, own in zip(field.laws, places_of(field.laws), strict=True))


def _choice_sentence(field: CandidateSet, errors: Mapping[str, float], name: str, laws: Sequence[FoundLaw],
                     measured: bool) -> str:
    kind = name.partition(",")[0]
    if kind == "coloured" and field.candidates[name].outcome.fit.noise.memory is None:
        kind = "white"
    residual = RESIDUAL_SENTENCES[kind]
    removed = (f"{len(laws)} effect{'s' if len(laws) > 1 else ''} estimated and subtracted after a test on "
               "held-out data; " if laws else "")
    if measured:
        why = "the logged torque is a measurement, whose noise did not act on the drive"
    elif has_gap(field.task):
        length = f"{run_length(field.task, field.judge.length):.2g} s"
        why = (f"this fit is the most accurate with backlash, and is compared with the fit to free runs of {length}"
               if _credible(errors, "free runs, laws", measured) else
               f"no other fit is credible, as the error of the fit to free runs of {length} is too large")
    elif kind == "free runs":
        why = f"the free-run error of the next best candidate is over {MAX_FREE_RUN_ERROR_RATIO:g} times as large"
    else:
        least = min(e for n, e in errors.items() if n != "free runs, laws")
        error_ratio = errors[name] / least if least > 0.0 else 1.0
        why = (f"its error in free runs of {field.judge.length:.2g} s is {error_ratio:.2f} times the smallest of "
               "all candidates")
    text = f"{removed}{residual}; {why}."
    return text[0].upper() + text[1:]


def _missing_law_findings(c: Candidate, likelier: bool, laws: Sequence[FoundLaw], noise: np.ndarray,
                          structure: np.ndarray, task: Task) -> tuple[tuple[Finding, ...], bool]:
    """(findings, whether the model lacks a law), with the best guess.

    likelier  whether coloured noise is likelier than the candidate that was chosen
    """
    significant = significant_laws(laws, task.experiments)
    torque_noise = _torque_noise_finding(laws, task) if significant.pop(MEASUREMENT_NOISE, 0.0) else ()
    values = np.abs(c.own)
    disagree = np.any(structure > np.maximum(MAX_STRUCTURE_TO_NOISE * noise, MIN_REPORTED_SHARE * values))
    lacks_law = bool(significant or likelier or disagree)
    return (*torque_noise, *([model_error(significant)] if lacks_law else [])), lacks_law


def _torque_noise_finding(laws: Sequence[FoundLaw], task: Task) -> tuple[Finding, ...]:
    """The finding on noise that is in the log of the torque only."""
    law = next(law for law in laws if law.name == MEASUREMENT_NOISE)
    return (Finding(
        "note", "torque-measurement-noise",
        f"The logged torque has {abs(law.factors[0]):.2g} {task.experiments[0].torque_unit} rms of measurement "
        "noise, which does not act on the drive. The fit removes it.", {"rms": law.factors[0], "std": law.std[0]},
        "State torque_is: measurement in the channel map; log the torque command if the drive offers it."),)


def _minus_log_likelihood_of(field: CandidateSet, name: str) -> float:
    outcome = field.candidates[name].outcome
    return np.inf if outcome is None or outcome.fit is None else outcome.fit.value


def with_total_uncertainty(lines: Sequence[Parameter], e: Explanation,
         extra: np.ndarray | None = None) -> tuple[tuple[Parameter, ...], Covariance | None]:
    """The parameters of the drive without laws, with their own values and both parts of their uncertainty.

    extra  (n, n) covariance of the outcome's values from held values and from the uncertainty of the noise
    """
    if extra is not None:
        more = e.line @ extra @ e.line.T
        e = replace(e, std_noise=np.sqrt(e.std_noise**2 + np.diag(more)), covariance=e.covariance + more)
    own, found = dict(zip(e.own.free, range(len(e.own.free)), strict=True)), []
    for p in lines:
        if p.name not in own:
            if p.name not in e.outcome.task.drive.known_torques:
                found.append(p)
            continue
        j = own[p.name]
        value, std = float(e.own.drive.values[p.name]), float(np.sqrt(e.covariance[j, j]))
        bounds, p = e.own.drive.quantity(p.name).bounds, p.replace(value=value)
        if p.status in ("fitted", "at-bound") and value not in bounds:
            p = p.replace(status="fitted", reason="").with_interval(
                std, bounds, std_noise=float(e.std_noise[j]),
                std_structure=float(e.std_structure[j]) if e.asked is None or e.asked[j] else None)
        elif p.status == "fitted":
            p = p.at_bound(Z95_ONE_SIDED * std, bounds)
        found.append(p)
    kept = [p.name for p in found if p.name in own and p.std is not None]
    return tuple(found), Covariance(e.own.free, e.covariance).part(kept)
