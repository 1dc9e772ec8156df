"""Which explanation of a record the default fit reports, and how uncertain that leaves the drive.

What the motion foretells is taken out first, what is left is taken as noise, and free runs choose. Where credible
explanations disagree by more than their noise, that is the model's error: it is stated as its own part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.errors import Finding
from drivetool.identify.estimate import ONE_SIDED, Z95, Covariance, FoundLaw, Parameter, why_on_bound
from drivetool.identify.fit import coloured
from drivetool.identify.laws.candidates import Candidate, Field, candidates_of, why_alone
from drivetool.identify.laws.held_out import held_out_errors
from drivetool.identify.laws.influence import SLACK, sandwich, sized
from drivetool.identify.laws.judge import run_length
from drivetool.identify.laws.laws import UNFELT, WEIGHTY, model_error, weighty
from drivetool.identify.laws.own_parameters import within_bounds
from drivetool.identify.motion import NOISE_SHARE
from drivetool.identify.noise import Fit, filtered, fit_ratio, minus_log_likelihood
from drivetool.identify.problem import solve
from drivetool.identify.setup import Options, Outcome, Task, first_point, has_gap

# From the most efficient where it is right to the most robust.
PREFERRED = ("coloured, laws", "white, laws", "regression, laws")
REFEREES = (*PREFERRED, "free runs, laws")
WITHOUT = ("coloured", "white", "regression")
MEASURED = ("regression, laws", "regression")  # what noise of the logged torque leaves right
KEPT = 1.2  # over the least error of free runs, up to which the more efficient fit is kept
REFUTED = 1.5  # over that of the fit to free runs, from which that one is taken
CREDIBLE = 2.0  # over the least error of free runs, up to which a fit may disagree
# Of the error of straight lines, from which the logged torque explains nothing. On simulated records it is 0.9 and
# more for most torques of another axis, and up to 0.7 for those of a drive under load steps, the worst of all laws.
NOTHING = 0.85
# The same of parts held out. Of 23 simulated joints whose neighbour moves all but one have 0.59 and more; of
# drives that lack a law 0.4 and less, under load steps that exceed the motor's torque up to 0.6.
NOTHING_HELD_OUT = 0.55
PLAINLY = 0.1  # of the error of straight lines, up to which the torque explains the record and no part is held out
# Effective blocks that must tell a parameter: their scatter says what its error is, and of fewer says nothing. The
# t quantile of 95 % is 4.3 for three blocks, and 12.7 for two.
FEWEST_BLOCKS = 3.0
DOUBLED = 2.0  # half-widths that a disagreement adds: half of it is seen, at best
# What free runs with torques of their own tell of several bodies.
WITNESSED = (".inertia", ".carried_mass", ".stiffness", ".damping", ".half_gap")
LEFT = {"coloured": "what is left is taken as torque noise with a memory",
        "white": "what is left is taken as white torque noise",
        "regression": "the rest is not modelled: least squares of the torque over the motion",
        "free runs": "the drive is fitted to free runs of a second"}
# Structure over noise: of right models 17 % have more in some parameter (of 24), of those that lack a law not found
# 44 % (of 18); at one the shares are 75 and 78 %.
DOUBTED = 3.0
LIKELIER = 10.0  # log likelihood


@dataclass(frozen=True)
class Explanation:
    """The explanation chosen.

    sentence       which, and why
    outcome        its fit, with its laws
    own            the drive alone, at its own parameters
    std_noise      (k,) standard deviations by noise; std_structure: (k,) by what the explanations disagree in
    covariance     (k, k) of both together
    line           (k, n) from all that the outcome fits to the drive's own parameters
    laws           that were found
    figures        fit of free runs to the speed [%]: of the drive alone, and with the laws
    findings       what follows for the drive
    worthless      whether the logged torque explains nothing
    lacks          whether the drive lacks something that the findings name
    asked          (k,) whether other explanations were asked for a parameter; None: for all
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
    worthless: bool
    lacks: bool
    asked: np.ndarray | None = None


@dataclass(frozen=True)
class Explained:
    """What the default fit comes to.

    explanation  None: the record has one explanation only, and alone says why
    rivals       the likeliest fit without laws, the one with white noise, and the likeliest with laws
    """

    explanation: Explanation | None
    rivals: tuple[Outcome, Outcome, Outcome]
    alone: str = ""

    @property
    def outcome(self) -> Outcome:
        """The fit that is reported."""
        return self.explanation.outcome if self.explanation else self.rivals[0]


