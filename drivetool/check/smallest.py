"""The smallest size of a cause that a record would have shown, once the cause itself is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.check.causes import CAUSES
from drivetool.check.hypothesis import BROKEN, Tried, traced
from drivetool.check.linear_step import alone
from drivetool.check.model import Model
from drivetool.identify.noise import normal_under
from drivetool.identify.problem import Normal, Point


def resolved_by(tried: Tried, model: Model, base: Model) -> dict[str, float]:
    """Amplitude -> its standard deviation, the cause's others zero, under the noise that the cause leaves.

    A base that lacks a cause takes much of it for noise, and what that hides would count as not seen. A gap or a
    delay is told from hardly any of it, in the drive that is left without.
    """
    if not tried.smallest:
        return {}
    try:
        normal = normal_under(model.problem, model.point, model.noise)
        found = _amplitudes(tried, model, base, normal)
        if not found and tried.candidate.trace is not None:
            variance = normal.cost / max(model.problem.count - model.problem.unknowns, 1)
            found = traced(tried.candidate, _without(model, base), variance)
    except BROKEN:
        return tried.smallest
    return {n: min(was, found.get(n, was)) for n, was in tried.smallest.items()}


def _amplitudes(tried: Tried, model: Model, base: Model, normal: Normal) -> dict[str, float]:
    """By the equations at the fitted model; none of a cause without amplitudes."""
    if tried.candidate.trace is not None:
        return {}
    free, sizes = model.task.free, CAUSES[tried.candidate.code].sizes
    own = np.array([n in tried.smallest and n.rpartition(".")[2] in sizes for n in free])
    rest = np.array([n in tried.smallest or n in base.task.free for n in free]) & ~own
    return dict(zip(free, alone(model.problem, normal, own, rest).tolist(), strict=True))


def _without(model: Model, base: Model) -> Model:
    """The base with the values and the noise of a model that has the cause."""
    found = dict(zip(model.task.free, model.point.values, strict=True))
    task = base.task.at({n: float(found[n]) for n in base.task.free if n in found})
    values = np.array([task.drive.value(n) for n in task.free])
    return replace(base, task=task, point=Point(values, base.point.starts), noise=model.noise)
