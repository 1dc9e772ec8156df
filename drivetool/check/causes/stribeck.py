"""Breakaway friction: more torque to start moving than to keep moving slowly."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from itertools import product
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Bounds, Start, added, bodies_without, motion, new_values, present, torque_size

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model
    from drivetool.identify.setup import Task

SMALL = 1e-6  # of the torque's spread, to start from
SIZES = ("stribeck", "stribeck_speed", "stribeck_power")
SHAPED = 10.0  # log likelihood that another power must bring
SLOW = (0.02, 0.06, 0.2, 0.5)  # Stribeck speeds to start from, over the fastest motion


def _starts(end: str) -> Callable[[Model], list[Start]]:
    def starts(base: Model) -> list[Start]:
        found = []
        for body, share in product(bodies_without(base, end, "stribeck"), SLOW):
            size = torque_size(base, body)
            values = {f"{body}.stribeck": SMALL * size, f"{body}.stribeck_speed": share * motion(base, body)[0]}
            if not present(base, f"{body}.coulomb"):
                values[f"{body}.coulomb"] = SMALL * size
            found.append(added(base, values, [n for n in values if not n.endswith("speed")]))
        return found
    return starts


def _bounds(base: Model, task: Task) -> Bounds:
    """No Stribeck speed that the record never leaves behind: its surplus is constant friction by another name."""
    return {n: (0.0, motion(base, n.rpartition(".")[0])[0]) for n in task.free if n.endswith(".stribeck_speed")}


def _shaped(model: Model, base: Model, masks: Masks, refitted: Callable) -> Model:
    """The same with the power by which the surplus fades fitted too, where that pays.

    Measured curves fade as exponentials or bells, or by powers between and beyond (Armstrong-Helouvry 1991, chapter
    4). A curve of another power leaves a rest that a drag, a gap or friction at the other end would make up for.
    """
    from drivetool.check.fit import BROKEN, FIRST

    names = [f"{n.removesuffix('.stribeck')}.stribeck_power" for n, _ in new_values(model, base, ".stribeck")]
    names = [n for n in names if n not in model.task.free]
    for name in names:
        power = model.task.drive.value(name)
        assert power is not None
        with suppress(*BROKEN):  # the bell that was fitted stands
            trial = refitted(model, added(model, {name: power}, ()).task, base, masks, FIRST)
            if trial.value < model.value - SHAPED:
                model = refitted(trial, trial.task, base, masks)
    return model


CAUSES = (
    Cause("stribeck-motor", "breakaway friction at the motor",
          "At the motor it takes more torque to start moving than to keep moving slowly.",
          "Look at lubrication and seals; avoid dwelling at creep speed.", "stribeck", starts=_starts("motor"),
          imposed=_starts("motor"), sizes=SIZES, end="motor", special=("coulomb-motor",),
          bounds=_bounds, refined=_shaped),
    Cause("stribeck-load", "breakaway friction at the load",
          "At the load it takes more torque to start moving than to keep moving slowly.",
          "Look at lubrication, guides and seals; avoid dwelling at creep speed.", "stribeck",
          starts=_starts("load"), imposed=_starts("load"), sizes=SIZES, bodies=2, end="load",
          special=("coulomb-load",), bounds=_bounds, refined=_shaped,
          alike={"stribeck-motor": "Record many slow reversals, or log the load speed or the shaft torque."}),
)
