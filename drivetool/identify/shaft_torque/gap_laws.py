"""Both published laws of a gap with damping, where a shaft torque was measured: which the record is of.

"inside": the damping belongs to the contact, which then never pulls. "always": it acts in the gap too. Across many
passages a fit finds its way only from close by: half gap and damping begin where the dead stretches of the shaft
torque have them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from drivetool.drive import AT, DampingLaw, is_constant
from drivetool.errors import DriveToolError, Finding
from drivetool.identify.noise import Noise, fit_innovations, fit_ratio, settle, until_settled
from drivetool.identify.setup import Options, Outcome, Task, first_point
from drivetool.identify.shaft_torque.dead_stretches import Crossings, crossings
from drivetool.identify.starts import apart

TOLD = 7.0  # log likelihood by which one law must lead: odds of a thousand to one
SHARES = (0.6, 1.0, 1.6)  # of the contact's damping at which a fit begins: the dead stretches tell it to a third
MORE = 4  # fits in a row, until one settles
HOPEFUL = 300.0  # log likelihood behind the likeliest start from which a fit may still end as well
WORDS = {"inside": "the damping belongs to the contact", "always": "the shaft is damped in its gap too"}


@dataclass(frozen=True)
class BothLaws:
    """What came of both laws: the better outcome; of each law its outcome; what dead stretches told, if any."""

    outcome: Outcome
    each: Mapping[str, Outcome]
    seen: Crossings | None

    @property
    def lead(self) -> float:
        """Log likelihood of the outcome's law over the other, below zero if it is behind; infinite without one."""
        others = [_value(o) for law, o in self.each.items() if law != self.outcome.drive.damping_law]
        return others[0] - _value(self.outcome) if others else float("inf")


def both_laws(task: Task, options: Options) -> BothLaws | None:
    """The fits of both laws from what the dead stretches tell; None: they tell nothing, or no fit settled.

    The shaft damping is freed with the gap, unless it was asked to be held: with the gap closed another one acts.
    So are values that came with an uncertainty: over many passages one per cent of them leads astray.

    task  with one half gap free
    """
    if len(task.drive.shafts) != 1 or options.criterion not in ("auto", "innovations"):
        return None
    shaft = task.drive.shafts[0]
    if f"{shaft}.half_gap" not in task.free or any(AT in n for n in (*task.free, *task.drive.values)):
        return None
    seen = crossings(task)
    if not seen:
        return None
    names = {f"{shaft}.half_gap", f"{shaft}.damping"} - set(options.hold)
    loose = [] if options.known is None else [
        n for n in options.known.names if n in task.drive.values and n not in options.hold and not is_constant(n)]
    each: dict[str, Outcome] = {}
    for law in get_args(DampingLaw):
        starts = [start for one in seen for start in _starts(task, shaft, law, one, names)]
        if (found := _by_law(starts, (*task.free, *loose), names)) is not None:
            each[law] = found
    settled = [o for o in each.values() if o.converged]
    if not settled:
        return None
    best = min(settled, key=_value)
    own = each.get(task.drive.damping_law)
    both = BothLaws(best, each, seen[0])
    # Where the record does not tell, the law of the file stays, if its fit settled.
    return replace(both, outcome=own) if own is not None and own.converged and both.lead <= TOLD else both


def both_laws_from(outcome: Outcome, options: Options) -> BothLaws | None:
    """The fits of both laws from where one of them led, where the motor alone was measured.

    The shaft damping is free in both, unless it was asked to be held. None: no single gap that was fitted, no
    damping, or a fit that did not settle.

    outcome  of the drive's own law, whatever was free
    """
    task = outcome.task.at_point(outcome.solution.point)
    shafts = task.drive.shafts
    gap, damping = f"{shafts[0]}.half_gap", f"{shafts[0]}.damping"
    if len(shafts) != 1 or options.criterion not in ("auto", "innovations") or outcome.fit is None \
            or not outcome.converged or gap not in task.free or not task.drive.value(damping) \
            or not task.drive.value(gap) or any(AT in n for n in (*task.free, *task.drive.values)):
        return None
    names = {*task.free, damping} - set(options.hold)
    free = tuple(n for n in task.drive.quantities if n in names)
    each: dict[str, Outcome] = {}
    for law in get_args(DampingLaw):
        begun = replace(task, free=free, drive=replace(task.drive, damping_law=law))
        if (found := _tried(begun, MORE, outcome.fit.noise)) is not None and found.converged:
            each[law] = found
    own = task.drive.damping_law
    if own not in each:
        return None
    best = min(each.values(), key=_value)
    both = BothLaws(best, each, None)
    # Where the record does not tell, or the damping did not matter, the fit that was made stays.
    return both if best.drive.damping_law != own and both.lead > TOLD else replace(both, outcome=each[own])


def _starts(task: Task, shaft: str, law: DampingLaw, seen: Crossings, names: set[str]) -> list[Task]:
    """The task under a law with the gap, and the damping if it is free, where a fit is to begin."""
    name = f"{shaft}.damping"
    first = [seen.open] if law == "always" else []
    values = [v for v in (*first, *(share * seen.closed for share in SHARES)) if v > 0.0]
    begun = replace(task, drive=replace(task.drive, damping_law=law)).at({f"{shaft}.half_gap": seen.half_gap})
    return [begun.at({name: v}) for v in dict.fromkeys(values)] if name in names and values else [begun]


