"""Single samples that no noise explains: found by the one-step errors of a fit, and left out of the next.

A handful of them moves a fit that takes all noise as normal: 30 of 50 000 samples of a real bench, where the
encoder slipped by a few counts, moved the inertias by 1.5 %, a hundred times what their intervals say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.errors import Finding
from drivetool.identify.noise import fit_innovations, settle
from drivetool.identify.setup import Outcome, Task, has_gap

LARGEST = 8.0  # robust standard deviations; normal noise exceeds them once in 1e15 samples
RARE = 2e-3  # share of the samples; more of them are not outliers but what the model does not know
ROUNDS = 3
NAMED = 8  # instants in a finding


def without_outliers(outcome: Outcome) -> tuple[Outcome, list[Finding]]:
    """The outcome refitted without such samples, and what was left out.

    Nothing is left out where there is a gap: contacts, too, come as single large errors.
    """
    first, left = outcome, []
    if outcome.fit is None or has_gap(outcome.task):
        return outcome, []
    for _ in range(ROUNDS):
        task, fresh = _masked(outcome)
        if not fresh:
            break
        left += fresh
        task = task.at_point(outcome.solution.point)
        problem = task.problem()
        fit = settle(problem, fit_innovations(problem, outcome.solution.point, outcome.fit.noise, arrived=True))
        outcome = Outcome(task, problem, fit.solution, fit, outcome.starts, fit.converged)
    return (outcome, [_told(first, outcome, left)]) if left else (outcome, [])


def _masked(outcome: Outcome) -> tuple[Task, list[float]]:
    """(the task with far samples missing, their times [s]); no times if there are none or too many."""
    errors = [f.innovations / np.sqrt(f.variance) for f in outcome.fit.passes]
    whole = np.concatenate(errors)
    middle = np.nanmedian(whole, axis=0)
    scale = 1.4826 * np.nanmedian(np.abs(whole - middle), axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        far = [np.abs(z - middle) > LARGEST * scale for z in errors]
    count = int(sum(f.sum() for f in far))
    if not count or count > RARE * whole.size or not np.all(scale > 0.0):
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


def _told(before: Outcome, after: Outcome, times: Sequence[float]) -> Finding:
    """How many, when, and what they had done to the values."""
    moved = {n: (float(a), float(b)) for n, a, b in zip(
        after.task.free, before.solution.point.values, after.solution.point.values, strict=True)}
    instants = sorted({round(t, 2) for t in times})
    when = ", ".join(f"{t:.2f}" for t in instants[:NAMED]) + (" ..." if len(instants) > NAMED else "")
    name = max(moved, key=lambda n: abs(moved[n][1] - moved[n][0]) / max(abs(moved[n][1]), 1e-300)
               if n.endswith((".inertia", ".stiffness", ".carried_mass")) else 0.0)
    return Finding(
        "warning", "samples-left-out",
        f"{len(times)} samples, at {when} s, lie more than {LARGEST:.0f} standard deviations off what the drive "
        f"does next: glitches of a sensor, or knocks. They were left out, which moved {name} by "
        f"{100.0 * (moved[name][1] / moved[name][0] - 1.0):.2g} %.",
        {"count": len(times), "instants": " ".join(f"{t:g}" for t in instants[:NAMED])},
        "Look at these instants. Steps of an encoder need nothing more; for knocks and impacts run diagnose.")
