"""Damping that acts in the gap as well."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, is_present, start_with
from drivetool.quantity import name_of

if TYPE_CHECKING:
    from drivetool.check.fit import Model


def _starts(base: Model) -> list[Start]:
    """In addition to the damping of the contact, and instead of it."""
    found = []
    for shaft in base.task.drive.shafts:
        name, own = name_of(shaft, "gap_damping"), name_of(shaft, "damping")
        if not is_present(base, name_of(shaft, "half_gap")) or is_present(base, name):
            continue
        damping = base.fitted.drive.value(own) or 0.0
        found += [start_with(base, {name: 0.0}, (name,)),
                  start_with(base, {name: damping, own: 0.0}, (), fixed=() if own in base.task.free else (own,))]
    return found


CAUSES = (Cause(
    "damping-in-gap", "damping in the gap",
    "While the shaft turns through its gap without contact, something still damps it: oil between the flanks, or a "
    "damper around the play.",
    "Keep shaft.gap_damping in the parameters; a damped gap gives smaller impacts.",
    "damping-in-gap", starts=_starts, sizes=("gap_damping",), bodies=2),)
