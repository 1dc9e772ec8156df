"""What the numbers of a time channel may mean: counters that start again, seconds that nobody has called so."""

from __future__ import annotations

import numpy as np

from drivetool.errors import BadRecording
from drivetool.logs.channel_map import TimeEntry

# Numbers without a unit are taken for seconds below this step. Records of drives have 5 samples a second and more;
# in milliseconds, 5 kHz and all that is slower come in larger steps.
SLOWEST = 0.19


def uncounted(counts: np.ndarray, entry: TimeEntry | None) -> np.ndarray:
    """Stamps (n,) without the starts of a counter, if the map says where it starts again.

    counts  (n,) as logged, whole numbers or floats, NaN where missing
    """
    if entry is None or entry.wrap is None:
        return counts
    known = np.flatnonzero(np.isfinite(counts))
    turns = np.round(np.diff(counts[known]) / entry.wrap)
    found = counts.copy()
    found[known[1:]] -= (entry.wrap * np.cumsum(turns)).astype(counts.dtype)
    return found


def as_seconds(time: np.ndarray, channel: str, log: str) -> np.ndarray:
    """Times (n,) without a unit, as seconds.

    raises  BadRecording: they would be those of a record too slow for any drive, and may be milliseconds
    """
    steps = np.diff(np.unique(time[np.isfinite(time)]))
    if len(steps) and np.median(steps) > SLOWEST:
        raise BadRecording(f"the unit of the time channel '{channel}' of {log}",
                           f"none, and steps of {np.median(steps):.4g}, too long for seconds of a drive",
                           f"Write `time: {{channel: '{channel}', unit: ms}}` in the channel map, or what it is.")
    return time
