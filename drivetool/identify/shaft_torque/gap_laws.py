"""The published laws of a gap with damping: which one the record supports.

"inside": the damping belongs to the contact, which then never pulls. "always": it acts in the gap too. "contact":
as "inside", but the shaft relaxes in the gap. Across many passages a fit converges only from near the optimum: half
gap and damping start from the dead stretches of the shaft torque, where one was measured.
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
    ABANDON_EXCESS,
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
class GapLaws:
    """Fits of each law: the outcome to report, the outcome of each law, and the dead stretches, if any."""

    outcome: Outcome
    each: Mapping[str, Outcome]
    seen: Crossings | None

    @property
    def lead(self) -> float:
        """Log likelihood of the outcome's law over the best other, negative if behind; infinite without one."""
        others = [o.fit.value for law, o in self.each.items()
                  if law != self.outcome.drive.damping_law]
        return min(others) - self.outcome.fit.value if others else float("inf")

    @property
    def tied(self) -> list[str]:
        """Laws that the record does not distinguish from the likeliest one that converged."""
        best = min(o.fit.value for o in self.each.values() if o.converged)
        return [law for law, o in self.each.items() if o.fit.value <= best + MIN_LAW_LEAD]

    def with_own(self, law: str) -> GapLaws:
        """With the outcome of a law that converged, if the record does not distinguish it from the likeliest."""
        kept = law in self.tied and self.each[law].converged
        return replace(self, outcome=self.each[law]) if kept else self


def fit_gap_laws(task: Task, options: Options) -> GapLaws | None:
    """The fits of each law from the dead stretches; None: there are none, or no fit converged.

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
    free, each = (*task.free, *with_prior), {}
    for law in get_args(DampingLaw):
        near = _fit_from_neighbour(each) if law == "contact" else None
        others = seen if near is None or not near.converged else seen[:1]
        if others != seen and min(o.fit.value for o in each.values()) < near.fit.value - MIN_LAW_LEAD:
            others = []  # it is behind: it needs no other start that confirms it
        starts = [start for one in others for start in _law_starts(task, shaft, law, one, names)]
        if (found := _fit_of_law(starts, free, names, near)) is not None:
            each[law] = found
    converged = [o for o in each.values() if o.converged]
    if not converged:
        return None
    # Where the record does not distinguish the laws, that of the file stays.
    return GapLaws(min(converged, key=lambda o: o.fit.value), each, seen[0]).with_own(task.drive.damping_law)


def fit_gap_laws_from(outcome: Outcome, options: Options) -> GapLaws | None:
    """The fits of each law from the optimum of one, where the motor alone was measured.

    The shaft damping is free in all, unless holding it was requested. None: no single gap that was fitted, no
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
        found = (_fit_from_neighbour(each) if law == "contact" and "inside" in each else
                 _fit_or_none(start, MAX_REPEATED_FITS, outcome.fit.noise))
        if found is not None and found.converged:
            each[law] = found
    own = task.drive.damping_law
    if own not in each:
        return None
    # Where the record does not distinguish the laws, or damping does not matter, the fit that was made stays.
    return GapLaws(min(each.values(), key=lambda o: o.fit.value), each, None).with_own(own)


def _fit_from_neighbour(each: Mapping[str, Outcome]) -> Outcome | None:
    """The fit of the law "contact" from where "inside" ended: they differ in the gap alone."""
    inside = each.get("inside")
    return inside and _fit_or_none(replace(inside.fitted, drive=replace(inside.drive, damping_law="contact")),
                                   MAX_REPEATED_FITS, inside.fit.noise, min(o.fit.value for o in each.values()))


def _law_starts(task: Task, shaft: str, law: DampingLaw, seen: Crossings, names: set[str]) -> list[Task]:
    """Start tasks of a law: with the gap of the dead stretches, and their damping if it is free."""
    name = name_of(shaft, "damping")
    first = [seen.open] if law == "always" else []
    values = [v for v in (*first, *(share * seen.closed for share in START_DAMPING_SHARES)) if v > 0.0]
    start = replace(task,
                    drive=replace(task.drive, damping_law=law)).at({name_of(shaft, "half_gap"): seen.half_gap})
    return [start.at({name: v}) for v in dict.fromkeys(values)] if name in names and values else [start]


