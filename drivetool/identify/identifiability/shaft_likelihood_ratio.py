"""Likelihood ratio of each shaft against the same drive with that shaft rigid.

Where a resonance is not excited, noise still makes peaks of the likelihood: narrow ones of little damping, whose
curvature looks like information. The likelihood gain of such a peak does not depend on its curvature.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from drivetool.finding import Finding
from drivetool.identify.estimate import Estimate, without_intervals, without_not_identifiable_findings
from drivetool.identify.noise import Fit, fit_innovations
from drivetool.identify.setup import Outcome, first_point, has_gap
from drivetool.quantity import name_of

# Times as stiff and as damped: ten times the frequency, and no resonance in the band any more
RIGID_STIFFNESS_FACTOR = 100.0
MIN_SHAFT_GAIN = 12.0  # log likelihood that a shaft must gain; the highest of a thousand peaks of noise gains seven
# Log likelihood by which a rigid shaft may be better. A choice above rounding: if it is more, the fit, of which the
# rigid drive is a special case, missed the resonance.
MAX_RIGID_GAIN = 2.0
# Rounds of the rigid fit: it starts from the right sums, and more rounds move it by nothing that counts
RIGID_FIT_ROUNDS = 3


def shaft_gain(outcome: Outcome) -> dict[str, float]:
    """Log likelihood that each fitted shaft gains over a rigid one, by its name; none across a gap."""
    if outcome.fit is None or has_gap(outcome.task):
        return {}
    return {shaft: float(_fit_with_rigid_shaft(outcome, k).value - outcome.fit.value)
            for k, shaft in enumerate(outcome.task.drive.shafts)
            if name_of(shaft, "stiffness") in outcome.task.free}


def without_unidentified(estimate: Estimate, gains: Mapping[str, float]) -> Estimate:
    """The estimate without intervals of what is identified only from a resonance that is not significant.

    gains  of each shaft, see `shaft_gain`; clearly below zero the fit is wrong, and nothing has an interval
    """
    missed = [s for s, w in gains.items() if w < -MAX_RIGID_GAIN]
    if missed:
        return replace(estimate, parameters=without_intervals(estimate.parameters), covariance=None, findings=(
            *estimate.findings, _missed_resonance(missed[0], gains)))
    for shaft in (s for s, w in gains.items() if w < MIN_SHAFT_GAIN):
        estimate = _without_insignificant_shaft(estimate, shaft, gains[shaft])
    return estimate


def _without_insignificant_shaft(estimate: Estimate, shaft: str, gain: float) -> Estimate:
    """The estimate without intervals of a shaft that gains too little, with the finding."""
    drive = estimate.drive
    first, last = drive.bodies[drive.shafts.index(shaft):][:2]
    found = Finding(
        "warning", "shaft-not-identifiable",
        f"The resonance of {shaft} is not significant: a rigid shaft predicts as well. Its stiffness and "
        f"damping are not identifiable, nor is the distribution of the inertia between {first} and "
        f"{last}.",
        {"log_likelihood_worth": gain, "wanted": MIN_SHAFT_GAIN},
        "Excite it: a chirp or a multisine about the expected frequency, or log the speed on its other side too.")
    estimate = without_shaft_intervals(estimate, shaft, f"the resonance of {shaft} is not significant")
    return replace(estimate, findings=(*estimate.findings, found))


def without_shaft_intervals(estimate: Estimate, shaft: str, reason: str) -> Estimate:
    """The estimate without intervals of a shaft and of the inertias that it joins, for a reason."""
    drive = estimate.drive
    k = drive.shafts.index(shaft)
    names = {name_of(shaft, "stiffness"), name_of(shaft, "damping"), *(
        name_of(body, what) for body in drive.bodies[k:k + 2] for what in ("inertia", "carried_mass"))}
    lines = tuple(p.without_interval(reason, "not-identifiable")
                  if p.name in names and p.status in ("fitted", "at-bound") else p for p in estimate.parameters)
    # The findings of the fit on each of them hold for a drive with that resonance.
    others = without_not_identifiable_findings(estimate.findings, names)
    covariance = estimate.covariance and estimate.covariance.without(names)
    return replace(estimate, parameters=lines, covariance=covariance, findings=tuple(others))


def _missed_resonance(shaft: str, gains: Mapping[str, float]) -> Finding:
    return Finding(
        "warning", "not-converged",
        f"The fit did not converge to the global optimum and missed the resonance: a rigid {shaft} gives a higher "
        "likelihood. No intervals are given.", {"log_likelihood_lost": -gains[shaft]},
        "Give better start values with --set, or hold what is known with --hold.")


def _fit_with_rigid_shaft(outcome: Outcome, k: int) -> Fit:
    """The fit with a rigid shaft. The inertia behind it is held: the one before it takes up the sum."""
    task = outcome.fitted
    shaft, beyond = task.drive.shafts[k], task.drive.bodies[k + 1]
    held = {name_of(shaft, "stiffness"), name_of(shaft, "damping"), name_of(beyond, "inertia"),
            name_of(beyond, "carried_mass")}
    stiff = {n: RIGID_STIFFNESS_FACTOR * task.drive.value(n)
             for n in (name_of(shaft, "stiffness"), name_of(shaft, "damping"))}
    task = task.at(stiff).with_held(held)
    problem = task.problem()
    return fit_innovations(problem, first_point(task.drive, problem, task.roles), outcome.fit.noise,
                           max_rounds=RIGID_FIT_ROUNDS)
