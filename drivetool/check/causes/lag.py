"""A lag of the torque, and a filter on the logged speed: of first or of second order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, added, hardly_late, no_faster, of_lag, present, traceless

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model
    from drivetool.identify.setup import Task

ORDERS = (1.0, 2.0)
SHAPED = 4.0  # log likelihood that the damping of a lag must bring to be fitted


def _starts(owner: str, role: str) -> Callable[[Model], list[Start]]:
    def starts(base: Model) -> list[Start]:
        if present(base, f"{owner}.bandwidth") or (role and role not in base.task.roles.outputs):
            return []
        return [start for order in ORDERS for start in of_lag(owner, order, base)]
    return starts


def _trace(owner: str) -> Callable[[Model], Start]:
    def trace(base: Model) -> Start:
        return hardly_late(base, f"{owner}.bandwidth")
    return trace


def _damped(owner: str) -> Callable[[Model, Model, Masks, Callable], Model]:
    """A lag of second order with its damping fitted too, where that pays.

    Free from the start, it would make a lag of first order one of second order with two bandwidths.
    """
    def refined(model: Model, base: Model, masks: Masks, refitted: Callable) -> Model:
        bandwidth, order, damping = (f"{owner}.{what}" for what in ("bandwidth", "order", "damping"))
        drive = model.task.drive
        if bandwidth not in model.task.free or drive.value(order) != 2.0 or damping in model.task.free:
            return model
        from_here = drive.value(damping)
        assert from_here is not None
        trial = refitted(model, added(model, {damping: from_here}, ()).task, base, masks)
        if trial.value > model.value - SHAPED:
            return model
        # Damped so much it is one of first order, whose two values nothing tells apart.
        simple = refitted(trial, _of_first_order(trial.fitted, bandwidth, order, damping), base, masks)
        return simple if simple.value < trial.value + SHAPED else trial
    return refined


def _of_first_order(task: Task, bandwidth: str, order: str, damping: str) -> Task:
    drive, neutral = task.drive, task.drive.quantity(damping).neutral
    fast, damped = drive.value(bandwidth), drive.value(damping)
    assert neutral is not None and fast is not None and damped is not None
    plain = task.at({bandwidth: fast / (2.0 * damped), order: 1.0, damping: neutral})
    return replace(plain, free=tuple(n for n in plain.free if n != damping))


SIZES = ("bandwidth", "damping", "order")
CAUSES = (
    Cause("converter-lag", "lag of the torque",
          "The torque follows the logged command with a lag: the current loop is slower than the model took it to "
          "be.",
          "Look at the tuning of the current loop; log the actual torque too.", "converter-lag",
          starts=_starts("converter", ""), sizes=SIZES, response=("speed-filter",), trace=_trace("converter"),
          bounds=no_faster, implausible=traceless, refined=_damped("converter")),
    Cause("speed-filter", "a filter on the logged speed",
          "The logged speed went through a low-pass: the drive itself is faster than its log.",
          "Log the speed before the filter, or the angle.", "speed-filter", starts=_starts("sensor", "motor_speed"),
          sizes=SIZES, response=("converter-lag",), trace=_trace("sensor"), bounds=no_faster,
          implausible=traceless, refined=_damped("sensor"),
          alike={"converter-lag": "Log a second sensor (motor angle, or the torque-producing current): a lag of "
                                  "the torque delays both, a filter on the speed only the speed."}),
)