def _fit_of_law(starts: Sequence[Task], free: tuple[str, ...], names: set[str],
                near: Outcome | None = None) -> Outcome | None:
    """The fit of one law: gap and damping from every start, then all that is free from the likeliest ends.

    near  a fit of all that is free, one more
    """
    first = [o for start in starts if (o := _fit_or_none(start.with_free(names), 0)) is not None]
    if not first:
        return near
    best = min(o.fit.value for o in first)
    found = [_fit_or_none(o.fitted.with_free({*names, *free}), MAX_REPEATED_FITS, o.fit.noise)
             for o in first if o.fit.value < best + MAX_GAP_START_LOSS]
    return _likeliest_with_starts([o for o in (near, *found) if o is not None])


def _fit_or_none(task: Task, repeats: int, noise: Noise | None = None, wanted: float = np.inf) -> Outcome | None:
    """A fit from the task's values; None where it fails.

    repeats  fits, each from the end of the one before, until one converges
    wanted   -log likelihood to be reached: a fit far above it after a few rounds is given up
    """
    try:
        problem = task.problem()
        point = first_point(task.drive, problem, task.roles)
        fit = fit_innovations(problem, point, noise or fit_ratio(problem, point, Noise(1.0, None, problem.scale)),
                              near_optimum=noise is not None, wanted=wanted)
        if repeats and fit.value < wanted + ABANDON_EXCESS:
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


def gap_law_finding(laws: GapLaws, shaft: str, converged: bool = True) -> Finding:
    """Which law the record supports, with the results of each; converged: whether the reported fit converged."""
    evidence: dict[str, float] = {}
    drive = laws.outcome.drive
    units = [drive.unit(name_of(shaft, n)) for n in ("half_gap", "damping")]
    for law, o in laws.each.items():
        evidence |= {f"half_gap_{law}": o.drive.values[name_of(shaft, "half_gap")],
                     f"damping_{law}": o.drive.value(name_of(shaft, "damping")) or 0.0}
    law = drive.damping_law
    sizes = ", ".join(f"{name}: half gap {evidence[f'half_gap_{name}']:.4g} {units[0]}, damping "
                      f"{evidence[f'damping_{name}']:.3g} {units[1]}{'' if o.converged else ', not converged'}"
                      for name, o in laws.each.items())
    if laws.lead == float("inf"):
        return Finding(
            "note", "gap-law",
            f"Only one law could be fitted to this record: {LAW_DESCRIPTIONS[law]} ({sizes}).", evidence,
            "Record more passages through the gap.")
    # The shaft torque by "contact" has steps, which lie before or behind a sample: many optima stand side by side,
    # and no second start may reach the same. The law is seen nevertheless.
    if not converged and not (law == "contact" and laws.outcome.converged):
        return Finding(
            "note", "gap-law",
            f"The damping law of the gap is not identifiable: the fit did not converge ({sizes}).",
            evidence, "Give better start values with --set, or record more passages through the gap.")
    if laws.lead <= MIN_LAW_LEAD:
        tied = " or ".join(LAW_DESCRIPTIONS[name] for name in laws.tied)
        return Finding(
            "note", "gap-law", f"This record does not distinguish whether {tied} ({sizes}).",
            {**evidence, "log_likelihood_lead": laws.lead},
            "Record more passages through the gap, slow ones too: damping in the gap has its largest effect "
            "there.")
    return Finding(
        "note", "gap-law",
        f"This record supports one law: {LAW_DESCRIPTIONS[law]} (damping_law: {law}). Its log likelihood is higher "
        f"by {laws.lead:.0f} ({sizes}).", {**evidence, "log_likelihood_lead": laws.lead},
        "Keep damping_law in the parameter file.")


def gap_law_findings(laws: GapLaws | None, outcome: Outcome, free: Sequence[str],
                     converged: bool, opens: bool = True) -> list[Finding]:
    """Which law it is, and what was fitted besides the request.

    converged  whether the outcome converged; opens: whether the gap is above zero, else it has no law
    """
    if laws is None:
        return []
    more = [n for n in outcome.task.free if n not in free]
    if laws.seen is None and name_of(outcome.drive.shafts[0], "damping") not in more:  # the fit is as requested
        more = []
    law = [gap_law_finding(laws, outcome.drive.shafts[0], converged)] if opens else []
    return [*law, *([] if not more else [Finding(
        "note", "gap-refit",
        f"{', '.join(more)} were fitted jointly with the half gap. Over many passages, errors of one per cent in "
        "held values would bias it.", {"values": len(more)}, "Hold accurately known values with --hold.")])]


def dead_stretch_details(laws: GapLaws) -> dict[str, object]:
    """The estimates from the dead stretches, for comparison with the fit."""
    if laws.seen is None:
        return {}
    return {"dead_stretches": {"half_gap": laws.seen.half_gap, "spread": laws.seen.spread,
                               "damping_in_gap": laws.seen.open, "crossings": laws.seen.count}}
