"""Values that a record tells together only: an interval of one of them by itself would be none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import TOTALS, Drive, is_constant
from drivetool.errors import Finding
from drivetool.identify.estimate import Covariance, Parameter
from drivetool.identify.problem import schur
from drivetool.identify.setup import Outcome, Task, reverses

ROUNDING = 1e-9  # of sums of products that cancel


def told_together(lines: Sequence[Parameter], covariance: Covariance | None, task: Task, known: Covariance | None,
                  ) -> tuple[tuple[Parameter, ...], Covariance | None]:
    """The lines and their covariance without the intervals that hold for a sum only, which the reason states.

    task   at the estimate
    known  covariance of the values that were given: a friction of known uncertainty is in the intervals already
    """
    lines = _one_way(lines, task, () if known is None else known.names)
    lines = tuple(_behind_the_shaft(p, task) for p in lines)
    untold = {p.name for p in lines if p.std is None}
    if covariance is not None and untold & set(covariance.names):
        index = [i for i, n in enumerate(covariance.names) if n not in untold]
        covariance = Covariance(tuple(covariance.names[i] for i in index),
                                covariance.matrix[np.ix_(index, index)]) if index else None
    return lines, covariance


def only_ratios(outcome: Outcome) -> bool:
    """Whether the record tells torques over each other only: none acts on the drive whose size is known.

    Then all inertias, stiffnesses and frictions may be multiplied by one number and nothing changes.
    """
    problem, point, drive = outcome.problem, outcome.solution.point, outcome.drive
    torques = np.array([_of_torque(n, drive) for n in problem.names], bool)
    held = [n for n, v in drive.values.items()
            if v and n not in problem.names and _of_torque(n, drive) and not is_constant(n)]
    if held or not torques.any():
        return False
    # By free runs: frozen gains turn a torque noise of absolute size into knowledge of the scale.
    normal = replace(problem, memory=None).normal(point)
    matrix, _, _ = schur(normal)
    scale = np.where(torques, point.values, 0.0)
    variance = normal.cost / max(problem.count - problem.unknowns, 1)
    told, rounding = scale @ matrix @ scale, ROUNDING * (np.abs(scale) @ np.abs(matrix) @ np.abs(scale))
    return bool(told < max(variance, rounding))


def _of_torque(name: str, drive: Drive) -> bool:
    """Whether a parameter is measured in torques, alone or over motions."""
    return drive.quantity(name).unit.startswith("{T}")


def without_sizes(lines: Sequence[Parameter], outcome: Outcome) -> tuple[tuple[Parameter, ...], Finding]:
    """The lines without an interval of any torque, and what to say."""
    torques = {n for n in outcome.task.free if _of_torque(n, outcome.drive)}
    found = tuple(p.untold("only its ratio to the other torques is told: no torque of known size acts",
                           "not-identifiable") if p.name in torques else p for p in lines)
    return found, Finding(
        "warning", "not-identifiable",
        f"{', '.join(sorted(torques))} can be told from this record over each other only: no torque of known size "
        "acts.", {}, "Record while the motor drives, or hold one of them at a known value with --hold.",
        next((p.name for p in lines if {p.name} == torques), None))


def _one_way(lines: Sequence[Parameter], task: Task, known: Sequence[str]) -> tuple[Parameter, ...]:
    """Idle torque beside a Coulomb friction that was held at a rough value, where the motor turns one way only."""
    drive = task.drive
    held = [n for n in (f"{b}.coulomb" for b in drive.bodies)
            if (drive.value(n) or 0.0) > 0.0 and n not in task.free and n not in known]
    if not held or reverses(task.experiments):
        return tuple(lines)
    return tuple(replace(
        p, std=None, ci95=None,
        reason=f"told only together with {' and '.join(held)}, held at {drive.felt('coulomb'):.4g} as the motor "
               f"feels it; std of the two together {p.std:.2g}")
        if p.name.endswith("idle_torque") and p.std is not None else p for p in lines)


def _behind_the_shaft(line: Parameter, task: Task) -> Parameter:
    """A line of a chain of which the motor's friction is told, and that behind its shaft is on the last body."""
    body, _, suffix = line.name.partition(".")
    drive, between = task.drive, task.drive.bodies[1:-1]
    if suffix not in TOTALS.values() or body == drive.bodies[0] or not on_the_last(drive, task.free, suffix):
        return line
    last, others = drive.bodies[-1], " and ".join(between)
    if body in between and line.std is None:
        return replace(line, reason=f"counted with {last}: the record does not tell them apart")
    if body == last and line.std is not None:
        return replace(line, std=None, ci95=None, reason=f"with that of {others}, which the record does not tell "
                                                         f"from it; std of all together {line.std:.2g}")
    return line


def on_the_last(drive: Drive, free: Sequence[str], suffix: str) -> bool:
    """Whether what is behind the motor's shaft is fitted as one, on the last body."""
    if len(drive.bodies) < 3:
        return False
    first, *between, last = (f"{b}.{suffix}" for b in drive.bodies)
    return {first, last} <= set(free) and not any(n in free or drive.value(n) for n in between)
