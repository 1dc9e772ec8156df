"""Dead time of the torque."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import (
    DELAY_STARTS_IN_SAMPLES,
    Start,
    is_present,
    likeliest_start,
    shortest_delay,
    start_with,
)

if TYPE_CHECKING:
    from drivetool.check.fit import Model

NAME = "converter.dead_time"


def _starts(base: Model) -> list[Start]:
    step = base.problem.traces[0].step
    return [] if is_present(base, NAME) else likeliest_start(base, [start_with(base, {NAME: n * step}, ())
                                                                    for n in DELAY_STARTS_IN_SAMPLES])


HIGH_FREQUENCY_EXCITATION = "Excite above a third of the sampling rate (steps, PRBS), or log faster."
CAUSES = (Cause(
    "dead-time", "dead time of the torque", "The torque comes later than the logged command by a fixed time.",
    "Look at bus cycles, and whether command and speed are logged with the same clock.", "dead-time",
    starts=_starts, sizes=("dead_time",), trace=partial(shortest_delay, name=NAME),
    alike={"converter-lag": HIGH_FREQUENCY_EXCITATION,
           "speed-filter": "Log the motor angle too; excite above a third of the sampling rate."}),)
