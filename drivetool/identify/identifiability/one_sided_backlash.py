"""A gap that was opened but not crossed: only a lower limit of its width is identifiable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.finding import Finding
from drivetool.identify.estimate import Estimate, Verdict, covariance_of
from drivetool.identify.fit import refit
from drivetool.identify.noise import filtered, minus_log_likelihood
from drivetool.identify.problem import Point, solve
from drivetool.identify.setup import Outcome, Task
from drivetool.identify.starts import free_values
from drivetool.quantity import names_of, owner_of, quantity_of

WIDE_GAP_FACTOR = 100.0  # times the half gap found. A choice: more than any travel in a record
# Log likelihood that grazing contacts gain by chance: where a contact sets in, the filter's slope jumps, and the
# fit tunes the contact to the noise. A choice: as for held values that the record contradicts.
MAX_GRAZING_GAIN = 30.0
# Standard deviations of a one-sided 95 % limit: the normal quantile with all digits. Z95_ONE_SIDED of estimate/ is
# rounded and 9e-5 larger; one value for both would change what is reported.
Z95_ONE_SIDED_ALL_DIGITS = 1.644853626951472
# Times the half gap that the travel just fills. A choice: rounding must not close the contact
BEYOND_TRAVEL_FACTOR = 1.02


def uncrossed_gaps(outcome: Outcome) -> tuple[Outcome, dict[str, float]]:
    """(the fit, lower limit of each free half gap that was never crossed, by its name)."""
    least = {}
    for name in [n for n in outcome.task.free if quantity_of(n) == "half_gap"]:
        if found := never_crossed(outcome, name):
            outcome, least[name] = found
    return outcome, least


def never_crossed(outcome: Outcome, gap: str) -> tuple[Outcome, float] | None:
    """(the fit with a gap that the travel does not fill, 95 % lower limit); None if the gap was crossed.

    For a gap that was opened but not crossed, the likelihood is flat above the half gap that the travel just
    fills. Grazing contacts on the far side of a narrower gap may fit as well, by chance.
    """
    task = outcome.fitted
    value, rest = task.drive.value(gap) or 0.0, task.with_held({gap})
    if outcome.fit is None or not rest.free or value <= 0.0:
        return None
    wide = refit(rest.at({gap: WIDE_GAP_FACTOR * value}), outcome.fit.noise, outcome.fit.value)
    filled = _half_gap_of_travel(wide, gap) if wide.fit.value < outcome.fit.value + MAX_GRAZING_GAIN else None
    if filled is None:
        return None
    return (_with_half_gap(wide, gap, BEYOND_TRAVEL_FACTOR * filled[0], task),
            max(float(filled[0] - Z95_ONE_SIDED_ALL_DIGITS * filled[1]), 0.0))


def _half_gap_of_travel(wide: Outcome, gap: str) -> tuple[float, float] | None:
    """(half gap that the travel just fills, its std), by a fit with a wide gap; None with contact on both sides."""
    problem, solution, noise = wide.problem, wide.solution, wide.fit.noise
    gaps = names_of(wide.drive.shafts, "half_gap")
    shaft = [g for g in gaps if wide.drive.value(g) or g in wide.task.free].index(gap)

    def travel(values: np.ndarray) -> float:
        deepest, sides = 0.0, set()
        point = Point(values, solution.point.starts)
        for plant, passed in zip(problem.plants(values, False), filtered(problem, point, noise), strict=True):
            s = plant.system
            spring, reach = s.spring[shaft, :s.nx, 0], s.reach[shaft, 0]
            torque = passed.states[len(passed.states) // 50:] @ spring[:passed.states.shape[1]]
            sides |= set(np.sign(torque[np.abs(torque) > reach]))
            stiffness = spring[np.flatnonzero(spring)[-1]]
            deepest = max([deepest, *((reach - side * torque).max() / stiffness for side in sides)])
        return 0.5 * deepest if len(sides) == 1 else np.nan

    best = travel(solution.point.values)
    if not np.isfinite(best):
        return None
    matrix = np.nan_to_num(covariance_of(problem, solution)[0])
    std = np.sqrt(np.diag(matrix))
    slopes = np.zeros(len(std))
    for j in np.flatnonzero(std):
        step = std[j] * np.eye(len(std))[j]
        change = travel(solution.point.values + step) - travel(solution.point.values - step)
        slopes[j] = 0.5 * np.nan_to_num(change) / std[j]
    return best, float(np.sqrt(slopes @ matrix @ slopes))


def _with_half_gap(wide: Outcome, gap: str, value: float, task: Task) -> Outcome:
    """The fit with a wide gap, as one of all free parameters at another half gap that is not crossed either."""
    broad = wide.fitted
    # Closed or open at the start: the distance from the side in contact stays.
    column = len(broad.drive.bodies) + broad.drive.shafts.index(owner_of(gap))
    starts = tuple(s.copy() for s in wide.solution.point.starts)
    for s in starts:
        s[column] += np.sign(s[column]) * (value - (broad.drive.value(gap) or 0.0))
    whole = replace(broad.at({gap: value}), free=task.free)
    problem, point = whole.problem(), Point(free_values(whole), starts)
    passes = filtered(problem, point, wide.fit.noise)
    solution = solve(problem, point, [f.gains for f in passes], max_iterations=0)
    fit = replace(wide.fit, solution=solution, passes=tuple(passes), value=minus_log_likelihood(passes))
    start_record = {"way": "never crossed", "minus_log_likelihood_above_best": 0.0,
            "reached": dict(zip(task.free, point.values.tolist(), strict=True))}
    return Outcome(whole, problem, solution, fit, (start_record,), wide.converged)


def without_upper_limit(estimate: Estimate, name: str, low: float) -> Verdict:
    """A half gap of which only a lower limit is identifiable."""
    return Verdict([Finding(
        "warning", "gap-unbounded", f"{name} has no upper limit in this record.", {"at_least": low},
        "Record torque steps that cross the gap both ways.", name)],
        [estimate.line(name).without_interval("the likelihood is flat towards larger gaps", "not-identifiable")])
