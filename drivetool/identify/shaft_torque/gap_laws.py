"""Both published laws of a gap with damping, where a shaft torque was measured: which one the record supports.

"inside": the damping belongs to the contact, which then never pulls. "always": it acts in the gap too. Across many
passages a fit converges only from near the optimum: half gap and damping start from the dead stretches of the shaft
torque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from drivetool.drive import DampingLaw, is_constant
from drivetool.errors import DriveToolError
from drivetool.finding import Finding
from drivetool.identify.noise import (
    MAX_REPEATED_FITS,
    Noise,
    fit_innovations,
    fit_ratio,
    refit_with_tight_tolerance,
    until_converged,
)
from drivetool.identify.setup import Options, Outcome, Task, first_point
from drivetool.identify.shaft_torque.dead_stretches import Crossings, crossings
from drivetool.identify.starts import log_likelihood_distance
from drivetool.quantity import name_of, record_of

MIN_LAW_LEAD = 7.0  # log likelihood by which one law must lead: odds of a thousand to one
# Of the contact's damping, as start values: the dead stretches identify it to a third.
START_DAMPING_SHARES = (0.6, 1.0, 1.6)
# Log likelihood behind the likeliest start, a choice: further behind, a start is given up.
MAX_GAP_START_LOSS = 300.0
LAW_DESCRIPTIONS = {"inside": "the damping acts in contact only",
                    "always": "the damping acts in contact and in the gap",
                    "contact": "the damping acts in contact only and the shaft relaxes in the gap"}


@dataclass(frozen=True)
class BothLaws:
    """Fits of both laws: the better outcome, the outcome of each law, and the dead stretches, if any."""

    outcome: Outcome
    each: Mapping[str, Outcome]
    seen: Crossings | None

    @property
    def lead(self) -> float:
        """Log likelihood of the outcome's law over the other, below zero if it is behind; infinite without one."""
        others = [o.fit.value for law, o in self.each.items()
                  if law != self.outcome.drive.damping_law]
        return min(others) - self.outcome.fit.value if others else float("inf")


def both_laws(task: Task, options: Options) -> BothLaws | None:
    """The fits of both laws from the dead stretches; None: there are none, or no fit converged.

    The shaft damping is freed with the gap, unless holding it was requested: with the gap closed another one acts.
    So are values with a standard deviation: over many passages an error of one per cent biases the gap.

    task  with one half gap free
    """
    if len(task.drive.shafts) != 1 or options.criterion not in ("auto", "innovations"):
        return None
    shaft = task.drive.shafts[0]
    if name_of(shaft, "half_gap") not in task.free or any(record_of(n) for n in (*task.free, *task.drive.values)):
        return None
    seen = crossings(task)
    if not seen:
        return None
    names = {name_of(shaft, "half_gap"), name_of(shaft, "damping")} - set(options.hold)
    with_prior = [] if options.known is None else [
        n for n in options.known.names if n in task.drive.values and n not in options.hold and not is_constant(n)]
    each: dict[str, Outcome] = {}
    for law in get_args(DampingLaw):
        if law == "contact":  # from where its neighbour ended: both differ in the gap alone
            near = each.get("inside")
            starts = [] if near is None else [replace(near.fitted, drive=replace(near.fitted.drive, damping_law=law))]
        else:
            starts = [start for one in seen for start in _law_starts(task, shaft, law, one, names)]
        if (found := _fit_of_law(starts, (*task.free, *with_prior), names)) is not None:
            each[law] = found
    converged = [o for o in each.values() if o.converged]
    if not converged:
        return None
    best = min(converged, key=lambda o: o.fit.value)
    own = each.get(task.drive.damping_law)
    both = BothLaws(best, each, seen[0])
    # Where the record does not distinguish the laws, that of the file stays, if its fit converged.
    return replace(both, outcome=own) if own is not None and own.converged and both.lead <= MIN_LAW_LEAD else both


def both_laws_from(outcome: Outcome, options: Options) -> BothLaws | None:
    """The fits of both laws from the optimum of one, where the motor alone was measured.

    The shaft damping is free in both, unless holding it was requested. None: no single gap that was fitted, no
    damping, or a fit that did not converge.

    outcome  of the drive's own law, whatever was free
    """
    task = outcome.fitted
    shafts = task.drive.shafts
    gap, damping = name_of(shafts[0], "half_gap"), name_of(shafts[0], "damping")
    if len(shafts) != 1 or options.criterion not in ("auto", "innovations") or outcome.fit is None \
            or not outcome.converged or gap not in task.free or not task.drive.value(damping) \
            or not task.drive.value(gap) or any(record_of(n) for n in (*task.free, *task.drive.values)):
        return None
    freed = task.with_free({*task.free, damping} - set(options.hold))
    each: dict[str, Outcome] = {}
    for law in get_args(DampingLaw):
        start = replace(freed, drive=replace(task.drive, damping_law=law))
        if (found := _fit_or_none(start, MAX_REPEATED_FITS, outcome.fit.noise)) is not None and found.converged:
            each[law] = found
    own = task.drive.damping_law
    if own not in each:
        return None
    best = min(each.values(), key=lambda o: o.fit.value)
    both = BothLaws(best, each, None)
    # Where the record does not distinguish the laws, or damping does not matter, the fit that was made stays.
    return both if best.drive.damping_law != own and both.lead > MIN_LAW_LEAD else replace(both, outcome=each[own])


