"""The uniform grid that fits time stamps."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

# Samples at most so many steps from each other belong to one segment. One or two lost samples are usual in a
# logger, and a torque held that long is hardly wrong; across more the motion is unknown.
MAX_STEPS_WITHIN_SEGMENT = 3.0
# Half way to the next sample: beyond it, a stamp belongs to a later sample and is no late one.
GAP_STEPS = MAX_STEPS_WITHIN_SEGMENT + 0.5
# Stamps within this share of a step count as uniform. A choice, above the jitter of loggers; more is resampled.
JITTER_TOLERANCE = 0.05
# Steps that differ by less than this share are equal: jitter changes the median by a few per cent.
STEP_TOLERANCE = 0.1
# Intervals of more steps are damage; larger ones would overflow as whole numbers.
MAX_INTERVAL_STEPS = 1e12
# Samples of an experiment, of what a conditioning step leaves, and of a part at one rate. A choice: fewer identify
# no parameter of a drive.
MIN_SAMPLES = 50


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


def median_step(time: np.ndarray) -> float:
    """Sample interval [s]: the mean of the intervals near their median."""
    step = np.diff(time)
    middle = np.median(step)
    return float(np.mean(step[(step > 0.5 * middle) & (step < 1.5 * middle)]))


def usual_step(time: np.ndarray) -> float:
    """The usual step of stamps, out of order, repeated or missing as they may be [s]; 0 without any step."""
    steps = np.abs(np.diff(time))
    steps = steps[np.isfinite(steps) & (steps > 0)]
    return float(np.median(steps)) if len(steps) else 0.0


def true_runs(mask: np.ndarray) -> np.ndarray:
    """(k, 2) first and last + 1 of every run of true values in (n,)."""
    return np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))).reshape(-1, 2)


def fit_grid(time: np.ndarray) -> Grid:
    """The uniform grid through the stamps (n,), n >= 2, strictly increasing.

    A sample's place is counted from the sample before it, so a clock that drifts slowly stays on
    the grid. Uniform means: every interval within JITTER_TOLERANCE of whole steps, or every stamp within
    JITTER_TOLERANCE of the straight line through its stretch. A stamp may be so late that it looks like the
    sample after it: where stamps lie nearer to a line without any sample lost, none was. The step is
    the slope of that line, rounded to nine digits so that stamps stored as floats and as whole
    nanoseconds agree.
    """
    intervals = np.minimum(np.diff(time) / median_step(time), MAX_INTERVAL_STEPS)
    whole = np.maximum(1, np.round(intervals)).astype(np.int64)
    is_gap = intervals > GAP_STEPS
    gaps = np.flatnonzero(is_gap)
    whole = _steps_without_losses(time, whole, gaps)
    index = np.concatenate([[0], np.cumsum(whole)])
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
    return Grid(float(time[0]), step, index, jitter < JITTER_TOLERANCE, gaps, lost, jitter)


def _steps_without_losses(time: np.ndarray, whole: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """(n - 1,) steps between the stamps (n,), one each in stretches that lie nearer to a line that way."""
    whole, usual = whole.copy(), median_step(time)
    edges = [0, *(gaps + 1).tolist(), len(time)]
    for a, b in pairwise(edges):
        inside = slice(a, b - 1)
        if b - a > 2 and np.any(whole[inside] > 1):
            step, distance = _fit_grid_line(time[a:b], np.arange(b - a))
            counted = np.concatenate([[0], np.cumsum(whole[inside])])
            # Every second sample lost is a line as well, of another step.
            if abs(step / usual - 1.0) < STEP_TOLERANCE and distance < _fit_grid_line(time[a:b], counted)[1]:
                whole[inside] = 1
    return whole


def _fit_grid_line(time: np.ndarray, index: np.ndarray) -> tuple[float, float]:
    """Step of the line through stamps (n,) at places (n,) [s]; rms distance from it, in steps."""
    i = index - index.mean()
    t = time - time.mean()
    step = float(t @ i) / float(i @ i)
    return step, float(np.sqrt(np.mean((t / step - i) ** 2)))
