"""Values that a record tells together only: an interval of one of them by itself would be none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive.chain import TOTALS, Drive
from drivetool.identify.estimate import Covariance, Parameter
from drivetool.identify.setup import reverses
from drivetool.identify.task import Task


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


def _one_way(lines: Sequence[Parameter], task: Task, known: Sequence[str]) -> tuple[Parameter, ...]:
    """Idle torque beside a Coulomb friction that was held at a rough value, where the motor turns one way only."""
    drive = task.drive
    held = [n for n in (f"{b}.coulomb" for b in drive.bodies)
            if (drive.value(n) or 0.0) > 0.0 and n not in task.free and n not in known]
    if not held or any(reverses(e) for e in task.experiments):
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