def _law_starts(task: Task, shaft: str, law: DampingLaw, seen: Crossings, names: set[str]) -> list[Task]:
    """Start tasks of a law: with the gap of the dead stretches, and their damping if it is free."""
    name = name_of(shaft, "damping")
    first = [seen.open] if law == "always" else []
    values = [v for v in (*first, *(share * seen.closed for share in START_DAMPING_SHARES)) if v > 0.0]
    start = replace(task,
                    drive=replace(task.drive, damping_law=law)).at({name_of(shaft, "half_gap"): seen.half_gap})
    return [start.at({name: v}) for v in dict.fromkeys(values)] if name in names and values else [start]


def _fit_of_law(starts: Sequence[Task], free: tuple[str, ...], names: set[str]) -> Outcome | None:
    """The fit of one law: gap and damping from every start, then all that is free from the likeliest ends."""
    first = [o for start in starts if (o := _fit_or_none(start.with_free(names), 0)) is not None]
    if not first:
        return None
    best = min(o.fit.value for o in first)
    found = [_fit_or_none(o.fitted.with_free({*names, *free}), MAX_REPEATED_FITS, o.fit.noise)
             for o in first if o.fit.value < best + MAX_GAP_START_LOSS]
    return _likeliest_with_starts([o for o in found if o is not None])


def _fit_or_none(task: Task, repeats: int, noise: Noise | None = None) -> Outcome | None:
    """A fit from the task's values; None where it fails.

    more  fits, each from the end of the one before, until one converges
    """
    try:
        problem = task.problem()
        point = first_point(task.drive, problem, task.roles)
        fit = fit_innovations(problem, point, noise or fit_ratio(problem, point, Noise(1.0, None, problem.scale)),
                              near_optimum=noise is not None)
        if repeats:
            fit = refit_with_tight_tolerance(problem, until_converged(problem, fit, repeats))
    except (DriveToolError, np.linalg.LinAlgError):
        return None
    return Outcome.of_fit(task, problem, fit)


def _likeliest_with_starts(found: Sequence[Outcome]) -> Outcome | None:
    """The likeliest converged outcome, with the end of each start: without convergence the noise is not final."""
    if not found:
        return None
    best = min([o for o in found if o.converged] or found, key=lambda o: o.fit.value)
    starts = tuple({
        "way": "dead stretches",
        "minus_log_likelihood_above_best": max(o.fit.value - best.fit.value, 0.0),
        "apart": log_likelihood_distance(best.problem, best.solution, o.solution),
        "reached": dict(zip(o.task.free, map(float, o.solution.point.values), strict=True))} for o in found)
    return replace(best, starts=starts)


def gap_law_finding(both: BothLaws, shaft: str, converged: bool = True) -> Finding:
    """Which law the record supports, with both results; converged: whether the reported fit converged."""
    evidence: dict[str, float] = {}
    drive = both.outcome.drive
    units = [drive.unit(name_of(shaft, n)) for n in ("half_gap", "damping")]
    for law, o in both.each.items():
        evidence |= {f"half_gap_{law}": o.drive.values[name_of(shaft, "half_gap")],
                     f"damping_{law}": o.drive.value(name_of(shaft, "damping")) or 0.0}
    law = drive.damping_law
    sizes = ", ".join(f"{name}: half gap {evidence[f'half_gap_{name}']:.4g} {units[0]}, damping "
                      f"{evidence[f'damping_{name}']:.3g} {units[1]}{'' if o.converged else ', not converged'}"
                      for name, o in both.each.items())
    if both.lead == float("inf"):
        return Finding(
            "note", "gap-law",
            f"Only one law could be fitted to this record: {LAW_DESCRIPTIONS[law]} ({sizes}).", evidence,
            "Record more passages through the gap.")
    if not converged:
        return Finding(
            "note", "gap-law",
            f"The damping law of the gap is not identifiable: the fit did not converge ({sizes}).",
            evidence, "Give better start values with --set, or record more passages through the gap.")
    if both.lead <= MIN_LAW_LEAD:
        best = min(o.fit.value for o in both.each.values())
        tied = [LAW_DESCRIPTIONS[name] for name, o in both.each.items() if o.fit.value <= best + MIN_LAW_LEAD]
        return Finding(
            "note", "gap-law", f"This record does not distinguish whether {' or '.join(tied)} ({sizes}).",
            {**evidence, "log_likelihood_lead": both.lead},
            "Record more passages through the gap, slow ones too: damping in the gap has its largest effect "
            "there.")
    return Finding(
        "note", "gap-law",
        f"This record supports one law: {LAW_DESCRIPTIONS[law]} (damping_law: {law}). Its log likelihood is higher "
        f"by {both.lead:.0f} ({sizes}).", {**evidence, "log_likelihood_lead": both.lead},
        "Keep damping_law in the parameter file.")


def gap_law_findings(both: BothLaws | None, outcome: Outcome, free: Sequence[str],
                     converged: bool, opens: bool = True) -> list[Finding]:
    """Which law it is, and what was fitted besides the request.

    converged  whether the outcome converged; opens: whether the gap is above zero, else it has no law
    """
    if both is None:
        return []
    more = [n for n in outcome.task.free if n not in free]
    if both.seen is None and name_of(outcome.drive.shafts[0], "damping") not in more:  # the fit is as requested
        more = []
    law = [gap_law_finding(both, outcome.drive.shafts[0], converged)] if opens else []
    return [*law, *([] if not more else [Finding(
        "note", "gap-refit",
        f"{', '.join(more)} were fitted jointly with the half gap. Over many passages, errors of one per cent in "
        "held values would bias it.", {"values": len(more)}, "Hold accurately known values with --hold.")])]


def dead_stretch_details(both: BothLaws) -> dict[str, object]:
    """The estimates from the dead stretches, for comparison with the fit."""
    if both.seen is None:
        return {}
    return {"dead_stretches": {"half_gap": both.seen.half_gap, "spread": both.seen.spread,
                               "damping_in_gap": both.seen.open, "crossings": both.seen.count}}
