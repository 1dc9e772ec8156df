"""An offset of the torque channel."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, start_with
from drivetool.drive.effects import idle_torque
from drivetool.quantity import name_of, names_of

if TYPE_CHECKING:
    from drivetool.check.fit import Model


def _starts(base: Model) -> list[Start]:
    drive = base.task.drive
    name = "total.idle_torque" if len(drive.bodies) > 1 else name_of(drive.bodies[0], "idle_torque")
    parts = names_of(drive.bodies, "idle_torque")
    if name in base.task.free or any(p in base.task.free for p in parts):
        return []
    return [start_with(base, {name: drive.values.get(name, drive.referred_to_motor("idle_torque"))}, (name,))]


CAUSES = (Cause(
    "torque-offset", "an offset of the torque channel", "The logged torque is shifted by a constant amount.",
    "Calibrate the zero of the torque or current sensor.", None, starts=_starts, sizes=("offset", "idle_torque"),
    law=idle_torque.EFFECT.law, absent=(
        "in-the-model", "it is equivalent to the idle torque, which is already free in the base"),
    needs="a stretch with the torque switched off; without one an idle torque is the same"),)
