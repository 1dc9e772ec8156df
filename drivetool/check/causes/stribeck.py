"""Breakaway friction: more torque to start moving than to keep moving slowly."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import product
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import (
    NEGLIGIBLE_FRICTION_SHARE,
    Bounds,
    Start,
    bodies_without,
    is_present,
    new_values,
    speed_and_duration,
    start_with,
    torque_size,
)
from drivetool.quantity import name_of, owner_of, quantity_of, with_parts

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model
    from drivetool.identify.setup import Task

SIZES = ("stribeck", "stribeck_speed", "stribeck_power")
# Log likelihood that another power must gain (a choice: e^10, the bell is the usual curve)
MIN_POWER_GAIN = 10.0
STRIBECK_SPEED_STARTS = (0.02, 0.06, 0.2, 0.5)  # over the largest speed, as starts (a choice: factors of three)


def _starts(base: Model, end: str) -> list[Start]:
    found = []
    for body, share in product(bodies_without(base, end, "stribeck"), STRIBECK_SPEED_STARTS):
        size = torque_size(base, body)
        values = {name_of(body, "stribeck"): NEGLIGIBLE_FRICTION_SHARE * size,
                  name_of(body, "stribeck_speed"): share * speed_and_duration(base, body)[0]}
        if not is_present(base, name_of(body, "coulomb")):
            values[name_of(body, "coulomb")] = NEGLIGIBLE_FRICTION_SHARE * size
        found.append(start_with(base, values, [n for n in values if not n.endswith("speed")]))
    return found


def _bounds(base: Model, task: Task) -> Bounds:
    """No Stribeck speed above the largest speed: the surplus would be constant friction."""
    return {n: (0.0, speed_and_duration(base, owner_of(n))[0]) for n in task.free
            if quantity_of(n) == "stribeck_speed"}


def _with_power_fitted(model: Model, base: Model, masks: Masks, refitted: Callable) -> Model:
    """The same with the power of the Stribeck curve fitted too, where the gain justifies it.

    Measured curves fall as exponentials or Gaussian curves, or with powers between and beyond (Armstrong-Helouvry
    1991, chapter 4). A wrong power leaves a residual that a drag, a gap or friction at the other end compensates.
    """
    from drivetool.check.fit import FIRST_FIT_ITERATIONS, FIT_ERRORS

    names = [with_parts(n, quantity="stribeck_power")
             for n, _ in new_values(model, base, "stribeck")]
    names = [n for n in names if n not in model.task.free]
    for name in names:
        power = model.task.drive.value(name)
        assert power is not None
        with suppress(*FIT_ERRORS):  # the fitted Gaussian curve stays
            trial = refitted(model, start_with(model, {name: power}, ()).task, base, masks, FIRST_FIT_ITERATIONS)
            if trial.value < model.value - MIN_POWER_GAIN:
                model = refitted(trial, trial.task, base, masks)
    return model


CAUSES = (
    Cause("stribeck-motor", "breakaway friction at the motor",
          "At the motor it takes more torque to start moving than to keep moving slowly.",
          "Look at lubrication and seals; avoid dwelling at creep speed.", "stribeck",
          starts=partial(_starts, end="motor"), imposed=partial(_starts, end="motor"), sizes=SIZES, end="motor",
          special=("coulomb-motor",), bounds=_bounds, refined=_with_power_fitted),
    Cause("stribeck-load", "breakaway friction at the load",
          "At the load it takes more torque to start moving than to keep moving slowly.",
          "Look at lubrication, guides and seals; avoid dwelling at creep speed.", "stribeck",
          starts=partial(_starts, end="load"), imposed=partial(_starts, end="load"), sizes=SIZES, bodies=2,
          end="load", special=("coulomb-load",), bounds=_bounds, refined=_with_power_fitted,
          alike={"stribeck-motor": "Record many slow reversals, or log the load speed or the shaft torque."}),
)
