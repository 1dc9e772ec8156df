"""Interprets the numbers of a time channel: counters that wrap, and seconds without a stated unit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drivetool.errors import BadRecording
from drivetool.logs.channels.channel_map import TimeEntry

# Numbers without a unit are taken for seconds below this step. Records of drives have 5 samples a second and more;
# in milliseconds, 5 kHz and all that is slower come in larger steps.
MAX_SAMPLE_INTERVAL = 0.19


def unwrap_counter(counts: np.ndarray, entry: TimeEntry | None) -> np.ndarray:
    """Stamps (n,) without the wraps of the counter, if the map gives its range.

    counts  (n,) as logged, whole numbers or floats, NaN where missing
    """
    if entry is None or entry.wrap is None:
        return counts
    known = np.flatnonzero(np.isfinite(counts))
    turns = np.round(np.diff(counts[known]) / entry.wrap)
    found = counts.copy()
    found[known[1:]] -= (entry.wrap * np.cumsum(turns)).astype(counts.dtype)
    return found


def require_time_resolution(counts: np.ndarray, to_si: Callable[[np.ndarray], np.ndarray], channel: str,
                            log: str) -> None:
    """Refuse numbers (n,) of single precision whose origin is so far back that samples share them.

    to_si   of a number, in seconds
    raises  BadRecording: their steps are longer than those of any drive, as for seconds since 1970
    """
    known = np.abs(counts[np.isfinite(counts)])
    largest = float(known.max()) if len(known) else 0.0
    step = float(to_si(np.asarray(np.spacing(np.float32(largest)), dtype=float)))
    if np.isfinite(step) and step > MAX_SAMPLE_INTERVAL:
        raise BadRecording(
            f"time stamps that distinguish the samples of {log}",
            f"numbers of single precision in '{channel}', which resolve {largest:.6g} to {step:.4g} s",
            "Export the time in double precision or as whole numbers, or count it from the start of the record.")


def as_seconds(time: np.ndarray, channel: str, log: str) -> np.ndarray:
    """Times (n,) without a unit, as seconds.

    raises  BadRecording: they would be those of a record too slow for any drive, and may be milliseconds
    """
    steps = np.diff(np.unique(time[np.isfinite(time)]))
    if len(steps) and np.median(steps) > MAX_SAMPLE_INTERVAL:
        raise BadRecording(f"the unit of the time channel '{channel}' of {log}",
                           f"none, and a median step of {np.median(steps):.4g}, implausible in seconds",
                           f"Write `time: {{channel: '{channel}', unit: ms}}` in the channel map, or what it is.")
    return time
