"""Dry friction."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, added, bodies_without, motion, torque_size

if TYPE_CHECKING:
    from drivetool.check.fit import Model

SMALL, SOME = 1e-6, 0.03  # of the torque's spread, to start from
TYPICAL = 0.7  # of the fastest speed of a motion to and fro, its root mean square


def _starts(end: str) -> Callable[[Model], list[Start]]:
    def starts(base: Model) -> list[Start]:
        found = []
        for body in bodies_without(base, end, "coulomb"):
            name, size = f"{body}.coulomb", torque_size(base, body)
            found += [added(base, {name: SMALL * size}, (name,)), added(base, {name: SOME * size}, ())]
        return found
    return starts


def _dried(end: str) -> Callable[[Model], list[Start]]:
    """The same, and dry what the base has as viscous: where the torque is known, so is the size of its friction."""
    def starts(base: Model) -> list[Start]:
        found, values = _starts(end)(base), base.fitted.drive.values
        for body in bodies_without(base, end, "coulomb"):
            name = f"{body}.viscous"
            if name in base.task.free:
                dry = TYPICAL * motion(base, body)[0] * values[name]
                found.append(added(base, {f"{body}.coulomb": dry, name: 0.0}, ()))
        return found
    return starts


CAUSES = (
    Cause("coulomb-motor", "dry friction at the motor",
          "A constant friction torque at the motor opposes every motion and changes its sign at each reversal.",
          "Look at the motor's bearings, seals and brake.", "coulomb", starts=_starts("motor"), sizes=("coulomb",),
          imposed=_dried("motor"), end="motor"),
    Cause("coulomb-load", "dry friction at the load",
          "A constant friction torque at the load opposes every motion and changes its sign at each reversal.",
          "Look at the load's bearings, guides and seals.", "coulomb", starts=_starts("load"), sizes=("coulomb",),
          imposed=_dried("load"), bodies=2, end="load",
          alike={"coulomb-motor": "Record many slow reversals, or log the load speed or the shaft torque."}),
)
