"""Outliers: single samples far from their one-step prediction by a fit, left out of the next.

A few of them bias a fit that assumes normal noise: 30 of 50 000 samples of a real bench, where the encoder slipped
by a few counts, moved the inertias by 1.5 %, a hundred times their intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.finding import Finding
from drivetool.identify.noise import fit_innovations, refit_with_tight_tolerance
from drivetool.identify.setup import Outcome, Task, has_gap
from drivetool.logs.samples import STD_PER_MAD
from drivetool.quantity import quantity_of

REFIT_OUTLIER_STDS = 8.0  # robust standard deviations; normal noise exceeds them once in 1e15 samples
MAX_REFIT_OUTLIER_SHARE = 2e-3  # share of the samples. A choice: more of them are no outliers but a missing law
# Of fit and removal. A choice: large outliers hide smaller ones, few remain after the second.
MAX_OUTLIER_ROUNDS = 3
MAX_LISTED_INSTANTS = 8  # instants in a finding. A choice: as many as one line holds


def without_outliers(outcome: Outcome) -> tuple[Outcome, list[Finding]]:
    """The outcome refitted without outliers, and a finding on them.

    Nothing is left out where there is a gap: contacts, too, cause single large errors.
    """
    first, times = outcome, []
    if outcome.fit is None or has_gap(outcome.task):
        return outcome, []
    for _ in range(MAX_OUTLIER_ROUNDS):
        task, fresh = _without_far_samples(outcome)
        if not fresh:
            break
        times += fresh
        task = task.at_point(outcome.solution.point)
        problem = task.problem()
        fit = refit_with_tight_tolerance(problem,
                     fit_innovations(problem, outcome.solution.point, outcome.fit.noise, near_optimum=True))
        outcome = Outcome.of_fit(task, problem, fit, outcome.starts)
    return (outcome, [_outlier_finding(first, outcome, times)]) if times else (outcome, [])


def _without_far_samples(outcome: Outcome) -> tuple[Task, list[float]]:
    """(the task with far samples missing, their times [s]); no times if there are none or too many.

    A stretch with more noise than the others has a scale of its own.
    """
    errors = [f.innovations / np.sqrt(f.variance) for f in outcome.fit.passes]
    whole = np.concatenate(errors)
    middle = np.nanmedian(whole, axis=0)
    typical = np.nanmedian(np.abs(whole - middle), axis=0)
    distances = [np.where(np.isfinite(z), np.abs(z - middle), typical) for z in errors]
    far = [d > REFIT_OUTLIER_STDS * STD_PER_MAD * np.maximum(typical, np.median(d, axis=0)) for d in distances]
    count = int(sum(f.sum() for f in far))
    if not count or count > MAX_REFIT_OUTLIER_SHARE * whole.size or not np.all(typical > 0.0):
        return outcome.task, []
    traces, times, experiments = iter(far), [], []
    for e in outcome.task.experiments:
        signals = dict(e.signals)
        for first, last in e.segments:
            if last - first < 10:  # as traces_of does
                continue
            mask = next(traces)
            times += ((first + np.flatnonzero(mask.any(axis=1))) * e.step).tolist()
            for m, role in enumerate(outcome.task.roles.outputs):
                values = np.array(signals[role], float)
                values[first:last][mask[:, m]] = np.nan
                signals[role] = values
        experiments.append(replace(e, signals=signals))
    return replace(outcome.task, experiments=tuple(experiments)), times


def _outlier_finding(before: Outcome, after: Outcome, times: Sequence[float]) -> Finding:
    """The finding: how many outliers, when, and the bias by them."""
    moved = {n: (float(a), float(b)) for n, a, b in zip(
        after.task.free, before.solution.point.values, after.solution.point.values, strict=True)}
    instants = sorted({round(t, 2) for t in times})
    when = ", ".join(f"{t:.2f}" for t in instants[:MAX_LISTED_INSTANTS]) + (
        " ..." if len(instants) > MAX_LISTED_INSTANTS else "")
    name = max(moved, key=lambda n: abs(moved[n][1] - moved[n][0]) / max(abs(moved[n][1]), 1e-300)
               if quantity_of(n) in ("inertia", "stiffness", "carried_mass") else 0.0)
    return Finding(
        "warning", "outliers-left-out",
        f"{len(times)} samples, at {when} s, lie more than {REFIT_OUTLIER_STDS:.0f} standard deviations from their "
        f"one-step prediction: sensor glitches or impacts. Leaving them out changes {name} by "
        f"{100.0 * (moved[name][1] / moved[name][0] - 1.0):.2g} %.",
        {"count": len(times), "instants": " ".join(f"{t:g}" for t in instants[:MAX_LISTED_INSTANTS])},
        "Look at these instants. Encoder quantisation steps need no action; for impacts run diagnose.")
