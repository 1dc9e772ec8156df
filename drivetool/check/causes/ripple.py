"""Torque ripple of the motor, of one order or several."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, added, new_values, present, travel
from drivetool.drive.effects import KINDS, RIPPLES

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model

CHANCE = 1e-3  # share of records without a further order in which one may be taken for it
NEAR = 0.02  # relative difference below which two orders are one that beats
ORDER = ".ripple_order"


def _starts(base: Model) -> list[Start]:
    from drivetool.check.starts import likely_orders

    body = base.task.drive.bodies[0]
    if any(present(base, f"{body}.ripple_{kind}") for kind in ("sine", "cosine")):
        return []
    return [_with_order(base, "ripple", order) for order in likely_orders(base)]


def _with_order(model: Model, ripple: str, order: float) -> Start:
    body = model.task.drive.bodies[0]
    names = [f"{body}.{ripple}_{kind}" for kind in KINDS]
    return added(model, dict(zip(names, (0.0, 0.0, order), strict=True)), names[:2])


def _unrepeated(model: Model, base: Model) -> str:
    """Whether the motor does not go through a period: then it is an offset by another name."""
    once = any(order * travel(model) < 2.0 * np.pi for _, order in new_values(model, base, ORDER))
    return "it would not repeat in the record" if once else ""


def _with_another_order(model: Model, masks: Masks, most_promising: Callable) -> Model | None:
    """Cogging, slots and screws seldom leave one order alone."""
    from drivetool.check.fit import BROKEN, TRIFLE, fit, unlikely
    from drivetool.check.starts import likely_orders

    body, values = model.task.drive.bodies[0], model.fitted.drive.values
    unused = [r for r in RIPPLES if not present(model, f"{body}.{r}_sine")]
    known = np.array([values[f"{body}.{r}_order"] for r in RIPPLES if f"{body}.{r}_order" in model.task.free])
    try:
        orders = [order for order in likely_orders(model) if np.all(np.abs(order / known - 1.0) > NEAR)]
        starts = [_with_order(model, unused[0], order) for order in (orders if unused else ())]
        best = most_promising(model, CAUSES[0], starts, masks)
        if best is None or best.promise < TRIFLE:
            return None
        more = fit(best.ready(masks), masks)
    except BROKEN:  # what was found before that stands
        return None
    return more if unlikely(model.value - more.value, len(KINDS)) > np.log(1.0 / CHANCE) else None


CAUSES = (Cause(
    "torque-ripple", "torque ripple of the motor",
    "The motor's torque pulsates with its angle, the same way on every turn.",
    "Look at the number of poles and slots, and at the current sensors' offsets.", "torque-ripple", starts=_starts,
    sizes=("ripple_sine", "ripple_cosine", "ripple_order"), implausible=_unrepeated, place=ORDER,
    searched=(ORDER,), another=_with_another_order,
    alike={"imbalance": "Log the load angle, or turn the axis so that gravity acts differently."}),)
