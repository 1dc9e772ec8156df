"""Detection limit of a cause: the standard deviation of its size on a record without it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from drivetool.check.causes import Cause
from drivetool.check.fit import FIT_ERRORS, Model, amplitude_std, linear_step, on_task
from drivetool.check.starts import largest_torque
from drivetool.identify.noise import filtered_normal_equations
from drivetool.identify.problem import Normal, Point
from drivetool.quantity import owner_of, quantity_of

# Standard deviations at the base that an amplitude needs to be detected: half their square, 18, is the lead in log
# likelihood at which the evidence after the price of the search (`neg_log_p_corrected`) reaches a hundred.
DETECTION_STDS = 6.0


def detection_limits(base: Model, cause: Cause, per_start: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Size -> its standard deviation at a base; infinite for a torque above the largest motor torque.

    per_start  standard deviations of the amplitudes of each start; of several speeds, orders or instants the median
               counts
    """
    stds: dict[str, list[float]] = {}
    for start in per_start:
        for name, std in start.items():
            stds.setdefault(name, []).append(std)
    found = {n: float(np.quantile(s, 0.5, method="lower")) for n, s in stds.items()} or _trace_stds(cause, base)
    drive = base.task.drive
    return {n: np.inf if drive.unit(n) == drive.torque_unit and DETECTION_STDS * std > largest_torque(
        base, owner_of(n)) else std for n, std in found.items()}


def detection_limits_with_cause(cause: Cause, before: Mapping[str, float], model: Model,
                                base: Model) -> dict[str, float]:
    """The same under the noise of the model with the cause.

    A base that lacks a cause takes much of it for noise, which raises its detection limits. A gap or a delay is
    linearised near zero, in the fitted drive without it.

    before  detection limits at the base; model: fitted with the cause
    """
    if not before:
        return {}
    try:
        normal = filtered_normal_equations(model.problem, model.point, model.noise)
        if cause.trace is None:
            found = _amplitude_stds(cause, before, model, base, normal)
        else:
            found = _trace_stds(cause, _without(model, base), model.problem.variance(normal.cost))
    except FIT_ERRORS:
        return dict(before)
    return {n: min(was, found.get(n, was)) for n, was in before.items()}


def _amplitude_stds(cause: Cause, before: Mapping[str, float], model: Model, base: Model,
                    normal: Normal) -> dict[str, float]:
    """By the equations at the fitted model, the cause's other amplitudes zero."""
    free, sizes = model.task.free, cause.sizes
    own = np.array([n in before and quantity_of(n) in sizes for n in free])
    rest = np.array([n in before or n in base.task.free for n in free]) & ~own
    return dict(zip(free, amplitude_std(model.problem, normal, own, rest).tolist(), strict=True))


def _without(model: Model, base: Model) -> Model:
    """The base with the values and the noise of a model that has the cause."""
    found = dict(zip(model.task.free, model.point.values, strict=True))
    task = base.task.at({n: float(found[n]) for n in base.task.free if n in found})
    values = np.array([task.drive.value(n) for n in task.free])
    return replace(base, task=task, point=Point(values, base.point.starts), noise=model.noise)


def _trace_stds(cause: Cause, base: Model, variance: float | None = None) -> dict[str, float]:
    """Name -> standard deviation of a gap or a delay, of the lag for a bandwidth, linearised near zero.

    variance  of the innovations over that of the noise model; None: as the base leaves them
    """
    if cause.trace is None:
        return {}
    small = on_task(base, cause.trace(base).task)
    problem, free = small.problem, small.task.free
    try:
        normal = filtered_normal_equations(problem, small.point, base.noise)
        if variance is not None:
            normal = replace(normal, cost=variance * (problem.count - problem.unknowns))
        _, std, _ = linear_step(problem, normal, np.ones(len(free), bool))
    except FIT_ERRORS:
        return {}
    new = {n: j for j, n in enumerate(free) if n not in base.task.free}
    return {n: float(std[j] / small.point.values[j] ** 2 if quantity_of(n) == "bandwidth" else std[j])
            for n, j in new.items()}