def explained(white: Outcome, options: Options, uncrossed: bool = False) -> Explained:
    """The explanation of a record, or the innovations fit where there is one only.

    white      the fit without laws, by innovations with white torque noise; one by simulation stays as it is
    options    hold, criterion: other explanations are tried by default only
    uncrossed  whether the half gap is known from below only
    """
    wanted = options.criterion == "auto"
    alone = "a gap that was not crossed is known from below only" if uncrossed else why_alone(white)
    if wanted and not alone:
        field = candidates_of(white, options.hold)
        if explanation := explain(field):
            return Explained(explanation, field.rivals)
        alone = "no other explanation of the record can be simulated"
    plain = coloured(white)
    return Explained(None, (plain, white, plain), f"Fitted by innovations alone: {alone}." if wanted else "")


def explain(field: Field) -> Explanation | None:
    """Choose among the candidates; None where none of them can be simulated."""
    task = field.task
    measured = any(e.torque_is == "measurement" for e in task.experiments) and "regression" in field.candidates
    # Without laws a candidate stands under two names.
    known = {id(c): _error(field, c) for c in {id(c): c for c in field.candidates.values()}.values()}
    errors = {name: known[id(c)] for name, c in field.candidates.items()}
    if not np.isfinite([errors[n] for n in (MEASURED if measured else PREFERRED) if n in errors]).any():
        return None
    gap = has_gap(task)
    # Across a gap free runs have confirmed the laws before, and are a witness, no judge between noise models.
    name = "coloured, laws" if gap else chosen(errors, measured)
    if not np.isfinite(errors[name]):
        return None
    c = field.candidates[name]
    noise, structure, covariance = spread(field, errors, name, task.free, measured)
    outcome = c.outcome if c.outcome is not None and c.outcome.fit is not None else _at(c, field)
    own = task.at(dict(zip(task.free, within_bounds(task, c.own, field.seen), strict=True)))
    laws = _found(field, c) if name.endswith("laws") else ()
    # Of a measured torque no fit by innovations is asked, however likely.
    likelier = not measured and _value(field, name) - _value(field, "coloured, laws") > LIKELIER
    findings, lacks = _findings(field.candidates[name], likelier, laws, noise, structure, task)
    figures = {"speed_fit_percent": field.judge.fit_percent(own)}
    if laws:
        figures["speed_fit_percent_with_laws"] = field.judge.fit_percent(c.task)
    straight = field.judge.straight(task)
    # The fit to free runs shows most of what the torque explains; across a gap the other may be far off.
    error = min(errors[name], errors["free runs, laws"]) if gap else errors[name]
    worthless = error > NOTHING * straight > 0.0
    if worthless:
        findings = (*findings, _nothing(error, straight))
    elif errors[name] > PLAINLY * straight and len(task.drive.bodies) == 1:  # of more it was not measured
        error, line = held_out_errors(field)
        worthless = error > NOTHING_HELD_OUT * line > 0.0
        findings = (*findings, _nothing_held_out(error, line)) if worthless else findings
        if not worthless and _no_inertia(own):
            worthless, findings = True, (*findings, _nothing_accelerates(errors[name], straight))
    sentence = _sentence(field, errors, name, laws, measured)
    return Explanation(sentence, outcome, own, noise, structure, covariance, c.line, laws, figures, findings,
                       worthless, lacks, _asked(field, errors, task.free, measured))


def _error(field: Field, c: Candidate) -> float:
    """Of its free runs; endless of a candidate whose sensitivities run away."""
    error = field.judge.error(c.task) if np.isfinite(c.influence).all() and np.isfinite(c.own).all() else np.inf
    return float(error) if np.isfinite(error) else np.inf


def _nothing(error: float, straight: float) -> Finding:
    return Finding(
        "failure", "explains-nothing",
        "The logged torque explains nothing, whatever was fitted: short free runs err as much as straight "
        "lines of the speed do. This drive is not that machine, or torque and motion are not of one axis.",
        {"error": error, "error of straight lines": straight},
        "Check the channels, units and signs; run drivetool inspect; try another --drive.")


def _nothing_held_out(error: float, straight: float) -> Finding:
    """The same of a part that was not fitted to."""
    return replace(
        _nothing(error, straight),
        text="The logged torque does not explain the parts of the record that were held out: free runs there err "
             f"{error / straight:.2f} times as much as straight lines of the speed do. This drive is not that "
             "machine, or torque and motion are not of one axis.")


def _no_inertia(own: Task) -> bool:
    """Whether an inertia is at its lower bound."""
    names = [n for n in own.free if n.endswith((".inertia", ".carried_mass"))]
    return any(own.drive.values[n] <= own.drive.quantity(n).bounds[0] for n in names)


def _nothing_accelerates(error: float, straight: float) -> Finding:
    """The same of a torque that moves no inertia."""
    return replace(
        _nothing(error, straight),
        text="The motion follows the logged torque best without any inertia, and not well. This drive is not that "
             "machine, or torque and motion are not of one axis.")


