"""A friction sum and its parts: when they are separately identifiable, and the shares a fit starts from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import GEAR_RATIO_EXPONENTS, TOTALS
from drivetool.identify.estimate import covariance_of
from drivetool.identify.noise import Noise, first_samples_of, unit_noise_ratio
from drivetool.identify.problem import Normal, Point, Problem, Solution, take_steps
from drivetool.identify.setup import Task, first_point
from drivetool.identify.starts import frozen_observers
from drivetool.quantity import name_of, quantity_of

# Scale of an idle torque at least, over the torque's rms. A choice: idle torques may cancel; their sum is no scale.
MIN_IDLE_SHARE = 0.03
# Of the sum, for the standard deviation of each part. A choice: a third separates a part from zero by 3 sigma.
MAX_PART_STD_SHARE = 1.0 / 3.0
# Samples for the initial shares. A choice: enough for start values, a fraction of a fit's time
SHARES_SAMPLES = 8000
# Torque noise of the observers there, over that which moves the output by its sensor noise: high first, for wide
# convergence, then a tenth.
SHARES_NOISE_FACTORS = (1.0, 0.1)
SHARES_STEPS = 5  # Gauss-Newton steps with each observer. A choice: start values need no convergence


def tasks_with_parts(task: Task, total: str) -> list[tuple[Task, tuple[str, ...]]]:
    """(the task with the parts of a sum free; their names), the finest first.

    The sum is split among all bodies by its rule. A longer chain also has the motor's part and a lumped part on the
    last body: with a shaft torque sensor only these two are identifiable.
    """
    drive, suffix = task.drive, TOTALS[total]
    whole, bodies = drive.values[total], drive.bodies
    shared = drive.parts(total, whole)
    first, last = name_of(bodies[0], suffix), name_of(bodies[-1], suffix)
    ends = dict.fromkeys(shared, 0.0) | {
        first: shared[first],
        last: (whole - shared[first]) * drive.gear_ratios()[-1] ** GEAR_RATIO_EXPONENTS[suffix]}
    found = []
    for values, parts in [(shared, tuple(shared)), *([(ends, (first, last))] if len(bodies) > 2 else [])]:
        values = {p: max(v, drive.quantity(p).bounds[0]) for p, v in values.items()}
        split = replace(task, drive=drive.with_values(values))
        found.append((split.with_free({*task.free, *parts} - {total}), parts))
    return found


def parts_identifiable(task: Task, problem: Problem, point: Point, normal: Normal, parts: Sequence[str],
                       whole: float) -> bool:
    """Whether the predicted std of each part, referred to the motor, is below a third of the sum.

    Idle torques that cancel are as identifiable as others, though their sum is zero: a small share of the torque
    replaces it.

    task    with the parts free; whole: the sum
    normal  equations at the point
    """
    drive, size = task.drive, max(abs(whole), 1e-12)
    if quantity_of(parts[0]) == "idle_torque":
        size = max(size, small_idle_torque(task))
    covariance, inflation, _ = covariance_of(
        replace(problem, low=np.full_like(problem.low, -np.inf)), Solution(point, normal, 0, True))
    index = [problem.names.index(p) for p in parts]
    with np.errstate(invalid="ignore"):
        std = np.sqrt(np.diag(covariance)[index]) * [drive.referred_share(p) for p in parts]
    return bool(np.all(np.isfinite(std)) and np.all(np.isfinite(inflation[index]))
                and np.all(std < size * MAX_PART_STD_SHARE))


def small_idle_torque(task: Task) -> float:
    """Torque below which an idle torque is a small one."""
    torque = np.concatenate([e.signals[task.roles.inputs[0]] for e in task.experiments])
    return MIN_IDLE_SHARE * float(np.sqrt(np.nanmean(torque**2)))


def with_initial_shares(whole: Task, task: Task) -> Task:
    """A task at the values of one with sums in place of its parts: shares from a first approximate fit.

    All but the frictions stays. A split by rule alone can be far off: a motor with a dry gear and a load on good
    bearings is a common drive.
    """
    drive = whole.drive
    for total in TOTALS:
        if total in whole.free and total not in task.free:
            drive = drive.with_values({p: max(v, drive.quantity(p).bounds[0])
                                       for p, v in drive.parts(total, drive.values[total]).items()})
    prepared = replace(task, drive=drive)
    hold = np.array([quantity_of(n) not in GEAR_RATIO_EXPONENTS for n in task.free])
    problem, linear = (first_samples_of(prepared.problem(), SHARES_SAMPLES),
                       first_samples_of(prepared.linear_problem(), SHARES_SAMPLES))
    point = first_point(drive, problem, task.roles)
    for share in SHARES_NOISE_FACTORS:
        ratio = share * unit_noise_ratio(problem, point)
        gains = frozen_observers(problem, linear, point, Noise(ratio, None, problem.scale, ratio))
        point, _ = take_steps(problem, point, gains, SHARES_STEPS, hold=hold)
    return prepared.at_point(point)
