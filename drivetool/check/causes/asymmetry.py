"""Friction that depends on the direction."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Bounds, largest_torque, speed_and_duration, starts_on_any_body
from drivetool.quantity import owner_of, quantity_of

if TYPE_CHECKING:
    from drivetool.check.fit import Model
    from drivetool.identify.setup import Task


def _bounds(base: Model, task: Task) -> Bounds:
    """At most the largest motor torque at the largest speed."""
    found = {}
    for name in (n for n in task.free if quantity_of(n) == "viscous_asymmetry"):
        body = owner_of(name)
        limit = largest_torque(base, body) / speed_and_duration(base, body)[0]
        found[name] = (-limit, limit)
    return found


_starts = partial(starts_on_any_body, suffix="viscous_asymmetry")
CAUSES = (Cause(
    "asymmetric-friction", "friction that depends on the direction",
    "Friction is higher in one direction than in the other.",
    "Look for a preload, a screw or a belt that works in one direction.", "asymmetric-friction", starts=_starts,
    imposed=_starts, sizes=("viscous_asymmetry",), bounds=_bounds, power=2),)
