"""Diagnose where the motion is imposed: which cause makes a drive ask for the torque that was logged.

Rounds, candidates and rules are those of a diagnosis by simulation. The judge is another one: the error of the
torque over samples that no fit has seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from drivetool.check.causes import CAUSES, Cause
from drivetool.check.fit import BROKEN, TRIFLE, Model
from drivetool.check.heldout import (
    ONE_OFF,
    Score,
    Split,
    blocks_of,
    gain_by_blocks,
    price_of,
    split_of,
    total_evidence,
)
from drivetool.check.inverse.exhibits import torque_exhibits
from drivetool.check.inverse.explanation import Explanation, Records, best_on, explanation, left_by_laws, records_of
from drivetool.check.outcome import UNLISTED, CandidateResult, DiagnoseOptions, Diagnosis, Facts, Gain, Round
from drivetool.check.search import Decision, Found, decide, law_of, why_absent
from drivetool.check.starts import Start
from drivetool.check.verdict import candidates_of, experiment_of, judged, sentence_of, sizes_of
from drivetool.drive import AT, TOTALS, Drive
from drivetool.errors import BadOption, BadParameters, Finding, NotEnoughData
from drivetool.identify.estimate import Estimate, Parameter
from drivetool.identify.fit import apart
from drivetool.identify.inverse import (
    WEAK,
    Inverse,
    askable,
    greybox_by_inverse,
    recorded,
    strength,
    with_instruments,
)
from drivetool.identify.motion import ROUNDED, reference_of
from drivetool.identify.noise import Noise
from drivetool.identify.setup import Options, Roles, Task, first_point, roles_of
from drivetool.logs import Experiment

# Log likelihood that was gained before, beside which no lead on the samples of the fit counts: what a law leaves of
# a torque is no noise but other laws, and data held out alone are evidence.
ALL_GAINED = np.inf
FEWEST = 2  # blocks: one does not say how much they scatter
BY_SIMULATION = "a torque that an imposed motion asks for does not tell it; a diagnosis by simulation does"


@dataclass(frozen=True)
class Node:
    """The drive with the causes found so far.

    model  the fit to all training samples as causes see it; elsewhere: where its own fit began, as long as no cause
           was found: a base may have gone far to make up for what it lacks
    """

    model: Model
    fit: Explanation
    elsewhere: tuple[Model, ...] = ()
    found: Found = field(default_factory=Found)
    rounds: tuple[Round, ...] = ()


@dataclass(frozen=True)
class Trial:
    """A cause on top of a node: its fit, or why there is none."""

    cause: Cause
    model: Model | None = None
    line: CandidateResult | None = None


def diagnose_by_inverse(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str],
                        options: DiagnoseOptions, holdout: Sequence[Experiment] = (),
                        begun: Mapping[str, float] = MappingProxyType({}), own: Sequence[str] = ()) -> Diagnosis:
    """Find what the torque that a motion asks for lacks.

    experiments  records with motor_torque and the motor's speed or angle; holdout: records that only judge, or
                 none: then each half of the blocks judges what the other trained
    drive, free  the base, fitted, and its fitted parameters; begun: values that its fit started from
    own          names NAME@RECORD of what records held out have of their own: fitted to them, all else held
    raises       BadOption: a path between torque and body, sums of friction; BadParameters; NotEnoughData
    source       Gautier, Janot and Vandanjon 2013, cross validation of inverse dynamics; for rules
                 check/verdict/rules.py
    """
    drive.require(drive.missing(), "a diagnosis")
    summed = [n for n in free if n in TOTALS]
    if summed:
        raise BadOption("a base with the friction of each body for --criterion inverse", ", ".join(summed),
                        "Fit it with greybox --criterion inverse first.")
    drive = apart(drive)
    if not free:
        raise BadParameters("a base with fitted parameters", "none that was fitted",
                            "Run greybox --criterion inverse on a record of this drive first.")
    asked = Options(criterion="inverse")
    askable(drive, free, asked)
    logged = (*experiments, *holdout)
    if len({e.step for e in logged}) > 1:
        raise BadOption("recordings of one sampling rate for --criterion inverse", "several",
                        "Bring them to one with --condition 'decimate factor=N'.")
    # What the base has of a record that only judges is fitted to that one, like what was asked for.
    hashes = {n: drive.records.get(n.partition(AT)[2]) for n in free if AT in n}
    trained, judging = ({e.sha256 for e in records} for records in (experiments, holdout))
    own = tuple(dict.fromkeys((*own, *(n for n, sha in hashes.items() if sha in judging - trained))))
    free = tuple(n for n in free if n not in own and (n not in hashes or hashes[n] in trained))
    roles = roles_of(logged, drive)
    # How long a chain remembers is a matter of where its fit began: a base that lacks friction may ring for ever.
    start = drive.with_values({n: v for n, v in begun.items() if n in free})
    split = split_of(logged, len(experiments), drive, roles)
    records = records_of(_motion_of(logged, start, free, roles), split, len(experiments), own)
    node = first = _root(records, drive, tuple(free), roles, tuple(experiments))
    if np.count_nonzero(first.fit.squares[1]) < FEWEST:
        raise NotEnoughData(f"motion in at least {FEWEST} of the blocks that judge", "less",
                            "Record longer, or leave --holdout away: then parts of the records judge each other.")
    for number in range(options.rounds):
        budget = options.error_budget * 0.5 ** (number + 1)
        node, more = _round(node, records, split, options.candidates or tuple(CAUSES), budget)
        if not more:
            break
    return _told(first, node, records, split, drive, roles, options)


def _motion_of(logged: Sequence[Experiment], drive: Drive, free: Sequence[str], roles: Roles) -> Inverse:
    """The records with instruments from their reference, where that tells enough."""
    sensor = roles.outputs[0]
    found = recorded(logged, drive, free, sensor, roles.inputs[1:])
    reference, _ = reference_of(logged, sensor)
    if reference is None:
        return found
    given = with_instruments(found, sensor, reference)
    return given if strength(given) > WEAK else found


def _root(records: Records, drive: Drive, free: tuple[str, ...], roles: Roles,
          train: tuple[Experiment, ...]) -> Node:
    """The base, fitted from where it is and from where the records were begun, whichever is likelier."""
    begun = records.inverse.drive
    fits = [explanation(records, drive, free)]
    with suppress(*BROKEN):  # where its own fit began it may run away
        fits.append(explanation(records, begun, free))
    fit, task = min(fits, key=lambda f: f.own.mean), Task(drive, free, roles, train)
    away = _model("base", task, replace(fit, whole=replace(fit.whole, drive=begun)))
    return Node(_model("base", task, fit), fit, (away,))


def _model(code: str, task: Task, fit: Explanation) -> Model:
    """A fit as the causes see it: they ask for drive, records and value, and for no filter."""
    task = replace(task, drive=fit.whole.drive)
    problem = task.problem()
    return Model(code, task, problem, first_point(task.drive, problem, task.roles), Noise(1.0, None, np.ones(1)),
                 fit.own.training)


def _round(node: Node, records: Records, split: Split, codes: Sequence[str], budget: float) -> tuple[Node, bool]:
    """(the node with what the round found, whether that was anything).

    budget  share of records without a cause on which one may be found in this round
    """
    trials, fits = [], {}
    for code in codes:
        trial = _tried(CAUSES[code], node, records)
        fit = None if trial.model is None else _folded(trial.model, node, records)
        if fit is not None:
            fits[code] = fit
        elif trial.model is not None:
            trial = replace(trial, model=None, line=CandidateResult(
                code, law_of(trial.cause), "failed", reason="it runs away in parts of the records"))
        trials.append(trial)
    # What the best of them leaves is as near to noise as the round comes: it says how many samples count.
    share = min([node.fit, *fits.values()], key=lambda f: f.own.mean).own.share
    bests = [best_on(node.fit, records, k) for k in range(len(records.judges))]
    scores = [_score(t.model, node, fits[t.cause.code], bests, share) for t in trials if t.model is not None]
    decision = decide(scores, budget, ALL_GAINED)
    lines = _lines(trials, scores, decision, node)
    if decision.best is None:
        return replace(node, rounds=(*node.rounds, Round(None, lines))), False
    best, code = decision.best, decision.best.model.code
    found, fit = node.found, fits[code]
    new = tuple(n for n in best.model.task.free if n not in node.model.task.free)
    general = [c for c in found.causes if c not in CAUSES[code].special]  # it contains those that are
    found = Found((*general, code), {**found.rivals, code: tuple(c for c in decision.between if c != code)},
                  {**found.evidence, code: decision.evidence}, {**found.added, code: new},
                  found.gained + best.gain, found.sure | ({code} if best.sure else set()))
    gain = _gain(node.fit, fit, records, split)
    return Node(replace(best.model, code="base"), fit, (), found, (*node.rounds, Round(code, lines, gain))), True


def _tried(cause: Cause, node: Node, records: Records) -> Trial:
    """The likeliest fit of a cause to all training samples."""
    def absent(state: str, reason: str) -> Trial:
        return Trial(cause, line=CandidateResult(cause.code, law_of(cause), state, reason=reason))

    base = node.model
    if cause.imposed is None or len(base.task.drive.bodies) < cause.bodies:
        return absent("not-shown", BY_SIMULATION)
    starts = [start for model in (base, *node.elsewhere) for start in cause.imposed(model)]
    if not starts:
        return absent(*why_absent(cause, base))
    models = [m for m in (_begun(cause, start, base, records) for start in starts) if m is not None]
    best = min(models, key=lambda m: m.value, default=None)
    if best is None:
        return absent("failed", "no fit came to an end where it may be")
    if base.value - best.value < TRIFLE:
        return absent("no-gain", "it does not make the records it is fitted to more likely")
    return Trial(cause, best)


def _begun(cause: Cause, start: Start, base: Model, records: Records) -> Model | None:
    """The fit of a cause from a start; None where it fails, or ends where its cause says that it is none."""
    task = start.task
    try:
        fit = explanation(records, task.drive, task.free, whole=True)
        model = _model(cause.code, task, fit)
    except BROKEN:
        return None
    bounds = cause.bounds(base, task) if cause.bounds else {}
    inside = all(low <= (fit.whole.drive.value(n) or 0.0) <= high for n, (low, high) in bounds.items())
    plausible = inside and np.isfinite(model.value) and not (cause.implausible and cause.implausible(model, base))
    return model if plausible else None


def _folded(model: Model, node: Node, records: Records) -> Explanation | None:
    """The cause fitted to the training samples of every fold, None if it runs away where the node does not.

    When a one-off event was, all of the record tells.
    """
    held = {n for n in model.task.free if n.endswith(ONE_OFF) and n not in node.model.task.free}
    free = tuple(n for n in model.task.free if n not in held)
    with suppress(*BROKEN):
        fit = explanation(records, model.task.drive, free)
        if np.array_equal(fit.squares[1], node.fit.squares[1]):
            return fit
    return None


def _score(model: Model, node: Node, fit: Explanation, bests: Sequence[float], share: float) -> Score:
    """What a cause is worth on the samples that judge.

    bests  per fold, what the node reaches fitted to them; share: as which part of its number each sample counts
    """
    gains = share * (node.fit.test() - fit.test(doubted=True))[node.fit.squares[1] > 0]
    price = price_of(model, node.model)
    evidence = tuple(share * (best - float(j.test(doubted=True).sum())) - price
                     for best, j in zip(bests, fit.judged, strict=True))
    return Score(model, gains, evidence, tuple(j.training for j in fit.judged), (model,),
                 share * (node.model.value - model.value), len(model.task.free) - len(node.model.task.free))


def _lines(trials: Sequence[Trial], scores: Sequence[Score], decision: Decision,
           node: Node) -> tuple[CandidateResult, ...]:
    """One line per cause, the best first."""
    by_code, lines = {s.model.code: s for s in scores}, []
    for t in trials:
        s = by_code.get(t.cause.code)
        if s is None or t.model is None:
            assert t.line is not None
            lines.append(t.line)
            continue
        state = "worse" if s.gain > 0.0 else "no-gain"
        if t.cause.code in decision.between:
            state = "named" if len(decision.between) == 1 else "possible"
        drive = t.model.task.drive
        values = tuple(Parameter(n, drive.values[n], drive.unit(n)) for n in t.model.task.free
                       if n not in node.model.task.free)
        lines.append(CandidateResult(
            t.cause.code, law_of(t.cause), state, s.gain, s.gain_std,
            total_evidence([s], ALL_GAINED) / float(np.log(10.0)), parameters=values, sure=s.sure))
    return tuple(sorted(lines, key=lambda r: (-(r.gain if r.gain is not None else -np.inf), r.code)))


def _gain(before: Explanation, after: Explanation, records: Records, split: Split, percent: float = 0.0) -> Gain:
    """The error of the torque over what judges."""
    unit = records.inverse.drive.torque_unit
    moves = before.squares[1] > 0
    squares = [f.squares[0][moves] / f.squares[1][moves] for f in (before, after)]
    errors = before.rmse, after.rmse
    i, a, b = blocks_of(split.traces)[0]
    spread, rms = _spread(records)
    fits = [100.0 * (1.0 - e / spread) if spread > ROUNDED * rms else np.nan for e in errors]
    return replace(gain_by_blocks(errors, (fits[0], fits[1]), squares, unit, (b - a) * split.traces[i].step, np.nan,
                                  percent), of="torque")


def _spread(records: Records) -> tuple[float, float]:
    """Standard deviation of the torque over what judges, and its root mean square."""
    values = [q.torque[q.used & m] for q, *masks in zip(
        records.inverse.with_motion(), *records.judges, strict=True) for m in masks]
    torque = np.concatenate(values)
    return float(np.std(torque)), float(np.sqrt(np.mean(torque**2)))


def _told(first: Node, node: Node, records: Records, split: Split, before: Drive, roles: Roles,
          options: DiagnoseOptions) -> Diagnosis:
    """The diagnosis: facts, rule, estimate, sentence."""
    left = left_by_laws(node.fit, records)
    possible = max(node.found.gained, 0.0) + left
    percent = 100.0 * left / possible if possible > 0.0 else 0.0
    # Laws of the motion are not all that can be left of a torque: none says nothing of the rest.
    gain = _gain(first.fit, node.fit, records, split, percent if left > 0.0 else np.nan)
    found, task = node.found, node.model.task
    facts = Facts(
        causes=found.causes, between=found.between,
        strongest=max(found.causes, key=lambda c: found.evidence[c], default=""),
        hardly=tuple(c for c in found.causes if c not in found.sure), gained=found.gained, left=left,
        before=gain.held_out_rmse_before, after=gain.held_out_rmse_after, scatter=gain.rmse_bar, floor=np.nan,
        left_percent=percent)
    verdict = judged(facts)
    estimate = _estimate(task, before, roles, options, records)
    if records.own:
        own = _own_values(node.fit.trained[-1].drive, records)
        estimate = replace(estimate, findings=(*estimate.findings, own))
    codes = (verdict.causes, verdict.between, found.causes)
    sentence = sentence_of(verdict.verdict, codes, "", gain, 0.0, doubt=verdict.doubt,
                           sizes=sizes_of(found, estimate, first.model))
    rounds = node.rounds if UNLISTED not in verdict.between else tuple(
        replace(one, candidates=tuple(replace(c, state="possible") if c.state == "named" else c
                                      for c in one.candidates)) for one in node.rounds)
    experiment = experiment_of(verdict.between, verdict.verdict, bool(task.drive.shafts), roles.outputs,
                               verdict.doubt, bool(found.causes))
    drawn = [f.trained[-1] if records.own else f.whole for f in (first.fit, node.fit)]
    pictures = (*torque_exhibits(*drawn), *candidates_of(rounds))
    return Diagnosis(replace(estimate, outcome=sentence), verdict.verdict, verdict.causes, verdict.between,
                     experiment, dict(found.evidence), gain, rounds, sentence, pictures,
                     found.causes if verdict.verdict == "unexplained" else (), verdict.rule, facts)


def _own_values(drive: Drive, records: Records) -> Finding:
    """What was fitted to records that only judge."""
    told = {n: float(drive.values[n]) for n in records.own}
    words = ", ".join(f"{n} {v:.4g} {drive.unit(n)}".rstrip() for n, v in told.items())
    return Finding("note", "held-out-own-values", f"Fitted to records that only judge, all else held: {words}.",
                   told)


def _estimate(task: Task, before: Drive, roles: Roles, options: DiagnoseOptions, records: Records) -> Estimate:
    """The extended drive with intervals, over the records that it is fitted to."""
    fitted = greybox_by_inverse(task.experiments, task.drive, task.free, roles, Options(criterion="inverse"),
                                records.inverse.lead[:records.fitted])
    lines = tuple(replace(p, start=before.values.get(p.name, p.start)) for p in fitted.parameters)
    return replace(fitted, step="diagnose", parameters=lines, options={
        "candidates": list(options.candidates), "error_budget": options.error_budget, "seed": options.seed,
        "criterion": "inverse"})
