"""Friction of the two sides of a shaft whose torque was measured: never summed, from the record or from a file.

A shaft torque separates the losses before it from those behind it. At speeds that hardly differ each side's viscous
friction is still collinear with its idle torque; then the estimate of an earlier step stands.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive import TOTALS, Drive
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance, Estimate, Verdict, covariance_of
from drivetool.identify.fit import (
    MAX_PART_STD_SHARE,
    refit,
    small_idle_torque,
    split_totals,
    with_friction_parts,
    with_totals,
)
from drivetool.identify.laws import Explanation
from drivetool.identify.outcome import held_value_sensitivity
from drivetool.identify.setup import Options, Outcome, Roles
from drivetool.quantity import quantity_of, record_of, shared


def has_sides(drive: Drive, roles: Roles, options: Options) -> bool:
    """Whether each body has a side of a measured shaft to itself, and no sum was requested."""
    named = {shared(n) for n in (*options.free, *options.hold, *(n for n in drive.values if record_of(n)))}
    return len(drive.bodies) == 2 and any(r.endswith("_torque") for r in roles.outputs) and not set(TOTALS) & named


def with_frictions(drive: Drive, roles: Roles, options: Options) -> Drive:
    """The drive with each body's friction, or with sums where no shaft torque separates the bodies."""
    return with_friction_parts(drive) if has_sides(drive, roles,
                                                   options) else with_totals(drive, options.free, options.hold)


def with_identified_friction(outcome: Outcome, before: Drive, options: Options, requested: Options) -> Outcome:
    """The outcome with the friction of each body as far as it is identified: from this record, else from the file.

    Without a shaft torque a sum is split where the record identifies the parts.

    The viscous friction goes first: with it known the record may identify the idle torque, which varies more from
    day to day.

    before  the drive with the file's values; requested: parameters requested to be free stay free
    """
    if not has_sides(before, outcome.task.roles, requested):
        return split_totals(outcome, requested)
    for suffix in TOTALS.values() if options.known is not None and outcome.fit is not None else ():
        prior_stds = dict(zip(options.known.names, np.sqrt(np.diag(options.known.matrix)), strict=True))
        unidentified = _unidentified_parts(outcome, before, suffix)
        if names := {n for n, std in unidentified.items() if prior_stds.get(n, np.inf) < std} - {*requested.free}:
            task = outcome.fitted.at({n: before.values[n] for n in sorted(names)})
            outcome = refit(task.with_held(names), outcome.fit.noise)
    return outcome


def _unidentified_parts(outcome: Outcome, before: Drive, suffix: str) -> dict[str, float]:
    """The free parts of a sum whose std by this record is above a third of what they are, and that std."""
    task = outcome.task
    covariance, inflation, _ = covariance_of(outcome.problem, outcome.solution)
    found = {}
    for j, name in enumerate(outcome.problem.names):
        if quantity_of(name) != suffix:
            continue
        size = abs(before.value(name) or 0.0)
        if suffix == "idle_torque":
            size = max(size, small_idle_torque(task))
        std = np.sqrt(covariance[j, j])
        if not (np.isfinite(std) and np.isfinite(inflation[j])):
            found[name] = np.inf
        elif std >= MAX_PART_STD_SHARE * size:
            found[name] = float(std)
    return found


def friction_of_file(estimate: Estimate, outcome: Outcome, options: Options, free: Sequence[str],
                     explanation: Explanation | None) -> Verdict:
    """The file's values, intervals and covariances of friction that was to be fitted.

    free  parameters to be fitted; of these `with_identified_friction` held what the record does not identify
    explanation  of which the outcome is the fit
    """
    found = held_value_sensitivity(outcome, options.known) if has_sides(outcome.drive, outcome.task.roles,
                                                                        options) else None
    if found is None:
        return Verdict()
    moved, held = found
    names = {n for n in free if n not in outcome.task.free and quantity_of(n) in TOTALS.values()} & set(held.names)
    if not names:
        return Verdict()
    order = outcome.task.free
    if explanation is not None:
        moved, order = explanation.line @ moved, explanation.own.free
    stds = dict(zip(held.names, np.sqrt(np.diag(held.matrix)), strict=True))
    reason = "as in the file: this record does not identify it"
    lines = [p.with_interval(float(stds[p.name])).replace(reason=reason) for p in estimate.parameters
             if p.name in names]
    covariance, from_file = estimate.covariance, [n for n in held.names if n in names]
    if covariance is not None:
        rows = [order.index(n) for n in covariance.names]
        cross = (moved @ held.matrix)[np.ix_(rows, [held.names.index(n) for n in from_file])]
        covariance = Covariance((*covariance.names, *from_file), np.block([
            [covariance.matrix, cross], [cross.T, held.part(from_file).matrix]]))
    note = Finding(
        "note", "friction-from-prior",
        f"{', '.join(from_file)}: the standard deviation from this record exceeds a third of the value. The value "
        "of the parameter file is kept, and all intervals include its uncertainty.",
        {n: float(stds[n]) for n in from_file},
        "Record steps about speeds that differ more, or hold each speed for longer.")
    return Verdict([note], lines, covariance=covariance, replaces=["held-values-dominate"])
