"""Dry friction."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import (
    NEGLIGIBLE_FRICTION_SHARE,
    Start,
    bodies_without,
    speed_and_duration,
    start_with,
    torque_size,
)
from drivetool.quantity import name_of

if TYPE_CHECKING:
    from drivetool.check.fit import Model

START_FRICTION_SHARE = 0.03  # of the torque's standard deviation, as a start that is large enough to act (a choice)
RMS_TO_PEAK_SPEED = 0.7  # rms over peak speed of a sinusoidal motion: 1 / sqrt(2)


def _starts(base: Model, end: str) -> list[Start]:
    found = []
    for body in bodies_without(base, end, "coulomb"):
        name, size = name_of(body, "coulomb"), torque_size(base, body)
        found += [start_with(base, {name: NEGLIGIBLE_FRICTION_SHARE * size}, (name,)),
                  start_with(base, {name: START_FRICTION_SHARE * size}, ())]
    return found


def _starts_imposed(base: Model, end: str) -> list[Start]:
    """The same, and a start with the base's viscous friction as dry friction: the known torque fixes its size."""
    found, values = _starts(base, end), base.fitted.drive.values
    for body in bodies_without(base, end, "coulomb"):
        name = name_of(body, "viscous")
        if name in base.task.free:
            dry = RMS_TO_PEAK_SPEED * speed_and_duration(base, body)[0] * values[name]
            found.append(start_with(base, {name_of(body, "coulomb"): dry, name: 0.0}, ()))
    return found


CAUSES = (
    Cause("coulomb-motor", "dry friction at the motor",
          "A constant friction torque at the motor opposes every motion and changes its sign at each reversal.",
          "Look at the motor's bearings, seals and brake.", "coulomb", starts=partial(_starts, end="motor"),
          sizes=("coulomb",), imposed=partial(_starts_imposed, end="motor"), end="motor"),
    Cause("coulomb-load", "dry friction at the load",
          "A constant friction torque at the load opposes every motion and changes its sign at each reversal.",
          "Look at the load's bearings, guides and seals.", "coulomb", starts=partial(_starts, end="load"),
          sizes=("coulomb",), imposed=partial(_starts_imposed, end="load"), bodies=2, end="load",
          alike={"coulomb-motor": "Record many slow reversals, or log the load speed or the shaft torque."}),
)
