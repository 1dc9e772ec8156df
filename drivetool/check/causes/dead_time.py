"""Dead time of the torque."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import LATE, Start, added, hardly_late, likeliest, present

if TYPE_CHECKING:
    from drivetool.check.fit import Model

NAME = "converter.dead_time"


def _starts(base: Model) -> list[Start]:
    step = base.problem.traces[0].step
    return [] if present(base, NAME) else likeliest(base, [added(base, {NAME: n * step}, ()) for n in LATE])


def _trace(base: Model) -> Start:
    return hardly_late(base, NAME)


FAST = "Excite above a third of the sampling rate (steps, PRBS), or log faster."
CAUSES = (Cause(
    "dead-time", "dead time of the torque", "The torque comes later than the logged command by a fixed time.",
    "Look at bus cycles, and whether command and speed are logged with the same clock.", "dead-time",
    starts=_starts, sizes=("dead_time",), trace=_trace,
    alike={"converter-lag": FAST,
           "speed-filter": "Log the motor angle too; excite above a third of the sampling rate."}),)
