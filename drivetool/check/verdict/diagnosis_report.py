"""The diagnosis report from the rounds of a search: results per cause, verdict, estimate, findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from drivetool.check.causes import CAUSES
from drivetool.check.faults import Fault
from drivetool.check.fit import noise_absorbs_effect
from drivetool.check.heldout import finding_of, records_differ_text
from drivetool.check.outcome import OUTSIDE_CATALOGUE, DiagnoseOptions, Diagnosis, Gain, Round
from drivetool.check.search import SearchResult
from drivetool.check.starts import with_neighbouring_fits
from drivetool.check.validation import run_model
from drivetool.check.verdict.facts import facts_of
from drivetool.check.verdict.narrowband_lines import narrowband_findings
from drivetool.check.verdict.order_map import order_maps
from drivetool.check.verdict.plot_data import diagnosis_plots
from drivetool.check.verdict.rules import MIN_UNEXPLAINED_GAIN, RECORDS_DIFFER_RULE, apply_rules, worsens_free_runs
from drivetool.check.verdict.sentence import experiment_of, sentence_of
from drivetool.check.verdict.size import sizes_of
from drivetool.check.verdict.view import view_of
from drivetool.check.verdict.which_body import unidentified_body_findings
from drivetool.drive import Drive
from drivetool.errors import DriveToolError
from drivetool.finding import Finding
from drivetool.identify.estimate import Estimate, PlotData
from drivetool.identify.identifiability import uncrossed_gaps, without_upper_limit
from drivetool.identify.noise import (
    Fit,
    Noise,
    filtered,
    fit_innovations,
    minus_log_likelihood,
    refit_with_tight_tolerance,
)
from drivetool.identify.outcome import CORRELATED, compose
from drivetool.identify.problem import Point, Problem
from drivetool.identify.setup import Options, Outcome

# Standard deviations from zero from which a parameter of the base counts: 99.7 % of a normal one.
BASE_PARAMETER_STDS = 3.0
# Log likelihood by which the last fit may still change. A choice: a fifth of MIN_UNEXPLAINED_GAIN.
CONVERGED_LOSS_CHANGE = 5.0
# Rounds of the last fit, and of a second one where the first has not converged. A choice: the search ends near the
# optimum, so that few are needed, and each costs a pass over the records.
LAST_FIT_ROUNDS, SECOND_FIT_ROUNDS = 3, 12


def diagnosis_of(search: SearchResult, before: Drive, options: DiagnoseOptions) -> Diagnosis:
    """The diagnosis of a finished search."""
    gain, estimate = search.total_gain(), estimate_of(search, before, options)
    facts = facts_of(search, estimate)
    found = apply_rules(facts)
    if facts.causes and worsens_free_runs(facts):
        search = search.without_causes()
        gain, estimate = search.total_gain(), estimate_of(search, before, options)
    if OUTSIDE_CATALOGUE in found.between:
        search = replace(search, rounds=tuple(
            one.with_states({c.code: "possible" for c in one.candidates
                             if c.code == one.cause in found.between and c.state == "named"})
            for one in search.rounds))
    task, causes = search.model.task, tuple(search.found.causes)
    lines = narrowband_findings(search.whole, gain.unit) if found.doubt or found.verdict == "unexplained" else []
    experiment = experiment_of(found.between, found.verdict, bool(task.drive.shafts), task.roles.outputs,
                               found.doubt, bool(causes))
    sentence = sentence_of(found.verdict, (found.causes, found.between, causes), search.unasked, gain,
                           facts.torque_noise, estimate.fit.get("rmse", np.inf), found.doubt,
                           causes_in_base(search.rounds, estimate),
                           sizes_of(search.found, estimate, search.first.model))
    findings = (*(f.finding for f in search.faults), *search.notes,
                *change_findings(search), *unidentified_body_findings(search), *lines)
    if search.change is not None:
        findings = (*findings, finding_of(search.change, search.model))
        if found.rule == RECORDS_DIFFER_RULE:
            experiment, sentence = findings[-1].action, records_differ_text(search.change, search.model)
    return Diagnosis(
        found.verdict, sentence, found.causes, found.between, causes if found.verdict == "unexplained" else (),
        experiment, dict(search.found.evidence), gain=gain, rounds=tuple(search.rounds), rule=found.rule,
        facts=facts, estimate=replace(estimate, findings=(*findings, *estimate.findings), outcome=sentence),
        exhibits=_plots(search, before, gain))


def correlated_errors_finding(faults: Sequence[Fault]) -> Finding:
    """The finding on correlated errors of the last fit: after a diagnosis it cannot recommend one."""
    if "quantisation" in {f.code for f in faults}:
        return Finding("note", "innovations-correlated",
                       "One-step prediction errors are still correlated; quantisation explains this.")
    return CORRELATED.replace(action="No cause of the catalogue explains the residual.")


def causes_in_base(rounds: Sequence[Round], estimate: Estimate) -> list[str]:
    """The causes that the drive had before the first round, with a size that differs significantly from zero."""
    significant = tuple(p for p in estimate.parameters if p.std and abs(p.value) > BASE_PARAMETER_STDS * p.std)
    had = [c.code for c in rounds[0].candidates if c.state == "in-the-model"] if rounds else []
    # An idle torque that the base has is its own, and no offset of a sensor.
    return [c for c in had if c != "torque-offset" and any(CAUSES[c].has(p.name) for p in significant)]


def change_findings(search: SearchResult) -> list[Finding]:
    """A finding where the halves of the records have different parameters."""
    if search.left.time <= MIN_UNEXPLAINED_GAIN:
        return []
    return [Finding(
        "warning", "parameters-change",
        "The two halves of the records have different parameters. The drive changes during the recording, for "
        "example with temperature or wear, or the model lacks an effect that the halves excite differently.",
        {"log_likelihood": float(search.left.time)},
        "Fit each half separately to find the parameter that changes, and record after warming up.")]


def estimate_of(search: SearchResult, before: Drive, options: DiagnoseOptions) -> Estimate:
    """The last model as an estimate: converged, with intervals, over the records it was fitted to."""
    model, train = search.model, search.train
    task = replace(model.fitted, experiments=train)
    stretches = sum(1 for e in train for a, b in e.segments if b - a >= 10)
    problem = replace(model.problem, traces=model.problem.traces[:stretches])
    point = Point(model.point.values, model.point.starts[:stretches])
    fit, converged = _fit_rounds(problem, point, model.noise, LAST_FIT_ROUNDS)
    if not converged:
        fit, converged = _fit_rounds(problem, fit.point, fit.noise, SECOND_FIT_ROUNDS)
    model = replace(model, task=task, problem=problem, point=point)
    if noise_absorbs_effect(replace(model, point=fit.point, noise=fit.noise), model):
        fit, converged = _fit_rounds(problem, point, model.noise, LAST_FIT_ROUNDS, estimate_noise=False)
    outcome = with_neighbouring_fits(Outcome(task, problem, fit.solution, replace(fit, converged=converged), (),
                                             converged))
    outcome, least = uncrossed_gaps(outcome)
    start = replace(task.drive, values={**task.drive.values, **before.values})
    estimate = compose(
        "diagnose", start, outcome, Options(), correlated=correlated_errors_finding(search.faults),
        checks=[partial(without_upper_limit, name=name, low=low) for name, low in least.items()])
    return replace(estimate, options={"candidates": list(options.candidates), "error_budget": options.error_budget,
                                      "seed": options.seed})


def _fit_rounds(problem: Problem, point: Point, noise: Noise, max_rounds: int,
                estimate_noise: bool = True) -> tuple[Fit, bool]:
    """(the fit after some rounds from a point, whether it has converged)."""
    fit = fit_innovations(problem, point, noise, max_rounds=max_rounds, estimate_noise=estimate_noise)
    fit = refit_with_tight_tolerance(problem, fit) if estimate_noise else fit  # `settle` estimates the noise again
    before = minus_log_likelihood(filtered(problem, point, noise, keep=False))
    return fit, fit.converged or fit.gain < CONVERGED_LOSS_CHANGE or abs(fit.value - before) < CONVERGED_LOSS_CHANGE


def _plots(search: SearchResult, before: Drive, gain: Gain) -> tuple[PlotData, ...]:
    """The plots; none of a record whose free run fails."""
    views = []
    after = search.model.fitted.drive
    base = search.first.model.fitted.drive
    for e in search.split.experiments:
        try:
            views.append(view_of(e.name, run_model(e, base, 1.5), run_model(e, after, 1.5)))
        except DriveToolError:
            continue
    maps = order_maps(search.first.model, after.values, (views[0].units[1], views[0].units[2])) if views else ()
    return (*diagnosis_plots(
        views, before.referred_inertia, search.rounds, gain.noise_floor), *maps) if views else ()


