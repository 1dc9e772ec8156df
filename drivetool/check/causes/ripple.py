"""Torque ripple of the motor, of one order or several."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, is_present, new_values, start_with, travel
from drivetool.drive.effects import RIPPLE_QUANTITIES, RIPPLES
from drivetool.quantity import name_of

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model

# Share of records without a further order in which one may be found (a choice: 0.1 %)
FURTHER_ORDER_ERROR_RATE = 1e-3
SAME_ORDER_TOLERANCE = 0.02  # relative. A choice: closer orders are one order that beats
FIRST_ORDER = "ripple_order"


def _starts(base: Model) -> list[Start]:
    from drivetool.check.starts import likely_orders

    body = base.task.drive.bodies[0]
    if any(is_present(base, name_of(body, f"ripple_{kind}")) for kind in ("sine", "cosine")):
        return []
    return [_with_order(base, "ripple", order) for order in likely_orders(base)]


def _with_order(model: Model, ripple: str, order: float) -> Start:
    body = model.task.drive.bodies[0]
    names = [name_of(body, f"{ripple}_{kind}") for kind in RIPPLE_QUANTITIES]
    return start_with(model, dict(zip(names, (0.0, 0.0, order), strict=True)), names[:2])


def _less_than_a_period(model: Model, base: Model) -> str:
    """Whether the motor does not turn through one period: then it is an offset."""
    once = any(order * travel(model) < 2.0 * np.pi for _, order in new_values(model, base, FIRST_ORDER))
    return "it would not repeat in the record" if once else ""


def _with_further_order(model: Model, masks: Masks, best_start: Callable) -> Model | None:
    """The model with a ripple of one more order: cogging, slots and screws usually cause several."""
    from drivetool.check.fit import FIT_ERRORS, MIN_TESTABLE_GAIN, fit, neg_log_p_corrected
    from drivetool.check.starts import likely_orders

    body, values = model.task.drive.bodies[0], model.fitted.drive.values
    unused = [r for r in RIPPLES if not is_present(model, name_of(body, f"{r}_sine"))]
    known = np.array([values[name_of(body, f"{r}_order")]
                      for r in RIPPLES if name_of(body, f"{r}_order") in model.task.free])
    try:
        orders = [order for order in likely_orders(model)
                  if np.all(np.abs(order / known - 1.0) > SAME_ORDER_TOLERANCE)]
        starts = [_with_order(model, unused[0], order) for order in (orders if unused else ())]
        best = best_start(model, CAUSES[0], starts, masks)
        if best is None or best.expected_gain < MIN_TESTABLE_GAIN:
            return None
        more = fit(best.ready(masks), masks)
    except FIT_ERRORS:  # the result without a further order stays
        return None
    return more if neg_log_p_corrected(model.value - more.value,
                                       len(RIPPLE_QUANTITIES)) > np.log(1.0 / FURTHER_ORDER_ERROR_RATE) else None


CAUSES = (Cause(
    "torque-ripple", "torque ripple of the motor",
    "The motor's torque pulsates with its angle, the same way on every turn.",
    "Look at the number of poles and slots, and at the current sensors' offsets.", "torque-ripple", starts=_starts,
    sizes=("ripple_sine", "ripple_cosine", "ripple_order"), implausible=_less_than_a_period, place=FIRST_ORDER,
    searched=(FIRST_ORDER,), another=_with_further_order,
    alike={"imbalance": "Log the load angle, or turn the axis so that gravity acts differently."}),)
