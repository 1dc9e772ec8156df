"""Drag that grows with the square of speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, starts_on_any_body

if TYPE_CHECKING:
    from drivetool.check.fit import Model


def _starts(base: Model) -> list[Start]:
    return starts_on_any_body(base, "drag")


CAUSES = (Cause(
    "quadratic-drag", "drag that grows with the square of speed",
    "Something throws a fluid about: the torque it takes grows with the square of the speed.",
    "Look at fans and at the oil level of the gearbox.", "quadratic-drag", starts=_starts, imposed=_starts,
    sizes=("drag",), power=3),)
