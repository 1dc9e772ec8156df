"""Further orders of a ripple that was found: cogging, slots and screws seldom leave one alone."""

from __future__ import annotations

import numpy as np

from drivetool.check.candidates import Start, added, present
from drivetool.check.heldout import unlikely
from drivetool.check.hypothesis import TRIFLE, begin
from drivetool.check.model import BROKEN, Masks, Model, fit
from drivetool.check.scan import likely_orders
from drivetool.drive.effects.ripple import KINDS, RIPPLES

CHANCE = 1e-3  # share of records without a further order in which one may be taken for it
NEAR = 0.02  # relative difference below which two orders are one that beats


def with_another_order(model: Model, masks: Masks) -> Model | None:
    """The model of a ripple with one order more, None where nothing asks for that."""
    try:
        begun = [begin(model, start, masks) for start in _starts(model)]
        best = max(begun, key=lambda b: b.promise, default=None)
        if best is None or best.promise < TRIFLE:
            return None
        more = fit(model.code, best.start.task, best.problem, best.point, model.noise, masks)
    except BROKEN:  # what was found before that stands
        return None
    return more if unlikely(model.value - more.value, len(KINDS)) > np.log(1.0 / CHANCE) else None


def _starts(model: Model) -> list[Start]:
    body, values = model.task.drive.bodies[0], model.fitted.drive.values
    ripple = next((r for r in RIPPLES if not present(model, f"{body}.{r}_sine")), None)
    if ripple is None:
        return []
    known = np.array([values[f"{body}.{r}_order"] for r in RIPPLES if f"{body}.{r}_order" in model.task.free])
    sine, cosine, order = (f"{body}.{ripple}_{what}" for what in KINDS)
    return [added(model, {sine: 0.0, cosine: 0.0, order: n}, (sine, cosine)) for n in likely_orders(model)
            if np.all(np.abs(n / known - 1.0) > NEAR)]
