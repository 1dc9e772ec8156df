"""A weight off the axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, is_present, start_with
from drivetool.quantity import name_of

if TYPE_CHECKING:
    from drivetool.check.fit import Model


def _starts(base: Model) -> list[Start]:
    body = base.task.drive.bodies[-1]
    names = [name_of(body, "imbalance_sine"), name_of(body, "imbalance_cosine")]
    if any(is_present(base, n) for n in names) or base.task.drive.motion_unit != "rad":
        return []
    return [start_with(base, dict.fromkeys(names, 0.0), names)]


CAUSES = (Cause(
    "imbalance", "imbalance",
    "An unbalanced mass of the load causes a gravity torque that varies once per turn.",
    "Balance the load, or include the gravity torque in the feed-forward.", "imbalance", starts=_starts,
    imposed=_starts, sizes=("imbalance_sine", "imbalance_cosine")),)
