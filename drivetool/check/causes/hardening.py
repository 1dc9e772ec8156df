"""A shaft whose stiffness changes with load."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, added, present, torque_size

if TYPE_CHECKING:
    from drivetool.check.fit import Model

POWERS = (2.0, 1.0)  # of the twist, to start from


def _starts(base: Model) -> list[Start]:
    found, drive = [], base.fitted.drive
    for shaft in drive.shafts:
        if present(base, f"{shaft}.hardening"):
            continue
        twist = 2.0 * torque_size(base, shaft) / drive.value(f"{shaft}.stiffness")
        for power in POWERS:
            name = f"{shaft}.hardening"
            values = {name: 0.0, f"{name}_twist": twist, f"{name}_power": power}
            found.append(added(base, values, (name,), held=(f"{name}_twist",)))
    return found


CAUSES = (Cause(
    "hardening-stiffness", "a shaft whose stiffness changes with load",
    "The shaft or coupling gets stiffer the more torque it carries, or softer where its hardening is below zero, "
    "so the resonance moves with the load.", "Tune for the whole range of the resonance.", "hardening-stiffness",
    starts=_starts, imposed=_starts, sizes=("hardening", "hardening_twist", "hardening_power"), bodies=2,
    alike={"backlash": "Record torque steps at several preloads: a preload closes a gap, hardening goes on raising "
                       "the resonance."}),)
