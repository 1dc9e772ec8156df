"""A lag of the torque, and a filter on the logged speed: of first or of second order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import (
    Start,
    is_present,
    lag_bounds,
    lag_starts,
    shortest_delay,
    start_with,
    too_short_to_detect,
)
from drivetool.quantity import name_of

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model
    from drivetool.identify.setup import Task

LAG_ORDERS = (1.0, 2.0)  # first and second order: a higher one is not distinguishable from a dead time
# Log likelihood that the damping of a lag must gain (a choice: one parameter gains 1.92 by chance at 95 %)
MIN_DAMPING_GAIN = 4.0


def _starts(base: Model, owner: str, role: str = "") -> list[Start]:
    if is_present(base, name_of(owner, "bandwidth")) or (role and role not in base.task.roles.outputs):
        return []
    return [start for order in LAG_ORDERS for start in lag_starts(owner, order, base)]


def _with_damping_fitted(model: Model, base: Model, masks: Masks, refitted: Callable, owner: str) -> Model:
    """A lag of second order with its damping fitted too, where the gain justifies it.

    With free damping from the start, a lag of first order would become one of second order with two real poles.
    """
    bandwidth, order, damping = (name_of(owner, what) for what in ("bandwidth", "order", "damping"))
    drive = model.task.drive
    if bandwidth not in model.task.free or drive.value(order) != 2.0 or damping in model.task.free:
        return model
    from_here = drive.value(damping)
    assert from_here is not None
    trial = refitted(model, start_with(model, {damping: from_here}, ()).task, base, masks)
    if trial.value > model.value - MIN_DAMPING_GAIN:
        return model
    # With large damping it is one of first order, and bandwidth and damping are not identifiable separately.
    simple = refitted(trial, _of_first_order(trial.fitted, bandwidth, order, damping), base, masks)
    return simple if simple.value < trial.value + MIN_DAMPING_GAIN else trial


def _of_first_order(task: Task, bandwidth: str, order: str, damping: str) -> Task:
    drive, neutral = task.drive, task.drive.quantity(damping).neutral
    fast, damping_ratio = drive.value(bandwidth), drive.value(damping)
    assert neutral is not None and fast is not None and damping_ratio is not None
    first_order = task.at({bandwidth: fast / (2.0 * damping_ratio), order: 1.0, damping: neutral})
    return replace(first_order, free=tuple(n for n in first_order.free if n != damping))


SIZES = ("bandwidth", "damping", "order")
CAUSES = (
    Cause("converter-lag", "lag of the torque",
          "The torque follows the logged command with a lag: the current loop is slower than the model "
          "assumes.",
          "Look at the tuning of the current loop; log the actual torque too.", "converter-lag",
          starts=partial(_starts, owner="converter"), sizes=SIZES, response=("speed-filter",),
          trace=partial(shortest_delay, name="converter.bandwidth"), bounds=lag_bounds,
          implausible=too_short_to_detect, refined=partial(_with_damping_fitted, owner="converter")),
    Cause("speed-filter", "a filter on the logged speed",
          "The logged speed is low-pass filtered: the drive itself responds faster.",
          "Log the speed before the filter, or the angle.", "speed-filter",
          starts=partial(_starts, owner="sensor", role="motor_speed"), sizes=SIZES, response=("converter-lag",),
          trace=partial(shortest_delay, name="sensor.bandwidth"), bounds=lag_bounds,
          implausible=too_short_to_detect, refined=partial(_with_damping_fitted, owner="sensor"),
          alike={"converter-lag": "Log a second sensor (motor angle, or the torque-producing current): a lag of "
                                  "the torque delays both, a filter on the speed only the speed."}),
)
