"""From the rounds of a search to what a person reads: results per cause, verdict, estimate, findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from drivetool.check.causes import CAUSES
from drivetool.check.faults import Fault
from drivetool.check.fit import stands_in
from drivetool.check.heldout import finding_of, told_apart
from drivetool.check.outcome import UNLISTED, DiagnoseOptions, Diagnosis, Gain, Round
from drivetool.check.starts import confirmed
from drivetool.check.validation import run_model
from drivetool.check.verdict.exhibits import exhibits_of
from drivetool.check.verdict.facts import facts_of
from drivetool.check.verdict.hum import hum
from drivetool.check.verdict.order_map import order_maps
from drivetool.check.verdict.rules import DIFFERS, UNEXPLAINED, judged, spoils
from drivetool.check.verdict.sentence import experiment_of, sentence_of
from drivetool.check.verdict.size import sizes_of
from drivetool.check.verdict.view import view_of
from drivetool.check.verdict.which_body import untold_bodies
from drivetool.drive import Drive
from drivetool.errors import DriveToolError, Finding
from drivetool.identify.estimate import Estimate, Exhibit
from drivetool.identify.identifiability import all_uncrossed, from_below
from drivetool.identify.noise import Fit, Noise, filtered, fit_innovations, minus_log_likelihood, settle
from drivetool.identify.outcome import CORRELATED, compose
from drivetool.identify.problem import Point, Problem
from drivetool.identify.setup import Outcome

if TYPE_CHECKING:
    from drivetool.check.search import Searched

SHOWN = 3.0  # standard deviations from which a parameter of the base is one
SETTLED = 5.0  # log likelihood by which the last fit may still move
FEW, MANY = 3, 12  # rounds of the last fit, and of a second one where the first has not settled


def tell(search: Searched, before: Drive, options: DiagnoseOptions) -> Diagnosis:
    """The diagnosis of a finished search."""
    gain, estimate = search.total_gain(), estimate_of(search, before, options)
    facts = facts_of(search, estimate)
    found = judged(facts)
    if facts.causes and spoils(facts):
        search = search.given_up()
        gain, estimate = search.total_gain(), estimate_of(search, before, options)
    if UNLISTED in found.between:
        search = replace(search, rounds=tuple(
            _doubting(one, one.cause) if one.cause in found.between else one for one in search.rounds))
    task, causes = search.model.task, tuple(search.found.causes)
    hums = hum(search.whole, gain.unit) if found.doubt or found.verdict == "unexplained" else []
    experiment = experiment_of(found.between, found.verdict, bool(task.drive.shafts), task.roles.outputs,
                               found.doubt, bool(causes))
    sentence = sentence_of(found.verdict, (found.causes, found.between, causes), search.unasked, gain,
                           facts.torque_noise, estimate.fit.get("rmse", np.inf), found.doubt,
                           in_the_base(search.rounds, estimate),
                           sizes_of(search.found, estimate, search.first.model))
    said = (*(f.finding for f in search.faults), *search.notes, *changing(search), *untold_bodies(search), *hums)
    if search.change is not None:
        said = (*said, finding_of(search.change, search.model))
        if found.rule == DIFFERS:
            experiment, sentence = said[-1].action, told_apart(search.change, search.model)
    return Diagnosis(
        replace(estimate, findings=(*said, *estimate.findings), outcome=sentence), found.verdict,
        found.causes, found.between, experiment,
        dict(search.found.evidence), gain, tuple(search.rounds), sentence, _exhibits(search, before, gain),
        causes if found.verdict == "unexplained" else (), found.rule, facts)


def of_correlated_errors(faults: Sequence[Fault]) -> Finding:
    """What is said of correlated errors of the last fit: after a diagnosis it cannot send the user to one."""
    if "quantisation" in {f.code for f in faults}:
        return Finding("note", "innovations-correlated",
                       "One-step errors are still correlated, as the steps of the logger make them.")
    return replace(CORRELATED, action="What is left has no name in the catalogue.")


def in_the_base(rounds: Sequence[Round], estimate: Estimate) -> list[str]:
    """The causes that the drive had before the first round, of a size that the records tell from none."""
    shown = tuple(p for p in estimate.parameters if p.std and abs(p.value) > SHOWN * p.std)
    had = [c.code for c in rounds[0].candidates if c.state == "in-the-model"] if rounds else []
    # An idle torque that the base has is its own, and no offset of a sensor.
    return [c for c in had if c != "torque-offset" and any(CAUSES[c].has(p.name) for p in shown)]


def changing(search: Searched) -> list[Finding]:
    """What to say where the halves of the records ask for different parameters."""
    if search.left.time <= UNEXPLAINED:
        return []
    return [Finding(
        "warning", "parameters-change",
        "The first half of the records asks for other parameters than the second: something changes while it is "
        "recorded, with temperature or wear, say, or a law is missing that the halves show differently.",
        {"log_likelihood": float(search.left.time)},
        "Fit halves by themselves to see which, and record after warming up.")]


def _doubting(one: Round, code: str) -> Round:
    """A round in which a cause is not named any more."""
    return replace(one, candidates=tuple(
        replace(c, state="possible") if c.code == code and c.state == "named" else c for c in one.candidates))


def estimate_of(search: Searched, before: Drive, options: DiagnoseOptions) -> Estimate:
    """The last model as an estimate: settled, with intervals, over the records it was fitted to."""
    model, train = search.model, search.train
    task = replace(model.fitted, experiments=train)
    stretches = sum(1 for e in train for a, b in e.segments if b - a >= 10)
    problem = replace(model.problem, traces=model.problem.traces[:stretches])
    point = Point(model.point.values, model.point.starts[:stretches])
    fit, settled = _fitted(problem, point, model.noise, FEW)
    if not settled:
        fit, settled = _fitted(problem, fit.point, fit.noise, MANY)
    model = replace(model, task=task, problem=problem, point=point)
    if stands_in(replace(model, point=fit.point, noise=fit.noise), model):
        fit, settled = _fitted(problem, point, model.noise, FEW, renewed=False)
    outcome = confirmed(Outcome(task, problem, fit.solution, replace(fit, converged=settled), (), settled))
    outcome, least = all_uncrossed(outcome)
    start = replace(task.drive, values={**task.drive.values, **before.values})
    estimate = compose("diagnose", start, outcome, correlated=of_correlated_errors(search.faults))
    for name, low in least.items():
        estimate = from_below(estimate, name, low)
    return replace(estimate, options={"candidates": list(options.candidates), "error_budget": options.error_budget,
                                      "seed": options.seed})


def _fitted(problem: Problem, point: Point, noise: Noise, most: int, renewed: bool = True) -> tuple[Fit, bool]:
    """(the fit after some rounds from a point, whether it has settled)."""
    fit = fit_innovations(problem, point, noise, most=most, renewed=renewed)
    fit = settle(problem, fit) if renewed else fit  # settling looks for the noise again
    before = minus_log_likelihood(filtered(problem, point, noise, keep=False))
    return fit, fit.converged or fit.gain < SETTLED or abs(fit.value - before) < SETTLED


def _exhibits(search: Searched, before: Drive, gain: Gain) -> tuple[Exhibit, ...]:
    """The pictures; without them where a free run cannot be had."""
    views = []
    after = search.model.fitted.drive
    base = search.first.model.fitted.drive
    for e in search.split.experiments:
        try:
            views.append(view_of(e.name, run_model(e, base, 1.5), run_model(e, after, 1.5)))
        except DriveToolError:
            continue
    maps = order_maps(search.first.model, after.values, (views[0].units[1], views[0].units[2])) if views else ()
    return (*exhibits_of(views, before.referred_inertia, search.rounds, gain.noise_floor), *maps) if views else ()


