"""Time stamps as logged, and the uniform grid that fits them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivetool.errors import BadRecording, Finding

# Samples this far apart still belong together. One or two lost samples are the everyday loss of a
# logger, and a torque held that long is hardly wrong; across more the machine may have done anything.
BRIDGE_STEPS = 3.0
# Half way to the next sample: from here on a stamp is another sample's, not a late one.
GAP_STEPS = BRIDGE_STEPS + 0.5
# Time stamps within this share of a step count as uniform: a logger's own jitter.
JITTER = 0.05


@dataclass(frozen=True)
class Clock:
    """A clean clock.

    time  (m,) seconds, strictly increasing; keep (m,) indices of the samples it keeps
    """

    time: np.ndarray
    keep: np.ndarray

    def of(self, values: np.ndarray) -> np.ndarray:
        """The values that belong to the clean stamps; the array itself if nothing was dropped."""
        return values if len(self.keep) == len(values) else values[self.keep]


@dataclass(frozen=True)
class Grid:
    """Where samples lie on a uniform grid.

    start, step  [s]; index (m,) place of each sample; uniform: whether it may be taken as it is
    gaps         (g,) positions in `index` after which the record is interrupted
    lost         samples missing between neighbours that still belong together
    jitter       largest distance of a stamp from the grid, in steps
    """

    start: float
    step: float
    index: np.ndarray
    uniform: bool
    gaps: np.ndarray
    lost: int
    jitter: float

    @property
    def size(self) -> int:
        """Grid points from the first to the last sample."""
        return int(self.index[-1]) + 1


def clean_clock(time: np.ndarray, who: str, log: str) -> tuple[Clock, list[Finding]]:
    """The stamps without repeated and missing ones.

    time     (n,) seconds as logged; who: the channel, for messages
    returns  Clock, findings
    raises   BadRecording: time goes backwards (says where)
    """
    findings = []
    keep = np.flatnonzero(np.isfinite(time))
    if len(keep) < len(time):
        findings.append(Finding(
            "warning", "missing-time", f"{len(time) - len(keep)} samples of {who} in {log} have no time "
            "stamp and are left out.", {"samples": len(time) - len(keep), "of": len(time)}))
    if len(keep) == 0:
        raise BadRecording(f"time stamps of {who} in {log}", "none",
                           "Name the time channel in the channel map.")
    step = np.diff(time[keep])
    if np.any(step < 0):
        at = int(np.argmax(step < 0))
        raise BadRecording(
            f"time that does not go backwards for {who} in {log}",
            f"a step of {step[at]:.6g} s after sample {keep[at]} at {time[keep[at]]:.6f} s",
            "Cut the record there, or choose another time channel in the channel map.")
    if np.any(step == 0):
        repeated = int(np.sum(step == 0))
        findings.append(Finding(
            "warning", "repeated-time", f"{repeated} samples of {who} in {log} repeat the time stamp before "
            "them and are left out.", {"samples": repeated, "of": len(time)},
            "Check the resolution of the recorder's clock."))
        keep = keep[np.concatenate([[True], step > 0])]
    return Clock(time[keep], keep), findings


def median_step(time: np.ndarray) -> float:
    """Sample interval [s]: the mean of the intervals near their median."""
    step = np.diff(time)
    middle = np.median(step)
    return float(np.mean(step[(step > 0.5 * middle) & (step < 1.5 * middle)]))


def fit_grid(time: np.ndarray) -> Grid:
    """The uniform grid through the stamps (n,), n >= 2, strictly increasing.

    A sample's place is counted from the sample before it, so a clock that drifts slowly stays on
    the grid. Uniform means: every interval within JITTER of whole steps, or every stamp within
    JITTER of the straight line through its stretch. The step is the slope of that line, rounded to
    nine digits so that stamps stored as floats and as whole nanoseconds agree.
    """
    intervals = np.diff(time) / median_step(time)
    whole = np.maximum(1, np.round(intervals)).astype(np.int64)
    index = np.concatenate([[0], np.cumsum(whole)])
    is_gap = intervals > GAP_STEPS
    gaps = np.flatnonzero(is_gap)
    stretches = [(t - t.mean(), i - i.mean()) for t, i in zip(
        np.split(time, gaps + 1), np.split(index.astype(float), gaps + 1), strict=True)]
    # Only samples that are alone in their stretch: no line, and no step but the median.
    weight = sum(float(i @ i) for _, i in stretches)
    slope = sum(float(t @ i) for t, i in stretches) / weight if weight else median_step(time)
    step = float(f"{slope:.9g}")
    from_line = max(float(np.ptp(t / step - i)) / 2 for t, i in stretches)
    from_whole = float(np.abs(intervals - whole)[~is_gap].max(initial=0.0))
    jitter = min(from_whole, from_line)
    lost = int(np.sum(whole[~is_gap] - 1))
    return Grid(float(time[0]), step, index, jitter < JITTER, gaps, lost, jitter)