def chosen(errors: Mapping[str, float], measured: bool = False) -> str:
    """The candidate to report.

    errors    of the free runs of each
    measured  whether the logged torque is a measurement, whose noise would pass for the drive's
    """
    pool = [n for n in (MEASURED if measured else (*PREFERRED, *WITHOUT)) if n in errors]
    least = min(errors[n] for n in pool)
    name = next((n for n in (pool if measured else PREFERRED) if n in errors and errors[n] <= KEPT * least), None)
    name = name or min(pool, key=errors.__getitem__)
    return name if errors[name] <= REFUTED * errors["free runs, laws"] else "free runs, laws"


def spread(field: Field, errors: Mapping[str, float], name: str, free: Sequence[str],
           measured: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(std by noise (k,), std by structure (k,), covariance of both (k, k)) of the drive's own parameters."""
    c = field.candidates[name]
    by_blocks = sandwich(c.influence)
    base = by_blocks if c.covariance is None else c.covariance
    noise = np.sqrt(np.maximum(np.diag(by_blocks), np.diag(base)))
    compared = ("regression, laws", "free runs, laws") if measured else REFEREES
    compared = ("free runs, laws",) if has_gap(field.task) else compared
    apart = []
    for other in compared:
        if other in field.candidates and other != name and _credible(errors, other, measured):
            d = field.candidates[other]
            off = np.where(_compared(field, other, free), c.own - d.own, 0.0)
            one = np.sqrt(np.diag(sandwich(c.influence - d.influence))) / SLACK
            if "regression, laws" in (name, other):
                one = one + _attenuation(c, free)
            apart.append(np.sign(off) * np.maximum(np.abs(off) - one, 0.0))
    rows = np.array(apart).reshape(-1, len(c.own))
    structure = DOUBLED / Z95 * (np.abs(rows).max(axis=0) if len(rows) else np.zeros(len(c.own)))
    return noise, structure, sized(base, noise) + sized(rows.T @ rows, structure)


def _credible(errors: Mapping[str, float], name: str, measured: bool) -> bool:
    """Whether a candidate errs little enough to be believed."""
    # The fit to free runs has the least error by itself, and so does not say what is credible.
    least = min(errors[n] for n in (MEASURED if measured else (*PREFERRED, *WITHOUT)) if n in errors)
    return errors[name] <= CREDIBLE * least


def _asked(field: Field, errors: Mapping[str, float], free: Sequence[str], measured: bool) -> np.ndarray:
    """(k,) whether any witness was asked for a parameter; of a drive without a gap there always is one."""
    if not has_gap(field.task):
        return np.ones(len(free), bool)
    return _compared(field, "free runs, laws", free) & _credible(errors, "free runs, laws", measured)


def _compared(field: Field, other: str, free: Sequence[str]) -> np.ndarray:
    """(k,) whether a candidate is a witness of a parameter.

    Free runs with torques of their own hardly tell the friction of several bodies. What they have from a few
    moments alone, as a mass from the one step of a torque, has an error that nothing shows.
    """
    told = field.candidates[other].blocks >= FEWEST_BLOCKS
    if other != "free runs, laws" or len(field.task.drive.bodies) == 1:
        return told
    return told & np.array([n.endswith(WITNESSED) for n in free])


def _attenuation(c: Candidate, free: Sequence[str]) -> np.ndarray:
    """(k,) by how much sensor noise may lower what a regression finds: the inertia, as its cut-off allows."""
    return NOISE_SHARE * np.array([n.endswith(".inertia") for n in free]) * np.abs(c.own)


def _at(c: Candidate, field: Field) -> Outcome:
    """A candidate that has no noise model, as an innovations fit that stays where it is."""
    task, problem = c.task, c.task.problem()
    starts = field.candidates["white"].outcome.solution.point.starts
    point = replace(first_point(task.drive, problem, task.roles), starts=starts)
    noise = fit_ratio(problem, point, field.judge.noise)
    gains = [f.gains for f in filtered(problem, point, noise)]
    solution = solve(problem, point, gains, most=0)
    passes = tuple(filtered(problem, solution.point, noise, keep=False))
    fit = Fit(solution, noise, minus_log_likelihood(passes), passes, 0, 0.0, True)
    return Outcome(task, problem, solution, fit, (), True)


def _found(field: Field, c: Candidate) -> tuple[FoundLaw, ...]:
    """The laws with their factors and what the blocks say of them."""
    std = np.sqrt(np.diag(sandwich(c.factor_influence)))
    found, k = [], 0
    for law in field.laws:
        part = slice(k, k + law.size)
        found.append(FoundLaw(law.name, tuple(c.factors[part].tolist()), tuple(std[part].tolist())))
        k += law.size
    return tuple(found)


def _sentence(field: Field, errors: Mapping[str, float], name: str, laws: Sequence[FoundLaw],
              measured: bool) -> str:
    kind = name.partition(",")[0]
    if kind == "coloured" and field.candidates[name].outcome.fit.noise.memory is None:
        kind = "white"
    left = LEFT[kind]
    taken = f"{len(laws)} law{'s' if len(laws) > 1 else ''} that the motion foretells taken out, " if laws else ""
    if measured:
        why = "the logged torque is a measurement, whose noise the drive has not felt"
    elif has_gap(field.task):
        length = f"{run_length(field.task):.2g} s"
        why = (f"across a gap that is the most accurate, and the fit to free runs of {length} is the witness"
               if _credible(errors, "free runs, laws", measured) else
               f"no witness is credible beside it, that of free runs of {length} errs too much")
    elif kind == "free runs":
        why = f"the free runs of the next best explanation err more than {REFUTED:g} times as much"
    else:
        least = min(e for n, e in errors.items() if n != "free runs, laws")
        over = errors[name] / least if least > 0.0 else 1.0
        why = f"its free runs of a second err {over:.2f} times as much as the best of all explanations"
    text = f"{taken}{left}; {why}."
    return text[0].upper() + text[1:]


def _findings(c: Candidate, likelier: bool, laws: Sequence[FoundLaw], noise: np.ndarray, structure: np.ndarray,
              task: Task) -> tuple[tuple[Finding, ...], bool]:
    """(what is said, whether the model lacks something), with the best guess.

    likelier  whether coloured noise is likelier than the candidate that was chosen
    """
    heavy = weighty(laws, task.experiments)
    unfelt = _unfelt(laws, task) if heavy.pop(UNFELT, 0.0) else ()
    values = np.abs(c.own)
    doubted = np.any(structure > np.maximum(DOUBTED * noise, WEIGHTY * values))
    lacks = bool(heavy or likelier or doubted)
    return (*unfelt, *([model_error(heavy)] if lacks else [])), lacks


def _unfelt(laws: Sequence[FoundLaw], task: Task) -> tuple[Finding, ...]:
    """What is said of noise that is in the log of the torque only."""
    law = next(law for law in laws if law.name == UNFELT)
    return (Finding(
        "note", "torque-noise-unfelt",
        f"The drive does not feel {abs(law.factors[0]):.2g} {task.experiments[0].torque_unit} rms of the logged "
        "torque: that is noise of its measurement, and was taken out.", {"rms": law.factors[0], "std": law.std[0]},
        "State torque_is: measurement in the channel map; log the torque command if the drive offers it."),)


def _value(field: Field, name: str) -> float:
    outcome = field.candidates[name].outcome
    return np.inf if outcome is None or outcome.fit is None else outcome.fit.value


def told(lines: Sequence[Parameter], e: Explanation,
         extra: np.ndarray | None = None) -> tuple[tuple[Parameter, ...], Covariance | None]:
    """The lines of the drive alone, with its own values and both parts of their uncertainty.

    extra  (n, n) covariance of the outcome's values that comes from held values and from doubt about the noise
    """
    if extra is not None:
        more = e.line @ extra @ e.line.T
        e = replace(e, std_noise=np.sqrt(e.std_noise**2 + np.diag(more)), covariance=e.covariance + more)
    own, found, kept = dict(zip(e.own.free, range(len(e.own.free)), strict=True)), [], []
    for p in lines:
        if p.name not in own:
            if p.name not in e.outcome.task.drive.known_torques:
                found.append(p)
            continue
        j = own[p.name]
        value, std = float(e.own.drive.values[p.name]), float(np.sqrt(e.covariance[j, j]))
        low, high = e.own.drive.quantity(p.name).bounds
        if p.status not in ("fitted", "at-bound") or (p.status == "at-bound" and value in (low, high)):
            found.append(replace(p, value=value))
            continue
        if value in (low, high):
            far = ONE_SIDED * std
            ci = (low, min(low + far, high)) if value == low else (max(high - far, low), high)
            found.append(replace(p, value=value, std=None, ci95=ci, status="at-bound", reason=why_on_bound(value)))
            continue
        p = replace(p, status="fitted", reason="")
        ci = (max(value - Z95 * std, low), min(value + Z95 * std, high))
        found.append(replace(p, value=value, std=std, ci95=ci, std_noise=float(e.std_noise[j]),
                             std_structure=float(e.std_structure[j]) if e.asked is None or e.asked[j] else None))
        kept.append(j)
    names = tuple(e.own.free[j] for j in kept)
    return tuple(found), Covariance(names, e.covariance[np.ix_(kept, kept)]) if kept else None
