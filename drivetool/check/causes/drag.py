"""Drag that grows with the square of speed."""

from __future__ import annotations

from functools import partial

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import starts_on_any_body

_starts = partial(starts_on_any_body, suffix="drag")
CAUSES = (Cause(
    "quadratic-drag", "drag that grows with the square of speed",
    "A rotating part accelerates a fluid (air or oil): its drag torque grows with the square of the speed.",
    "Look at fans and at the oil level of the gearbox.", "quadratic-drag", starts=_starts, imposed=_starts,
    sizes=("drag",), power=3),)
