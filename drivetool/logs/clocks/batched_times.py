"""Receive times in batches: messages that waited and came at once. Their spacing is not that of the samples."""

from __future__ import annotations

import numpy as np

from drivetool.errors import BadRecording

# Steps shorter than this share of the mean one are those inside a batch: of a clock with jitter few are, of one at
# random (exponential steps) a fifth. From two messages a batch on, half of all are.
SHORT, MANY = 0.25, 0.4
# Batches fill less than this share of the time, or the record is a clock with pauses.
FILLED = 0.5
# The last message of a batch has waited least: its receipt is near the line of a uniform clock over the number of
# messages, by less than this share of a batch. Behind pauses of any length it is off by pauses.
NEAR = 0.2
LEAST = 10  # batches


def batches(time: np.ndarray) -> tuple[float, float] | None:
    """(samples a batch, seconds from batch to batch), medians, if stamps come in batches of a uniform clock.

    time  (n,) seconds, not decreasing
    """
    steps = np.diff(time[np.isfinite(time)])
    if not len(steps) or steps.min() < 0 or steps.sum() == 0:
        return None
    short = steps < SHORT * steps.mean()
    ends = np.flatnonzero(~short)
    if short.mean() < MANY or len(ends) < LEAST or steps[short].sum() > FILLED * steps.sum():
        return None
    size = float(np.median(np.diff(ends)))
    if size < 2.0:  # a slow part of the record beside a fast one
        return None
    at = time[ends]
    period = float(np.median(np.diff(at)))
    line = np.polynomial.Polynomial.fit(ends, at, 1)
    if float(np.sqrt(np.mean((at - line(ends)) ** 2))) > NEAR * period:
        return None
    return size, period


def refuse_batches(time: np.ndarray, who: str, log: str) -> None:
    """Refuse receive times, (n,) seconds: the spacing inside a batch says nothing of the sampling rate."""
    found = batches(time)
    if found:
        raise BadRecording(
            f"the time at which {who} in {log} were sampled",
            f"receive times: batches of {found[0]:g} samples, one every {found[1]:.4g} s",
            "Name the clock of the samples with `time:` in the channel map: a stamp field, publish_time, or "
            "another time column.")