def _by_law(starts: Sequence[Task], free: tuple[str, ...], names: set[str]) -> Outcome | None:
    """The fit of one law: gap and damping from every start, then all that is free from the likeliest ends."""
    order = starts[0].drive.quantities
    first = [o for start in starts if (o := _tried(
        replace(start, free=tuple(n for n in order if n in names)), 0)) is not None]
    if not first:
        return None
    best = min(map(_value, first))
    rest, found = tuple(n for n in order if n in {*names, *free}), []
    for o in first:
        if _value(o) < best + HOPEFUL:
            task = replace(o.task.at_point(o.solution.point), free=rest)
            found.append(_tried(task, MORE, o.fit.noise if o.fit is not None else None))
    return _with_starts([o for o in found if o is not None])


def _tried(task: Task, more: int, noise: Noise | None = None) -> Outcome | None:
    """A fit from the task's values; None where it fails.

    more  fits, each from where the one before was stopped, until one settles
    """
    try:
        problem = task.problem()
        point = first_point(task.drive, problem, task.roles)
        fit = fit_innovations(problem, point, noise or fit_ratio(problem, point, Noise(1.0, None, problem.scale)),
                              arrived=noise is not None)
        if more:
            fit = settle(problem, until_settled(problem, fit, more))
    except (DriveToolError, np.linalg.LinAlgError):
        return None
    return Outcome(task, problem, fit.solution, fit, (), fit.converged)


def _with_starts(found: Sequence[Outcome]) -> Outcome | None:
    """The likeliest outcome that settled, with where each start led: of one on its way the noise is not its own."""
    if not found:
        return None
    best = min([o for o in found if o.converged] or found, key=_value)
    starts = tuple({
        "way": "dead stretches", "minus_log_likelihood_above_best": max(_value(o) - _value(best), 0.0),
        "apart": apart(best.problem, best.solution, o.solution),
        "reached": dict(zip(o.task.free, map(float, o.solution.point.values), strict=True))} for o in found)
    return replace(best, starts=starts)


def _value(outcome: Outcome) -> float:
    return outcome.fit.value if outcome.fit is not None else float("inf")


def law_told(both: BothLaws, shaft: str, settled: bool = True) -> Finding:
    """Which law the record is of, with both results; settled: whether the fit that is reported did."""
    evidence: dict[str, float] = {}
    drive = both.outcome.drive
    units = [drive.unit(f"{shaft}.{n}") for n in ("half_gap", "damping")]
    for law, o in both.each.items():
        evidence |= {f"half_gap_{law}": o.drive.values[f"{shaft}.half_gap"],
                     f"damping_{law}": o.drive.value(f"{shaft}.damping") or 0.0}
    law = drive.damping_law
    sizes = ", ".join(f"{name}: half gap {evidence[f'half_gap_{name}']:.4g} {units[0]}, damping "
                      f"{evidence[f'damping_{name}']:.3g} {units[1]}{'' if o.converged else ', not settled'}"
                      for name, o in both.each.items())
    if both.lead == float("inf"):
        return Finding(
            "note", "gap-law-undetermined",
            f"Only the law by which {WORDS[law]} could be fitted to this record ({sizes}).", evidence,
            "Record more passages through the gap.")
    if not settled:
        return Finding(
            "note", "gap-law-undetermined",
            f"The fit did not settle, and so does not tell which law of the gap this record is of ({sizes}).",
            evidence, "Start nearer with --set, or record more passages through the gap.")
    if both.lead <= TOLD:
        return Finding(
            "note", "gap-law-undetermined",
            f"Whether {WORDS['inside']} or {WORDS['always']} this record does not tell ({sizes}).",
            {**evidence, "log_likelihood_lead": both.lead},
            "Record more passages through the gap, slow ones too: there damping in the gap takes the most.")
    return Finding(
        "note", "gap-law", f"By this record {WORDS[law]} (damping_law: {law}): log likelihood {both.lead:.0f} "
        f"above the other law ({sizes}).", {**evidence, "log_likelihood_lead": both.lead},
        "Keep damping_law in the parameter file.")


def laws_told(both: BothLaws | None, outcome: Outcome, free: Sequence[str], settled: bool) -> list[Finding]:
    """Which law it is, and what was fitted besides what was asked for; settled: whether the outcome did."""
    if both is None:
        return []
    more = [n for n in outcome.task.free if n not in free]
    if both.seen is None and f"{outcome.drive.shafts[0]}.damping" not in more:  # the fit is as it was asked for
        more = []
    return [law_told(both, outcome.drive.shafts[0], settled), *([] if not more else [Finding(
        "note", "fitted-again",
        f"{', '.join(more)} were fitted together with the half gap: over many passages held values a per cent off "
        "would lead to a wrong one.", {"values": len(more)}, "Hold what is known for sure with --hold.")])]


def details_of(both: BothLaws) -> dict[str, object]:
    """What the dead stretches told, beside what was fitted."""
    if both.seen is None:
        return {}
    return {"dead_stretches": {"half_gap": both.seen.half_gap, "spread": both.seen.spread,
                               "damping_in_gap": both.seen.open, "crossings": both.seen.count}}
