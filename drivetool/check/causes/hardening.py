"""A shaft whose stiffness changes with load."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, is_present, start_with, torque_size
from drivetool.quantity import name_of

if TYPE_CHECKING:
    from drivetool.check.fit import Model

HARDENING_POWER_STARTS = (2.0, 1.0)  # of the twist, as starts: quadratic and linear


def _starts(base: Model) -> list[Start]:
    found, drive = [], base.fitted.drive
    for shaft in drive.shafts:
        if is_present(base, name_of(shaft, "hardening")):
            continue
        twist = 2.0 * torque_size(base, shaft) / drive.value(name_of(shaft, "stiffness"))
        for power in HARDENING_POWER_STARTS:
            name = name_of(shaft, "hardening")
            values = {name: 0.0, f"{name}_twist": twist, f"{name}_power": power}
            found.append(start_with(base, values, (name,), fixed=(f"{name}_twist",)))
    return found


CAUSES = (Cause(
    "hardening-stiffness", "a shaft whose stiffness changes with load",
    "The shaft or coupling gets stiffer the more torque it carries, or softer where its hardening is below zero, "
    "so the resonance moves with the load.", "Tune for the whole range of the resonance.", "hardening-stiffness",
    starts=_starts, imposed=_starts, sizes=("hardening", "hardening_twist", "hardening_power"), bodies=2,
    alike={"backlash": "Record torque steps at several preloads: with preload a gap stays closed; with hardening "
                       "the resonance keeps rising."}),)
