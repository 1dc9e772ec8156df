"""Play in the drive train."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, gear_ratio, is_present, new_values, start_with, torque_size, travel
from drivetool.quantity import name_of, owner_of

if TYPE_CHECKING:
    from drivetool.check.fit import Masks, Model

# Of the twist of a shaft without a gap, as starts; a choice: small, half and large.
GAP_SHARES_OF_TWIST = (0.25, 0.5, 0.75)
PEAK_TO_STD = 1.4  # of a sinusoidal torque: the square root of two
TRACE_GAP_SHARE = 0.01  # of the twist by the torque. A choice: small against any gap of interest


def _starts(base: Model) -> list[Start]:
    from drivetool.check.starts import half_gaps

    found = []
    for shaft in base.task.drive.shafts:
        name = name_of(shaft, "half_gap")
        if not is_present(base, name):
            found += [start_with(base, {name: value}, ())
                      for value in half_gaps(base, name, torque_size(base, shaft))]
    return found


def _starts_imposed(base: Model) -> list[Start]:
    """Half gaps as a share of the twist by the torque, with the shaft stiffness raised to keep the total twist."""
    found = []
    for shaft in base.task.drive.shafts:
        name, stiffness = name_of(shaft, "half_gap"), name_of(shaft, "stiffness")
        if is_present(base, name):
            continue
        soft = base.fitted.drive.values[stiffness]
        twist = PEAK_TO_STD * torque_size(base, shaft) / soft
        found += [start_with(base, {name: part * twist, stiffness: soft / (1.0 - part)}, ())
                  for part in GAP_SHARES_OF_TWIST]
    return found


def _wider_than_travel(model: Model, base: Model) -> str:
    """Whether the gap is wider than the travel: then the shaft never transmits torque."""
    wide = any(2.0 * v > travel(base) / gear_ratio(base, owner_of(n))
               for n, v in new_values(model, base, "half_gap"))
    return "the motion of the record is too small to cross the gap" if wide else ""


def _trace(base: Model) -> Start:
    shaft = base.task.drive.shafts[0]
    twist = torque_size(base, shaft) / base.fitted.drive.value(name_of(shaft, "stiffness"))
    return start_with(base, {name_of(shaft, "half_gap"): TRACE_GAP_SHARE * twist}, ())


def _ends(base: Model, masks: Masks) -> Sequence[Model]:
    from drivetool.check.starts import backlash_fits

    return [replace(m, code="backlash") for m in backlash_fits(base, masks)]


CAUSES = (Cause(
    "backlash", "backlash",
    "There is play in the drive train. Whenever the shaft torque changes its sign, the shaft turns through a gap "
    "without carrying torque and then hits the other side.",
    "Look for worn couplings, gear teeth, splines and keys.", "backlash", starts=_starts, imposed=_starts_imposed,
    sizes=("half_gap",), bodies=2, implausible=_wider_than_travel, trace=_trace, multimodal=True, ends=_ends),)
