"""Receive times in batches: messages that waited and came at once. Their spacing is not that of the samples."""

from __future__ import annotations

import numpy as np

from drivetool.errors import BadRecording

# Steps shorter than MAX_INNER_STEP of the mean step lie inside a batch. A clock with jitter has few of them, one at
# random (exponential steps) a fifth (1 - exp(-0.25) = 0.22), and batches of two messages or more have half.
MAX_INNER_STEP, MIN_INNER_SHARE = 0.25, 0.4
# A choice: steps inside batches sum to less than this share of the time, or the record is a clock with pauses.
MAX_FILLED_SHARE = 0.5
# The last message of a batch has waited least. The rms distance of its receipt from a uniform clock over the number
# of messages is below this share of the batch period. With pauses of any length it is off by those pauses.
MAX_BATCH_DEVIATION = 0.2
MIN_BATCHES = 10  # batches. A choice: fewer give no reliable rms distance from the line.


def find_batches(time: np.ndarray) -> tuple[float, float] | None:
    """(samples a batch, seconds from batch to batch), medians, if stamps come in batches of a uniform clock.

    time  (n,) seconds, not decreasing
    """
    steps = np.diff(time[np.isfinite(time)])
    if not len(steps) or steps.min() < 0 or steps.sum() == 0:
        return None
    short = steps < MAX_INNER_STEP * steps.mean()
    ends = np.flatnonzero(~short)
    if short.mean() < MIN_INNER_SHARE or len(ends) < MIN_BATCHES or steps[
            short].sum() > MAX_FILLED_SHARE * steps.sum():
        return None
    size = float(np.median(np.diff(ends)))
    if size < 2.0:  # a slow part of the record beside a fast one
        return None
    batch_end_times = time[ends]
    period = float(np.median(np.diff(batch_end_times)))
    line = np.polynomial.Polynomial.fit(ends, batch_end_times, 1)
    if float(np.sqrt(np.mean((batch_end_times - line(ends)) ** 2))) > MAX_BATCH_DEVIATION * period:
        return None
    return size, period


def refuse_batches(time: np.ndarray, who: str, log: str) -> None:
    """Refuse receive times, (n,) seconds: the spacing inside a batch is not the sampling interval."""
    found = find_batches(time)
    if found:
        raise BadRecording(
            f"the time at which {who} in {log} were sampled",
            f"receive times: batches of {found[0]:g} samples, one every {found[1]:.4g} s",
            "Name the clock of the samples with `time:` in the channel map: a stamp field, publish_time, or "
            "another time column.")
