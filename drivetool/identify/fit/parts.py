"""A sum of friction and its parts: when a record tells them apart, and from what shares a fit begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import GEARED, TOTALS
from drivetool.identify.estimate import covariance_of
from drivetool.identify.noise import Noise, excerpt, natural_ratio
from drivetool.identify.problem import Normal, Point, Problem, Solution, approach
from drivetool.identify.setup import Task, first_point
from drivetool.identify.starts import observers

IDLE = 0.03  # of the torque's rms, below which no idle torque is small
SHARE = 1.0 / 3.0  # of the sum, that the standard deviation of each part must be below
LOOK = 8000  # samples by which the shares are found
HOT = (1.0, 0.1)  # torque noise of the observers there, over that which moves the output by its sensor noise
ROUNDS = 5  # of each


def parted(task: Task, total: str) -> list[tuple[Task, tuple[str, ...]]]:
    """(the task with the parts of a sum free; their names), the finest first.

    As the rule of the sum shares it out among all bodies; of a longer chain also what the motor has and what is
    behind its shaft, that on the last body: a shaft torque sensor tells these two, and none the others.
    """
    drive, suffix = task.drive, TOTALS[total]
    whole, bodies = drive.values[total], drive.bodies
    shared = drive.parts(total, whole)
    first, last = f"{bodies[0]}.{suffix}", f"{bodies[-1]}.{suffix}"
    ends = dict.fromkeys(shared, 0.0) | {
        first: shared[first], last: (whole - shared[first]) * drive.turns()[-1] ** GEARED[suffix]}
    found = []
    for values, parts in [(shared, tuple(shared)), *([(ends, (first, last))] if len(bodies) > 2 else [])]:
        values = {p: max(v, drive.quantity(p).bounds[0]) for p, v in values.items()}
        free = tuple(n for n in drive.quantities if n in {*task.free, *parts} - {total})
        found.append((replace(task, drive=drive.with_values(values), free=free), parts))
    return found


def told_apart(task: Task, problem: Problem, point: Point, normal: Normal, parts: Sequence[str],
               whole: float) -> bool:
    """Whether the predicted std of each part, as the motor feels it, is below a third of the sum.

    Idle torques that cancel are told as well as others, though their sum is nothing: a small share of the torque
    counts for it.

    task    with the parts free; whole: the sum
    normal  equations at the point
    """
    drive, size = task.drive, max(abs(whole), 1e-12)
    if parts[0].endswith(".idle_torque"):
        size = max(size, size_of_idle(task))
    covariance, inflation, _ = covariance_of(
        replace(problem, low=np.full_like(problem.low, -np.inf)), Solution(point, normal, 0, True))
    index = [problem.names.index(p) for p in parts]
    with np.errstate(invalid="ignore"):
        std = np.sqrt(np.diag(covariance)[index]) * [drive.felt_share(p) for p in parts]
    return bool(np.all(np.isfinite(std)) and np.all(np.isfinite(inflation[index]))
                and np.all(std < size * SHARE))


def size_of_idle(task: Task) -> float:
    """Torque below which an idle torque is a small one."""
    torque = np.concatenate([e.signals[task.roles.inputs[0]] for e in task.experiments])
    return IDLE * float(np.sqrt(np.nanmean(torque**2)))


def shared_out(whole: Task, task: Task) -> Task:
    """A task at the values of one with sums in place of its parts: shares as a first look at the record has them.

    All but the frictions stays as it was. A start by rule alone can be far off: a motor with a dry gear and a
    load on good bearings is no rare drive.
    """
    drive = whole.drive
    for total in TOTALS:
        if total in whole.free and total not in task.free:
            drive = drive.with_values({p: max(v, drive.quantity(p).bounds[0])
                                       for p, v in drive.parts(total, drive.values[total]).items()})
    begun = replace(task, drive=drive)
    hold = np.array([not n.endswith(tuple(f".{suffix}" for suffix in GEARED)) for n in task.free])
    problem, linear = excerpt(begun.problem(), LOOK), excerpt(begun.linear_problem(), LOOK)
    point = first_point(drive, problem, task.roles)
    for share in HOT:
        ratio = share * natural_ratio(problem, point)
        gains = observers(problem, linear, point, Noise(ratio, None, problem.scale, ratio))
        point, _ = approach(problem, point, gains, ROUNDS, hold=hold)
    return begun.at_point(point)
