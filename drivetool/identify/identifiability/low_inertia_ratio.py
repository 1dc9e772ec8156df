"""A low load inertia behind a gap, measured at the motor alone: what has to be fitted besides the half gap.

Such a load makes up a few per cent of the motor's torque. A record without gap then gives the load's inertia
and the stiffness to 5 or 15 % each, but the contacts in a record with gap are as precise as ever. With linear
parameters held at values a few per cent off, no half gap explains the contacts, and the likelihood prefers a
wrong one. The contacts identify the linear parameters ten times better. So these are fitted again together with
the gap, from starts drawn from their prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import TOTALS, Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance, Estimate, Verdict, masked
from drivetool.identify.setup import Options, Outcome, Roles, Task
from drivetool.quantity import name_of, names_of, quantity_of

# Load over motor inertia below which held linear parameters bias the half gap: simulated loads below 0.15 did.
MAX_LOW_INERTIA_RATIO = 0.2
# Relative step of a forward difference: rounding 1e-10, curvature 1e-6, both far below need
RATIO_DIFFERENCE_STEP = 1e-6


def load_inertia_ratio(drive: Drive) -> float:
    """Inertia of everything behind the motor, referred to the motor, over the motor's own."""
    referred = [inertia / n**2 for inertia, n in zip(drive.inertias(), drive.gear_ratios(), strict=True)]
    return float(sum(referred[1:]) / referred[0])


def has_low_inertia_ratio(drive: Drive, roles: Roles, std: float = 0.0) -> bool:
    """Whether the load's inertia is low, or two standard deviations lower, and only the motor is measured."""
    return load_inertia_ratio(drive) - 2.0 * std <= MAX_LOW_INERTIA_RATIO and all(
        role.startswith("motor") for role in roles.outputs)


def load_inertia_ratio_std(drive: Drive, known: Covariance) -> float:
    """Standard deviation of that ratio by the covariance of the given values."""
    share, slopes = load_inertia_ratio(drive), np.zeros(len(known.names))
    for j, name in enumerate(known.names):
        if quantity_of(name) == "inertia" and drive.values.get(name, 0.0) > 0.0:
            more = replace(drive, values={**drive.values, name: drive.values[name] * (1.0 + RATIO_DIFFERENCE_STEP)})
            slopes[j] = (load_inertia_ratio(more) - share) / (RATIO_DIFFERENCE_STEP * drive.values[name])
    return float(np.sqrt(slopes @ known.matrix @ slopes))


def with_uncertain_values_free(task: Task, options: Options) -> Task | None:
    """The task with those values free that have an uncertainty; None without such, or with a high load inertia.

    A value without uncertainty counts as known, unless no recording identifies it. Viscous friction is split over
    the bodies, unless its sum was requested: in the gap only the load's own part acts on the load.

    options  as requested, `all` not expanded
    """
    known = options.known
    if known is None or options.criterion not in ("auto", "innovations") or not has_low_inertia_ratio(
            task.drive, task.roles, load_inertia_ratio_std(task.drive, known)):
        return None
    drive, total, names = task.drive, "total.viscous", {*known.names, *options.unidentified}
    for whole, suffix in TOTALS.items():
        if names & {name_of(b, suffix) for b in drive.bodies}:
            names.add(whole)
    names = set(task.free) | {n for n in names if n in drive.values} - set(options.hold)
    if total in names and total not in options.free and total in drive.values:
        parts = drive.parts(total, max(drive.values[total], 0.0))
        drive, names = drive.with_values(parts), (names | set(parts)) - {total}
    linear = names_of(drive.bodies, "inertia") + names_of(drive.shafts, "stiffness")
    freed = replace(task, drive=drive).with_free(names)
    return freed if all(n in freed.free for n in linear) else None


def low_inertia(estimate: Estimate, outcome: Outcome, gaps: Sequence[str],
                again_free: Sequence[str] | None) -> Verdict:
    """What a low load inertia means for the half gaps.

    again_free  values that were held at first and fitted again; None: they stayed held. Then the half gap gets no
                interval: of simulated machines with a load below 0.15 of the motor three in three were wrong
    """
    drive = outcome.drive
    if again_free is None and not has_low_inertia_ratio(drive, outcome.task.roles):
        return Verdict()
    share = load_inertia_ratio(drive)
    opening = f"The load has only {100 * share:.0f} % of the motor's inertia"
    if again_free:
        return Verdict([Finding(
            "note", "gap-refit",
            f"{opening}: {', '.join(again_free)} were refitted jointly with the half gap. Errors of a few per cent "
            "in held values would bias it.", {"load_over_motor": share},
            "Hold accurately known values with --hold.")])
    if again_free is not None:
        return Verdict()
    return Verdict([Finding(
        "warning", "low-inertia-ratio",
        f"{opening}: the half gap is unreliable if only the motor is measured, and no interval is given.",
        {"load_over_motor": share},
        "Log the shaft torque or the load speed, or pass the parameter file of a greybox step with --params.")],
        masked(estimate, "the load's inertia is too low to identify it from the motor alone", None, gaps))
