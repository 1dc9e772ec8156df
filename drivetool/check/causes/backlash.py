"""Play in the drive train."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause, Start
from drivetool.check.causes.starts import added, present, torque_size

if TYPE_CHECKING:
    from drivetool.check.fit.model import Masks, Model

HARDLY = 0.01  # of the twist that the torque makes: a gap of which there is hardly any


def _starts(base: Model) -> list[Start]:
    from drivetool.check.fit.scan import half_gaps

    found = []
    for shaft in base.task.drive.shafts:
        name = f"{shaft}.half_gap"
        if not present(base, name):
            found += [added(base, {name: value}, ()) for value in half_gaps(base, name, torque_size(base, shaft))]
    return found


def _hardly_open(base: Model) -> Start:
    shaft = base.task.drive.shafts[0]
    twist = torque_size(base, shaft) / base.fitted.drive.value(f"{shaft}.stiffness")
    return added(base, {f"{shaft}.half_gap": HARDLY * twist}, ())


def _ends(base: Model, masks: Masks) -> Sequence[Model]:
    from drivetool.check.report.rattle import rattles

    return [replace(m, code="backlash") for m in rattles(base, masks)]


CAUSES = (Cause(
    "backlash", "backlash",
    "There is play in the drive train: whenever the shaft torque changes its sign, the shaft turns through a gap "
    "without carrying torque and then hits the other side.",
    "Look for worn couplings, gear teeth, splines and keys.", "backlash", starts=_starts,
    sizes=("half_gap",), bodies=2, trace=_hardly_open, rough=True, ends=_ends),)
