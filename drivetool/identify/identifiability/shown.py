"""Whether the record shows a shaft at all: against the same drive with that shaft rigid.

Where a resonance is not excited, the likelihood still has peaks, made by noise: narrow ones of little damping,
with a curvature that passes for knowledge. What such a peak is worth does not depend on its curvature.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from drivetool.errors import Finding
from drivetool.identify.estimate import Covariance, Estimate, without_intervals, without_untold
from drivetool.identify.noise import Fit, fit_innovations
from drivetool.identify.setup import Outcome, first_point, has_gap

RIGID = 100.0  # times as stiff and as damped: ten times the frequency, and no resonance any more
SHOWN = 12.0  # log likelihood that a shaft must be worth; the highest of a thousand peaks of noise is worth seven
WORSE = 2.0  # log likelihood by which no rigid shaft may be better: the fit has missed the resonance
FEW = 3  # rounds of the rigid fit, which begins with the right sums


def worth_of_shafts(outcome: Outcome) -> dict[str, float]:
    """Log likelihood that each fitted shaft gains over a rigid one, by its name; none across a gap."""
    if outcome.fit is None or has_gap(outcome.task):
        return {}
    return {shaft: float(_rigid(outcome, k).value - outcome.fit.value)
            for k, shaft in enumerate(outcome.task.drive.shafts) if f"{shaft}.stiffness" in outcome.task.free}


def told_by(estimate: Estimate, worth: Mapping[str, float]) -> Estimate:
    """The estimate without intervals of what only a resonance tells that the record does not show.

    worth  of the shafts, as above; below zero the fit itself is to be doubted, and nothing has an interval
    """
    astray = [s for s, w in worth.items() if w < -WORSE]
    if astray:
        return replace(estimate, parameters=without_intervals(estimate.parameters), covariance=None, findings=(
            *estimate.findings, _astray(astray[0], worth)))
    for shaft in (s for s, w in worth.items() if w < SHOWN):
        estimate = _without(estimate, shaft, worth[shaft])
    return estimate


def _without(estimate: Estimate, shaft: str, worth: float) -> Estimate:
    """The estimate without intervals of a shaft that is worth nothing, and what to say."""
    drive = estimate.drive
    first, last = drive.bodies[drive.shafts.index(shaft):][:2]
    found = Finding(
        "warning", "resonance-not-shown",
        f"The record does not show the resonance of {shaft}: a rigid one predicts as well. Its stiffness and "
        f"damping cannot be told, nor the shares of {first} and {last} in their inertia.",
        {"log_likelihood_worth": worth, "wanted": SHOWN},
        "Excite it: a chirp or a multisine about the expected frequency, or log the speed on its other side too.")
    estimate = not_of_shaft(estimate, shaft, f"the record does not show the resonance of {shaft}")
    return replace(estimate, findings=(*estimate.findings, found))


def not_of_shaft(estimate: Estimate, shaft: str, reason: str) -> Estimate:
    """The estimate without intervals of a shaft and of the inertias that it joins, for a reason."""
    drive = estimate.drive
    k = drive.shafts.index(shaft)
    names = {f"{shaft}.stiffness", f"{shaft}.damping", *(
        f"{body}.{what}" for body in drive.bodies[k:k + 2] for what in ("inertia", "carried_mass"))}
    lines = tuple(p.untold(reason, "not-identifiable")
                  if p.name in names and p.status in ("fitted", "at-bound") else p for p in estimate.parameters)
    kept = estimate.covariance
    if kept is not None:
        index = [i for i, n in enumerate(kept.names) if n not in names]
        kept = Covariance(tuple(kept.names[i] for i in index), kept.matrix[np.ix_(index, index)]) if index else None
    # What the fit said of each of them by itself, it said of another drive.
    others = without_untold(estimate.findings, names)
    return replace(estimate, parameters=lines, covariance=kept, findings=tuple(others))


def _astray(shaft: str, worth: Mapping[str, float]) -> Finding:
    return Finding(
        "warning", "not-settled",
        f"The fit missed the resonance: with a rigid {shaft} the drive predicts the record better. No intervals "
        "are given.", {"log_likelihood_lost": -worth[shaft]},
        "Start nearer with --set, or hold what is known with --hold.")


def _rigid(outcome: Outcome, k: int) -> Fit:
    """The fit with a rigid shaft, beyond which the inertia is held: the one before it takes up the sum."""
    task = outcome.task.at_point(outcome.solution.point)
    shaft, beyond = task.drive.shafts[k], task.drive.bodies[k + 1]
    held = {f"{shaft}.stiffness", f"{shaft}.damping", f"{beyond}.inertia", f"{beyond}.carried_mass"}
    stiff = {n: RIGID * task.drive.value(n) for n in (f"{shaft}.stiffness", f"{shaft}.damping")}
    task = replace(task.at(stiff), free=tuple(n for n in task.free if n not in held))
    problem = task.problem()
    return fit_innovations(problem, first_point(task.drive, problem, task.roles), outcome.fit.noise, most=FEW)
