"""Diagnose where the motion is imposed: which cause makes the required torque equal the logged one.

Rounds, candidates and rules are those of a diagnosis by simulation. The criterion differs: the error of the
required torque over held-out samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from drivetool.check.causes import CAUSES, Cause
from drivetool.check.fit import FIT_ERRORS, MIN_TESTABLE_GAIN, Model
from drivetool.check.heldout import (
    EVENT_TIMES,
    Score,
    Split,
    blocks_of,
    gain_by_blocks,
    log_scanned_values,
    split_of,
    total_evidence,
)
from drivetool.check.inverse.cross_validated_fit import (
    CrossValidatedFit,
    Records,
    best_test_loss,
    cross_validated_fit,
    gain_of_missing_laws,
    records_of,
)
from drivetool.check.inverse.plot_data import torque_plots
from drivetool.check.outcome import (
    OUTSIDE_CATALOGUE,
    CandidateResult,
    DiagnoseOptions,
    Diagnosis,
    Facts,
    Gain,
    Round,
)
from drivetool.check.search import (
    CandidateFit,
    Decision,
    SelectedCauses,
    decide,
    law_of,
    tested_state,
    why_absent,
)
from drivetool.check.starts import Start
from drivetool.check.verdict import apply_rules, candidate_plots, experiment_of, sentence_of, sizes_of
from drivetool.drive import TOTALS, Drive
from drivetool.errors import BadOption, BadParameters, NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.estimate import Estimate, Parameter
from drivetool.identify.fit import with_friction_parts
from drivetool.identify.inverse import (
    MIN_FIRST_STAGE_F,
    InverseRegression,
    check_inverse_options,
    first_stage_f,
    greybox_by_inverse,
    regression_of,
    with_instruments,
)
from drivetool.identify.motion import CONSTANT_TORQUE_TOLERANCE, reference_of
from drivetool.identify.noise import Noise
from drivetool.identify.setup import Options, Roles, Task, first_point, roles_of
from drivetool.logs import Experiment
from drivetool.quantity import quantity_of, record_of

# Log likelihood gained before, which makes any lead on the training samples count for nothing: the torque residual
# is other laws, not noise, and only held-out data are evidence.
UNLIMITED_GAIN = np.inf
MIN_TEST_BLOCKS = 2  # one block gives no scatter
NEEDS_SIMULATION = "inverse dynamics does not identify it; a diagnosis by simulation does"


@dataclass(frozen=True)
class Node:
    """The drive with the causes found so far.

    model         the fit to all training samples, in the form that causes use
    alternatives  the start of its own fit, as long as no cause was found: a base may be biased by a missing law
    """

    model: Model
    fit: CrossValidatedFit
    alternatives: tuple[Model, ...] = ()
    found: SelectedCauses = field(default_factory=SelectedCauses)
    rounds: tuple[Round, ...] = ()


def diagnose_by_inverse(experiments: Sequence[Experiment], drive: Drive, free: Sequence[str],
                        options: DiagnoseOptions, holdout: Sequence[Experiment] = (),
                        initial_fit: Mapping[str, float] = MappingProxyType({}),
                        own: Sequence[str] = ()) -> Diagnosis:
    """Find laws that are missing in the required torque.

    experiments  records with motor_torque and the motor's speed or angle; holdout: held-out records, or none: then
                 each half of the blocks tests the fit to the other
    drive, free  the base, fitted, and its fitted parameters; initial_fit: start values of its fit
    own          names NAME@RECORD of parameters that held-out records have of their own: fitted to them, all else
                 fixed
    raises       BadOption: a path between torque and body, sums of friction; BadParameters; NotEnoughData
    source       Gautier, Janot and Vandanjon 2013, cross validation of inverse dynamics; for rules
                 check/verdict/rules.py
    """
    drive.require(drive.missing(), "a diagnosis")
    summed = [n for n in free if n in TOTALS]
    if summed:
        raise BadOption("a base with the friction of each body for --criterion inverse", ", ".join(summed),
                        "Fit it with greybox --criterion inverse first.")
    drive = with_friction_parts(drive)
    if not free:
        raise BadParameters("a base with fitted parameters", "none that was fitted",
                            "Run greybox --criterion inverse on a record of this drive first.")
    inverse_options = Options(criterion="inverse")
    check_inverse_options(drive, free, inverse_options)
    logged = (*experiments, *holdout)
    if len({e.step for e in logged}) > 1:
        raise BadOption("recordings of one sampling rate for --criterion inverse", "several",
                        "Bring them to one with --condition 'decimate factor=N'.")
    # A parameter that the base has for a held-out record is fitted to that record, like the requested ones.
    hashes = {n: drive.records.get(record_of(n)) for n in free if record_of(n)}
    trained, tested = ({e.sha256 for e in records} for records in (experiments, holdout))
    own = tuple(dict.fromkeys((*own, *(n for n, sha in hashes.items() if sha in tested - trained))))
    free = tuple(n for n in free if n not in own and (n not in hashes or hashes[n] in trained))
    roles = roles_of(logged, drive)
    # The transient of a chain is that of the start values: a base that lacks friction may oscillate without end.
    start = drive.with_values({n: v for n, v in initial_fit.items() if n in free})
    split = split_of(logged, len(experiments), drive, roles)
    records = records_of(_inverse_problem(logged, start, free, roles), split, len(experiments), own)
    node = first = _base_node(records, drive, tuple(free), roles, tuple(experiments))
    if np.count_nonzero(first.fit.squares[1]) < MIN_TEST_BLOCKS:
        raise NotEnoughData(f"motion in at least {MIN_TEST_BLOCKS} test blocks", "less",
                            "Record longer, or leave out --holdout: then parts of the records test each other.")
    for number in range(options.rounds):
        budget = options.error_budget * 0.5 ** (number + 1)
        node, more = _run_round(node, records, split, options.candidates or tuple(CAUSES), budget)
        if not more:
            break
    return _diagnosis(first, node, records, split, drive, roles, options)


def _inverse_problem(logged: Sequence[Experiment], drive: Drive, free: Sequence[str],
                     roles: Roles) -> InverseRegression:
    """The records with instruments from their reference, where these are strong enough."""
    sensor = roles.outputs[0]
    found = regression_of(logged, drive, free, sensor, roles.inputs[1:])
    reference, _ = reference_of(logged, sensor)
    if reference is None:
        return found
    instrumented = with_instruments(found, sensor, reference)
    return instrumented if first_stage_f(instrumented) > MIN_FIRST_STAGE_F else found


def _base_node(records: Records, drive: Drive, free: tuple[str, ...], roles: Roles,
          train: tuple[Experiment, ...]) -> Node:
    """The base, fitted from its values and from the start values of its own fit, whichever is likelier."""
    initial = records.inverse.drive
    fits = [cross_validated_fit(records, drive, free)]
    with suppress(*FIT_ERRORS):  # from its start values it may diverge
        fits.append(cross_validated_fit(records, initial, free))
    fit, task = min(fits, key=lambda f: f.own.mean), Task(drive, free, roles, train)
    alternative = _as_model("base", task, replace(fit, whole=replace(fit.whole, drive=initial)))
    return Node(_as_model("base", task, fit), fit, (alternative,))


def _as_model(code: str, task: Task, fit: CrossValidatedFit) -> Model:
    """A fit in the form that causes use: drive, records and value, without a filter."""
    task = replace(task, drive=fit.whole.drive)
    problem = task.problem()
    return Model(code, task, problem, first_point(task.drive, problem, task.roles), Noise(1.0, None, np.ones(1)),
                 fit.own.training)


def _run_round(node: Node, records: Records, split: Split, codes: Sequence[str],
               budget: float) -> tuple[Node, bool]:
    """(the node with the cause that the round found, whether one was found).

    budget  share of records without a cause on which one may be found in this round
    """
    trials, fits = [], {}
    for code in codes:
        trial = _best_trial(CAUSES[code], node, records)
        fit = None if trial.model is None else _cross_validate(trial.model, node, records)
        if fit is not None:
            fits[code] = fit
        elif trial.model is not None:
            trial = replace(trial, model=None, absent="failed", reason="it diverges in parts of the records")
        trials.append(trial)
    # The residual of the best is closest to noise: it gives the number of independent samples.
    share = min([node.fit, *fits.values()], key=lambda f: f.own.mean).own.share
    bests = [best_test_loss(node.fit, records, k) for k in range(len(records.test_masks))]
    scores = [_score(t.model, node, fits[t.cause.code], bests, share) for t in trials if t.model is not None]
    decision = decide(scores, budget, UNLIMITED_GAIN)
    one = Round(len(node.rounds) + 1, candidates=_candidate_results(trials, scores, decision, node))
    if decision.best is None:
        return replace(node, rounds=(*node.rounds, one)), False
    best, code = decision.best, decision.best.model.code
    found, fit = node.found, fits[code]
    new = tuple(n for n in best.model.task.free if n not in node.model.task.free)
    general = [c for c in found.causes if c not in CAUSES[code].special]  # it contains its special cases
    found = SelectedCauses((*general, code),
                           {**found.rivals, code: tuple(c for c in decision.between if c != code)},
                           {**found.evidence, code: decision.evidence}, {**found.added, code: new},
                           found.gained + best.gain, found.sure | ({code} if best.sure else set()))
    one = one.replace(cause=code, gain=_torque_gain(node.fit, fit, records, split))
    return Node(replace(best.model, code="base"), fit, (), found, (*node.rounds, one)), True


def _best_trial(cause: Cause, node: Node, records: Records) -> CandidateFit:
    """The likeliest fit of a cause to all training samples."""
    base = node.model
    if cause.imposed is None or len(base.task.drive.bodies) < cause.bodies:
        return CandidateFit(cause, None, {}, "not-shown", NEEDS_SIMULATION)
    starts = [start for model in (base, *node.alternatives) for start in cause.imposed(model)]
    if not starts:
        return CandidateFit(cause, None, {}, *why_absent(cause, base))
    models = [m for m in (_fit_from_start(cause, start, base, records) for start in starts) if m is not None]
    best = min(models, key=lambda m: m.value, default=None)
    if best is None:
        return CandidateFit(cause, None, {}, "failed", "no fit ended within its bounds")
    if base.value - best.value < MIN_TESTABLE_GAIN:
        return CandidateFit(cause, None, {}, "no-gain", "it does not make the records it is fitted to more likely")
    return CandidateFit(cause, best)


def _fit_from_start(cause: Cause, start: Start, base: Model, records: Records) -> Model | None:
    """The fit of a cause from a start; None where it fails, or ends outside its bounds or implausibly."""
    task = start.task
    try:
        fit = cross_validated_fit(records, task.drive, task.free, whole=True)
        model = _as_model(cause.code, task, fit)
    except FIT_ERRORS:
        return None
    bounds = cause.bounds(base, task) if cause.bounds else {}
    within_bounds = all(low <= (fit.whole.drive.value(n) or 0.0) <= high for n, (low, high) in bounds.items())
    plausible = within_bounds and np.isfinite(model.value) and not (
        cause.implausible and cause.implausible(model, base))
    return model if plausible else None


def _cross_validate(model: Model, node: Node, records: Records) -> CrossValidatedFit | None:
    """The cause fitted to the training samples of every fold, None if it diverges where the node does not.

    The time of a single event is held at its estimate from the whole record.
    """
    event_times = {n for n in model.task.free if quantity_of(n) in EVENT_TIMES and n not in node.model.task.free}
    free = tuple(n for n in model.task.free if n not in event_times)
    with suppress(*FIT_ERRORS):
        fit = cross_validated_fit(records, model.task.drive, free)
        if np.array_equal(fit.squares[1], node.fit.squares[1]):
            return fit
    return None


def _score(model: Model, node: Node, fit: CrossValidatedFit, bests: Sequence[float], share: float) -> Score:
    """The gain of a cause on the test samples.

    bests  per fold, the loss of the node fitted to them; share: of independent samples
    """
    gains = share * (node.fit.test() - fit.test(with_noise_gain=True))[node.fit.squares[1] > 0]
    price = log_scanned_values(model, node.model)
    evidence = tuple(share * (best - float(j.test(with_noise_gain=True).sum())) - price
                     for best, j in zip(bests, fit.test_errors, strict=True))
    return Score(model, gains, evidence, tuple(j.training for j in fit.test_errors), (model,),
                 share * (node.model.value - model.value), len(model.task.free) - len(node.model.task.free))


def _candidate_results(trials: Sequence[CandidateFit], scores: Sequence[Score], decision: Decision,
           node: Node) -> tuple[CandidateResult, ...]:
    """One result per cause, the best first."""
    by_code, lines = {s.model.code: s for s in scores}, []
    for t in trials:
        s = by_code.get(t.cause.code)
        if s is None or t.model is None:
            lines.append(CandidateResult(t.cause.code, t.absent, law=law_of(t.cause), reason=t.reason))
            continue
        drive = t.model.task.drive
        values = {n: Parameter(name=n, value=drive.values[n], unit=drive.unit(n)) for n in t.model.task.free
                  if n not in node.model.task.free}
        lines.append(CandidateResult(
            t.cause.code, tested_state(s, decision), law=law_of(t.cause), gain=s.gain, gain_std=s.gain_std,
            evidence=total_evidence([s], UNLIMITED_GAIN) / float(np.log(10.0)), parameters=values, sure=s.sure))
    return tuple(sorted(lines, key=lambda r: (-(r.gain if r.gain is not None else -np.inf), r.code)))


def _torque_gain(before: CrossValidatedFit, after: CrossValidatedFit, records: Records, split: Split,
                 percent: float = 0.0) -> Gain:
    """The error of the torque over the test samples."""
    unit = records.inverse.drive.torque_unit
    with_motion = before.squares[1] > 0
    squares = [f.squares[0][with_motion] / f.squares[1][with_motion] for f in (before, after)]
    errors = before.rmse, after.rmse
    i, a, b = blocks_of(split.traces)[0]
    scatter, rms = _torque_scatter(records)
    fits = [100.0 * (1.0 - e / scatter) if scatter > CONSTANT_TORQUE_TOLERANCE * rms else np.nan for e in errors]
    return gain_by_blocks(errors, (fits[0], fits[1]), squares, unit, (b - a) * split.traces[i].step, np.nan,
                          percent).replace(of="torque")


def _torque_scatter(records: Records) -> tuple[float, float]:
    """Standard deviation of the torque over the test samples, and its root mean square."""
    values = [q.torque[q.used & m] for q, *masks in zip(
        records.inverse.with_motion(), *records.test_masks, strict=True) for m in masks]
    torque = np.concatenate(values)
    return float(np.std(torque)), float(np.sqrt(np.mean(torque**2)))


def _diagnosis(first: Node, node: Node, records: Records, split: Split, before: Drive, roles: Roles,
          options: DiagnoseOptions) -> Diagnosis:
    """The diagnosis: facts, rule, estimate, sentence."""
    missing_gain = gain_of_missing_laws(node.fit, records)
    possible = max(node.found.gained, 0.0) + missing_gain
    percent = 100.0 * missing_gain / possible if possible > 0.0 else 0.0
    # Zero means no missing law of the motion; other laws may still be missing.
    gain = _torque_gain(first.fit, node.fit, records, split, percent if missing_gain > 0.0 else np.nan)
    found, task = node.found, node.model.task
    facts = Facts(
        causes=found.causes, between=found.between,
        strongest=max(found.causes, key=lambda c: found.evidence[c], default=""),
        hardly=tuple(c for c in found.causes if c not in found.sure), gained=found.gained, left=missing_gain,
        before=gain.held_out_rmse_before, after=gain.held_out_rmse_after, scatter=gain.rmse_bar, floor=np.nan,
        left_percent=percent)
    verdict = apply_rules(facts)
    estimate = _estimate(task, before, roles, options, records)
    if records.own:
        own = _own_values(node.fit.trained[-1].drive, records)
        estimate = replace(estimate, findings=(*estimate.findings, own))
    codes = (verdict.causes, verdict.between, found.causes)
    sentence = sentence_of(verdict.verdict, codes, "", gain, 0.0, doubt=verdict.doubt,
                           sizes=sizes_of(found, estimate, first.model))
    rounds = node.rounds if OUTSIDE_CATALOGUE not in verdict.between else tuple(
        one.with_states({c.code: "possible" for c in one.candidates if c.state == "named"}) for one in node.rounds)
    experiment = experiment_of(verdict.between, verdict.verdict, bool(task.drive.shafts), roles.outputs,
                               verdict.doubt, bool(found.causes))
    shown_fits = [f.trained[-1] if records.own else f.whole for f in (first.fit, node.fit)]
    pictures = (*torque_plots(*shown_fits), *candidate_plots(rounds))
    return Diagnosis(
        verdict.verdict, sentence, verdict.causes, verdict.between,
        found.causes if verdict.verdict == "unexplained" else (), experiment, dict(found.evidence), gain=gain,
        rounds=rounds, rule=verdict.rule, facts=facts, estimate=replace(estimate, outcome=sentence),
        exhibits=pictures)


def _own_values(drive: Drive, records: Records) -> Finding:
    """The parameters that were fitted to held-out records."""
    values = {n: float(drive.values[n]) for n in records.own}
    words = ", ".join(f"{n} {v:.4g} {drive.unit(n)}".rstrip() for n, v in values.items())
    return Finding("note", "held-out-own-values",
                   f"These parameters were fitted to the held-out records, all others held: {words}.", values)


def _estimate(task: Task, before: Drive, roles: Roles, options: DiagnoseOptions, records: Records) -> Estimate:
    """The extended drive with intervals, over its training records."""
    fitted = greybox_by_inverse(task.experiments, task.drive, task.free, roles, Options(criterion="inverse"),
                                records.inverse.lead[:records.fitted])
    lines = tuple(p.replace(start=before.values.get(p.name, p.start)) for p in fitted.parameters)
    return replace(fitted, step="diagnose", parameters=lines, options={
        "candidates": list(options.candidates), "error_budget": options.error_budget, "seed": options.seed,
        "criterion": "inverse"})
