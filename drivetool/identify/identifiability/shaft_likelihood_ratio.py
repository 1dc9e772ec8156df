"""Likelihood ratio of each shaft against the same drive with that shaft rigid.

Where a resonance is not excited, noise still makes peaks of the likelihood: narrow ones of little damping, whose
curvature looks like information. The likelihood gain of such a peak does not depend on its curvature.
"""

from __future__ import annotations

from collections.abc import Mapping

from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import NOT_CONVERGED_TEXT, Estimate, Verdict, masked
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


def insignificant_shafts(estimate: Estimate, gains: Mapping[str, float]) -> Verdict:
    """What is identified only from a resonance that is not significant has no interval.

    gains  of each shaft, see `shaft_gain`; clearly below zero the fit is wrong, and nothing has an interval
    """
    missed = [s for s, w in gains.items() if w < -MAX_RIGID_GAIN]
    if missed:
        return Verdict([_missed_resonance(missed[0], gains)], masked(estimate, NOT_CONVERGED_TEXT, None))
    weak = [s for s, w in gains.items() if w < MIN_SHAFT_GAIN]
    lines = {p.name: p for s in weak for p in masked(
        estimate, f"the resonance of {s} is not significant", names=names_joined_by(estimate.drive, s))}
    return Verdict([_insignificant_shaft_finding(estimate.drive, s, gains[s]) for s in weak], tuple(lines.values()))


def _insignificant_shaft_finding(drive: Drive, shaft: str, gain: float) -> Finding:
    first, last = drive.bodies[drive.shafts.index(shaft):][:2]
    return Finding(
        "warning", "shaft-not-identifiable",
        f"The resonance of {shaft} is not significant: a rigid shaft predicts as well. Its stiffness and "
        f"damping are not identifiable, nor is the distribution of the inertia between {first} and "
        f"{last}.",
        {"log_likelihood_worth": gain, "wanted": MIN_SHAFT_GAIN},
        "Excite it: a chirp or a multisine about the expected frequency, or log the speed on its other side too.")


def names_joined_by(drive: Drive, shaft: str) -> set[str]:
    """Stiffness and damping of a shaft, and the inertias that it joins."""
    k = drive.shafts.index(shaft)
    return {name_of(shaft, "stiffness"), name_of(shaft, "damping"), *(
        name_of(body, what) for body in drive.bodies[k:k + 2] for what in ("inertia", "carried_mass"))}


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
