"""Play in the drive train."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, added, new_values, present, torque_size, travel, turns

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model

PARTS = (0.25, 0.5, 0.75)  # of the twist of a shaft without a gap, that may be a gap
AMPLITUDE = 1.4  # of a torque over its spread
HARDLY = 0.01  # of the twist that the torque makes: a gap of which there is hardly any


def _starts(base: Model) -> list[Start]:
    from drivetool.check.starts import half_gaps

    found = []
    for shaft in base.task.drive.shafts:
        name = f"{shaft}.half_gap"
        if not present(base, name):
            found += [added(base, {name: value}, ()) for value in half_gaps(base, name, torque_size(base, shaft))]
    return found


def _of_travel(base: Model) -> list[Start]:
    """Half gaps that are a part of the twist that the torque makes, the shaft stiffer by what they take of it."""
    found = []
    for shaft in base.task.drive.shafts:
        name, stiffness = f"{shaft}.half_gap", f"{shaft}.stiffness"
        if present(base, name):
            continue
        soft = base.fitted.drive.values[stiffness]
        twist = AMPLITUDE * torque_size(base, shaft) / soft
        found += [added(base, {name: part * twist, stiffness: soft / (1.0 - part)}, ()) for part in PARTS]
    return found


def _uncrossed(model: Model, base: Model) -> str:
    """Whether the gap is wider than the way of the motion: then nothing is behind it at all."""
    wide = any(2.0 * v > travel(base) / turns(base, n.partition(".")[0])
               for n, v in new_values(model, base, ".half_gap"))
    return "no motion of the record would cross the gap" if wide else ""


def _hardly_open(base: Model) -> Start:
    shaft = base.task.drive.shafts[0]
    twist = torque_size(base, shaft) / base.fitted.drive.value(f"{shaft}.stiffness")
    return added(base, {f"{shaft}.half_gap": HARDLY * twist}, ())


def _ends(base: Model, masks: Masks) -> Sequence[Model]:
    from drivetool.check.starts import rattles

    return [replace(m, code="backlash") for m in rattles(base, masks)]


CAUSES = (Cause(
    "backlash", "backlash",
    "There is play in the drive train: whenever the shaft torque changes its sign, the shaft turns through a gap "
    "without carrying torque and then hits the other side.",
    "Look for worn couplings, gear teeth, splines and keys.", "backlash", starts=_starts, imposed=_of_travel,
    sizes=("half_gap",), bodies=2, implausible=_uncrossed, trace=_hardly_open, rough=True, ends=_ends),)
