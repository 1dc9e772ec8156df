"""A light load behind a gap, seen from the motor alone: what has to be fitted besides the half gap.

The motor feels such a load by some per cent of its own torque. A record without gap then gives the
load's inertia and the stiffness to 5 or 15 % each, but the contacts in a record with gap are as sharp as
ever: with linear parameters held at values a few per cent off no half gap explains them, and the
likelihood prefers a wrong one. The contacts tell the linear parameters ten times better, so they are
fitted again together with the gap, from starts drawn from what was known of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import TOTALS, Drive
from drivetool.errors import Finding
from drivetool.identify.estimate import Covariance, Estimate
from drivetool.identify.fit import by_innovations
from drivetool.identify.setup import Options, Outcome, Roles, Task
from drivetool.identify.starts import from_known

LIGHT = 0.2  # load over motor inertia below which held linear parameters mislead
TINY = 1e-6  # relative step of a difference


def load_share(drive: Drive) -> float:
    """Inertia of everything behind the motor over the motor's own, as it is felt at the motor."""
    referred = [inertia / n**2 for inertia, n in zip(drive.inertias(), drive.turns(), strict=True)]
    return float(sum(referred[1:]) / referred[0])


def is_light(drive: Drive, roles: Roles) -> bool:
    """Whether the load is light and only the motor is measured."""
    return load_share(drive) <= LIGHT and all(role.startswith("motor") for role in roles.outputs)


def may_be_light(drive: Drive, roles: Roles, known: Covariance) -> bool:
    """The same, as far as is known: two standard deviations of the share down."""
    share, slopes = load_share(drive), np.zeros(len(known.names))
    for j, name in enumerate(known.names):
        if name.endswith(".inertia") and drive.values.get(name, 0.0) > 0.0:
            more = replace(drive, values={**drive.values, name: drive.values[name] * (1.0 + TINY)})
            slopes[j] = (load_share(more) - share) / (TINY * drive.values[name])
    std = float(np.sqrt(slopes @ known.matrix @ slopes))
    return share - 2.0 * std <= LIGHT and all(role.startswith("motor") for role in roles.outputs)


def loosened(task: Task, options: Options) -> Task | None:
    """The task with the values free that came with an uncertainty; None if it is no light load or has none.

    A value without uncertainty counts as known. Viscous friction is shared out, unless its sum was asked for: in
    the gap the load is alone with its part.

    options  as they were asked for, `all` not spelled out
    """
    known = options.known
    by_innovations = options.criterion in ("auto", "innovations")
    if known is None or not by_innovations or not may_be_light(task.drive, task.roles, known):
        return None
    drive, total, names = task.drive, "total.viscous", set(known.names)
    for whole, suffix in TOTALS.items():
        if names & {f"{b}.{suffix}" for b in drive.bodies}:
            names.add(whole)
    names = set(task.free) | {n for n in names if n in drive.values} - set(options.hold)
    if total in names and total not in options.free and total in drive.values:
        parts = drive.parts(total, max(drive.values[total], 0.0))
        drive, names = drive.with_values(parts), (names | set(parts)) - {total}
    free = tuple(n for n in drive.quantities if n in names)
    loose = replace(task, drive=drive, free=free)
    return None if linear_held(loose) else loose


def fit_light(task: Task, known: Covariance, options: Options) -> Outcome:
    """Innovations fit of a loosened task."""
    return by_innovations(task, [{}], options.seed, options.starts, from_known(known))


def linear_held(task: Task) -> bool:
    """Whether an inertia or a stiffness keeps its value."""
    names = [f"{b}.inertia" for b in task.drive.bodies] + [f"{s}.stiffness" for s in task.drive.shafts]
    return any(n not in task.free for n in names)


def judged(estimate: Estimate, outcome: Outcome, gaps: Sequence[str], again_free: Sequence[str] | None) -> Estimate:
    """What is to be said about a light load.

    again_free  values that were held at first and fitted again; None: the values were not loosened. Then the
                half gap gets no interval: of simulated machines with a load below 0.15 of the motor three
                in three came out wrong
    """
    drive = outcome.drive
    if again_free is None and not is_light(drive, outcome.task.roles):
        return estimate
    share, lines, finding = load_share(drive), estimate.parameters, None
    told = f"The load has only {100 * share:.0f} % of the motor's inertia"
    if again_free:
        finding = Finding(
            "note", "fitted-again",
            f"{told}: {', '.join(again_free)} were fitted again together with the half gap, since held values a "
            "few per cent off would lead to a wrong one.", {"load_over_motor": share},
            "Hold what is known for sure with --hold.")
    elif again_free is None:
        reason = "the load is too light to be judged from the motor alone"
        lines = tuple(replace(p, std=None, ci95=None, reason=reason)
                      if p.name in gaps and p.status == "fitted" else p for p in lines)
        finding = Finding(
            "warning", "light-load",
            f"{told}: from the motor alone its half gap cannot be relied on, and no interval is given.",
            {"load_over_motor": share},
            "Log the shaft torque or the load speed, or pass the parameter file of a greybox step with --params.")
    more = () if finding is None else (finding,)
    return replace(estimate, parameters=lines, findings=(*estimate.findings, *more))
