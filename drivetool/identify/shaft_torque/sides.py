"""Friction of the two sides of a shaft whose torque was measured: never summed, told by the record or by a file.

A shaft torque tells what is lost before it from what is lost behind it. At speeds that hardly differ each side's
viscous friction still trades against its idle torque; then what an earlier step told of them stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import AT, TOTALS, Drive, shared
from drivetool.errors import Finding
from drivetool.identify.estimate import Z95, Covariance, Estimate, Parameter, covariance_of
from drivetool.identify.fit import SHARE, again, apart, size_of_idle, split_totals, with_totals
from drivetool.identify.laws import Explanation
from drivetool.identify.outcome import moved_with
from drivetool.identify.setup import Options, Outcome, Roles


def has_sides(drive: Drive, roles: Roles, options: Options) -> bool:
    """Whether each body has a side of a measured shaft to itself, and no sum was asked for."""
    named = {shared(n) for n in (*options.free, *options.hold, *(n for n in drive.values if AT in n))}
    return len(drive.bodies) == 2 and any(r.endswith("_torque") for r in roles.outputs) and not set(TOTALS) & named


def with_frictions(drive: Drive, roles: Roles, options: Options) -> Drive:
    """The drive with each body's friction, or with sums where no shaft torque tells the bodies apart."""
    return apart(drive) if has_sides(drive, roles, options) else with_totals(drive, (*options.free, *options.hold))


def friction_told(outcome: Outcome, before: Drive, options: Options, asked: Options) -> Outcome:
    """The outcome with the friction of each body as far as it is told: by this record, else by the file.

    Without a shaft torque a sum is parted where the record tells the parts.

    The viscous friction goes first: with it known the record may tell the idle torque by itself, which varies more
    from day to day.

    before  the drive with the file's values; asked: what was asked to be free stays free
    """
    if not has_sides(before, outcome.task.roles, asked):
        return split_totals(outcome, asked)
    for suffix in TOTALS.values() if options.known is not None and outcome.fit is not None else ():
        better = dict(zip(options.known.names, np.sqrt(np.diag(options.known.matrix)), strict=True))
        names = {n for n, std in _untold(outcome, before, suffix).items() if better.get(n, np.inf) < std}
        names -= set(asked.free)
        if names:
            task = outcome.task.at_point(outcome.solution.point).at({n: before.values[n] for n in sorted(names)})
            task = replace(task, free=tuple(n for n in task.free if n not in names))
            outcome = again(task, outcome.fit.noise)
    return outcome


def _untold(outcome: Outcome, before: Drive, suffix: str) -> dict[str, float]:
    """The free parts of a sum whose std by this record is above a third of what they are, and that std."""
    task = outcome.task
    covariance, inflation, _ = covariance_of(outcome.problem, outcome.solution)
    found = {}
    for j, name in enumerate(outcome.problem.names):
        if not name.endswith(f".{suffix}"):
            continue
        size = abs(before.value(name) or 0.0)
        if suffix == "idle_torque":
            size = max(size, size_of_idle(task))
        std = np.sqrt(covariance[j, j])
        if not (np.isfinite(std) and np.isfinite(inflation[j])):
            found[name] = np.inf
        elif std >= SHARE * size:
            found[name] = float(std)
    return found


def as_in_file(estimate: Estimate, outcome: Outcome, options: Options, free: Sequence[str],
               explanation: Explanation | None) -> Estimate:
    """The estimate with what the file told of friction that was to be fitted: its intervals, what goes with them.

    free  what was to be fitted; of it `friction_told` held what the record does not tell
    explanation  of which the outcome is the fit
    """
    found = moved_with(outcome, options.known) if has_sides(outcome.drive, outcome.task.roles, options) else None
    if found is None:
        return estimate
    moved, held = found
    names = {n for n in free if n not in outcome.task.free and n.endswith(tuple(TOTALS.values()))} & set(held.names)
    if not names:
        return estimate
    order = outcome.task.free
    if explanation is not None:
        moved, order = explanation.line @ moved, explanation.own.free
    stds = dict(zip(held.names, np.sqrt(np.diag(held.matrix)), strict=True))
    lines = tuple(_with_std(p, float(stds[p.name])) if p.name in names else p for p in estimate.parameters)
    covariance, told = estimate.covariance, [n for n in held.names if n in names]
    if covariance is not None:
        rows = [order.index(n) for n in covariance.names]
        columns = [held.names.index(n) for n in told]
        cross = (moved @ held.matrix)[np.ix_(rows, columns)]
        covariance = Covariance((*covariance.names, *told), np.block([
            [covariance.matrix, cross], [cross.T, held.matrix[np.ix_(columns, columns)]]]))
    note = Finding(
        "note", "friction-as-in-the-file",
        f"{', '.join(told)}: this record does not tell {'it' if len(told) == 1 else 'them'} to a third; what the "
        "file says stands, with its uncertainty in all intervals.", {n: float(stds[n]) for n in told},
        "Record steps about speeds that differ more, or hold each speed for longer.")
    findings = [f for f in estimate.findings if f.code != "held-values-dominate"]
    return replace(estimate, parameters=lines, covariance=covariance, findings=(*findings, note))


def _with_std(line: Parameter, std: float) -> Parameter:
    """A held value with its uncertainty."""
    return replace(line, std=std, ci95=(line.value - Z95 * std, line.value + Z95 * std),
                   reason="as in the file: this record does not tell it")
