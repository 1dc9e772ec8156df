"""A second way into the fit of a cause: from the values that the base itself was once started from.

A drive that lacks a law bends its parameters to make up for it. Where it has bent them far (a stiffness that
plays the part of dry friction), no law is to be reached from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from drivetool.check.hypothesis import TRIFLE, Tried
from drivetool.check.model import BROKEN, Masks, Model, at_rest, first_noise, fit, from_start
from drivetool.identify.cooling import BOX, SHAPE
from drivetool.identify.setup import first_point


def strayed(base: Model, begun: Mapping[str, float], far: float = BOX) -> bool:
    """Whether an inertia, stiffness, damping or gap has left its start by more than a start can be wrong.

    far  factor by which
    """
    values = zip(base.task.free, base.point.values, strict=True)
    return any(n.endswith(SHAPE) and not begun[n] / far < value < begun[n] * far
               for n, value in values if begun.get(n, 0.0) > 0.0)


def at_start(base: Model, begun: Mapping[str, float], masks: Masks) -> Model:
    """The base at the values that its fit began with, with the noise that it has there."""
    task = base.task.at({n: begun[n] for n in base.task.free if n in begun})
    return from_start(task, masks, rounds=0)


def returned(model: Model, begun: Mapping[str, float], masks: Masks) -> Model:
    """The model, or the same laws fitted from the values that the base was once started from, if that is likelier.

    A base that made up for a law keeps its bent shape once the law is found: no way leads back downhill.
    """
    if not strayed(model, begun):
        return model
    task = model.fitted.at({n: begun[n] for n in model.task.free if n in begun and n.endswith(SHAPE)})
    try:
        trial = at_rest(from_start(task, masks), masks)
    except BROKEN:
        return model
    return replace(trial, code=model.code) if trial.value < model.value - TRIFLE else model


def beside_gap(tried: Tried, begun: Mapping[str, float], masks: Masks) -> Tried:
    """A cause beside a gap, or the same laws fitted from the values that the base was once started from.

    The likelier one. While a law is missing contacts come at wrong times, and all else bends to make up for it:
    not far from the start, but into another valley.
    """
    model = tried.model
    if model is None or not begun or not any(n.endswith(".half_gap") for n in model.task.free):
        return tried
    task = model.fitted.at({n: begun[n] for n in model.task.free if n in begun})
    try:
        point = first_point(task.drive, model.problem, task.roles)
        noise = first_noise(model.problem, point, masks)
        trial = at_rest(fit(model.code, task, model.problem, point, noise, masks), masks)
    except BROKEN:
        return tried
    return replace(tried, models=(trial, *tried.models)) if trial.value < model.value - TRIFLE else tried


def likelier(found: Tried, further: Tried, base: Model) -> Tried:
    """Of two attempts at a cause the likelier one, if it gains on the base at all."""
    least = base.value - TRIFLE if found.model is None else min(found.model.value, base.value - TRIFLE)
    if further.model is None or not further.model.value < least:
        return found
    return replace(further, smallest=found.smallest or further.smallest)
