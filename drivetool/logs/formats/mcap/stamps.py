"""Time stamps of messages: whole nanoseconds where they can be had, and one origin for all clocks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.logs import parse_unit
from drivetool.logs.channels import TimeEntry, as_seconds, unwrap_counter
from drivetool.logs.formats.mcap.decoders import Fields

LOG_TIME, PUBLISH_TIME = "log_time", "publish_time"
# Times that every message has besides its fields.
MESSAGE_TIMES = (LOG_TIME, PUBLISH_TIME)
_TICKS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


def to_ticks(columns: Sequence[np.ndarray], stamp: TimeEntry | None, fields: Fields, log: str) -> np.ndarray:
    """(n,) nanoseconds as whole numbers, or seconds as floats with NaN where there is none.

    columns  (n,) one column, or seconds and nanoseconds
    stamp    where they come from; None: the log time
    raises   BadRecording: whole numbers in a field without a unit
    """
    if len(columns) == 2:
        if all(column.dtype.kind == "i" for column in columns):
            return columns[0] * 10**9 + columns[1]
        return columns[0] + 1e-9 * columns[1]
    ticks = columns[0]
    if stamp is None or stamp.channel in MESSAGE_TIMES:
        return ticks
    ticks = unwrap_counter(ticks, stamp)
    path = fields.path(fields.own(stamp.channel))
    unit = stamp.unit or (fields.unit(path) if path else None)
    if unit is None and ticks.dtype.kind == "f":
        return as_seconds(ticks, stamp.channel, log)
    found = parse_unit(unit, "time", f"the time field '{stamp.channel}' of {log}")
    if ticks.dtype.kind == "i":
        return ticks * _TICKS[found.text]
    # Divided, since 1e-3 as a factor is not exact.
    return ticks / (10**9 // _TICKS[found.text])


def seconds_from_common_origin(ticks: Sequence[np.ndarray]) -> tuple[list[np.ndarray], float]:
    """Seconds (n,) of every clock from one origin, and the origin.

    Whole numbers are counted from the first before they become floats, which resolve the seconds
    since 1970 to 0.2 us only.
    """
    first = min((int(each[0]) for each in ticks if each.dtype.kind == "i"), default=0)
    return [_seconds(each, first) if each.dtype.kind == "i" else each - first / 10**9
            for each in ticks], first / 10**9


def _seconds(ticks: np.ndarray, first: int) -> np.ndarray:
    """(n,) seconds since `first` from (n,) nanoseconds; the difference is exact, and no other array is made."""
    seconds = np.empty(len(ticks))
    np.subtract(ticks, first, out=seconds, casting="unsafe")
    return np.divide(seconds, 10**9, out=seconds)
