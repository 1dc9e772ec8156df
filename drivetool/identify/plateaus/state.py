"""Where a record is steady: the ratio of two variances (Cao & Rhinehart 1995).

Three exponential filters run over a signal x:

    xf_i = l1 x_i + (1 - l1) xf_(i-1)                          filtered value
    v2_i = l2 (x_i - xf_(i-1))^2 + (1 - l2) v2_(i-1)           variance about the filtered value
    d2_i = l3 (x_i - x_(i-1))^2  + (1 - l3) d2_(i-1)           variance of successive differences
    R_i  = (2 - l1) v2_i / d2_i

White noise about a constant gives R = 1 on average; a ramp without noise gives (2 - l1) / l1^2 (19
here). Two things are added for recordings of drives.

Noise that is correlated over several samples gives a large R too, and the torque of a controlled
drive is like that. So x is not the sample but the mean over a block, and the block length is chosen
per record: long enough for the noise to be white from block to block, short enough to leave many
blocks per plateau. The filter constants hold per block, so they follow the time scale.

A set-point step is a million times the noise in power, and both variances contain it for a hundred
blocks. So the statistic runs over the record forwards and backwards: each contains it on one side only,
and a block is unsteady where both say so. A step between two blocks, where both may be low for a moment,
is recognised by its height.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import scipy

from drivetool.logs import true_runs
from drivetool.logs.samples import MAD_PER_STD

L1, L2, L3 = 0.3, 0.2, 0.2  # filter constants l1, l2, l3, as in Cao & Rhinehart (1995)
# White noise exceeds 3 in 0.7 of 1000 blocks; noise with a correlation of 0.3 from block to block
# in 8 of 1000.
CRITICAL_VARIANCE_RATIO = 3.0
# A difference of successive blocks beyond this many standard deviations is a step: white noise has one in 5e8.
MIN_STEP_STDS = 6.0
# A change per block below this share of the signal's range is no movement, a choice: rounding and quantisation.
MIN_CHANGE_SHARE = 1e-4
# Blocks in a row that make an interval; and its least share of the record, so that the turning point of a
# moving signal does not count. Both are a choice.
MIN_INTERVAL_BLOCKS = 20
MIN_INTERVAL_SHARE = 1 / 200
# Standard deviation of the speed within an interval, over the fastest speed of the record. A periodic
# motion looks like noise to blocks that are longer than a quarter of its period.
MAX_SPEED_STD_SHARE = 0.2
# Blocks that a movement takes to show in the statistic, left out at both ends: the delay of the filters is 1/l1.
STATISTIC_DELAY_BLOCKS = 2


def ratio_statistic(x: np.ndarray, floor: float = 0.0) -> np.ndarray:
    """R of Cao & Rhinehart (1995) for every value but the first.

    x        (n,) values, n >= 2; floor: a standard deviation that counts as noise in any case
    returns  (n-1,) ratio: about 1 where x is constant but for white noise, large where it moves
    """
    start = x[:max(2, round(1 / L1))].mean()
    filtered = scipy.signal.lfilter([L1], [1, L1 - 1], x, zi=[(1 - L1) * start])[0]
    about = (x[1:] - filtered[:-1])**2
    between = np.diff(x)**2
    keep = round(2 / L2)
    v2 = scipy.signal.lfilter([L2], [1, L2 - 1], about, zi=[(1 - L2) * about[:keep].mean()])[0]
    d2 = scipy.signal.lfilter([L3], [1, L3 - 1], between, zi=[(1 - L3) * between[:keep].mean()])[0]
    # White noise of variance s^2 gives v2 = 2 s^2 / (2 - l1) and d2 = 2 s^2.
    noise = 2 * floor**2
    top, bottom = (2 - L1) * v2 + noise, d2 + noise
    return np.divide(top, bottom, out=np.ones_like(top), where=bottom > 0)


def is_steady(x: np.ndarray, floor: float = 0.0) -> np.ndarray:
    """(n,) whether x is steady: R below its critical value forwards or backwards, no step to the value before."""
    forward = np.concatenate([[True], ratio_statistic(x, floor) < CRITICAL_VARIANCE_RATIO])
    backward = np.concatenate([ratio_statistic(x[::-1], floor)[::-1] < CRITICAL_VARIANCE_RATIO, [True]])
    between = np.abs(np.diff(x))
    typical = max(float(np.median(between)) / MAD_PER_STD, np.sqrt(2) * floor)
    return (forward | backward) & np.concatenate([[True], between <= MIN_STEP_STDS * typical])


def steady_intervals(signals: Sequence[np.ndarray],
                     segments: Iterable[tuple[int, int]]) -> tuple[list[tuple[int, int]], int]:
    """Intervals in which all the signals are steady.

    signals   (n,) each, the speed first; NaN where there is no value
    segments  (first, last+1) without a gap
    returns   (first, last+1) of each interval; block length [samples]
              The block length is the longest that still finds four fifths of the time that the best
              one finds. Time at one speed level counts up to a twentieth of the record, so that one
              long rest does not outweigh the plateaus.
    """
    segments = list(segments)
    longest = max(b - a for a, b in segments)
    size = sum(b - a for a, b in segments)
    fastest = float(np.nanquantile(np.abs(signals[0]), 0.99))
    span = [float(np.nanmax(s) - np.nanmin(s)) for s in signals]
    found, length = [], max(1, round(size * MIN_INTERVAL_SHARE / MIN_INTERVAL_BLOCKS))
    while length * MIN_INTERVAL_BLOCKS <= longest:
        intervals = [(a, b) for segment in segments
                     for a, b in _intervals_in_segment(signals, segment, length, span)
                     if np.nanstd(signals[0][a:b]) <= MAX_SPEED_STD_SHARE * fastest]
        found.append((_time_at_levels(signals[0], intervals, size / 20, span[0]), length, intervals))
        length *= 2
    best = max((time for time, _, _ in found), default=0.0)
    if best == 0.0:
        return [], 1
    _, length, intervals = next(f for f in reversed(found) if f[0] >= 0.8 * best)
    return intervals, length


def block_means(values: np.ndarray, length: int) -> np.ndarray:
    """Means over blocks of `length` values, NaN where a block has none; the rest is left out."""
    if length == 1:
        return values
    blocks = values[:len(values) // length * length].reshape(-1, length)
    known = np.isfinite(blocks)
    count = known.sum(axis=1)
    total = np.where(known, blocks, 0.0).sum(axis=1)
    return np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)


def _intervals_in_segment(signals: Sequence[np.ndarray], segment: tuple[int, int], length: int,
                          span: Sequence[float]) -> list[tuple[int, int]]:
    """Steady intervals of one segment at one block length."""
    first, last = segment
    if (last - first) // length < MIN_INTERVAL_BLOCKS:
        return []
    steady = np.ones((last - first) // length, dtype=bool)
    for signal, width in zip(signals, span, strict=True):
        means = block_means(signal[first:last], length)
        known = np.isfinite(means)
        steady &= known
        if known.sum() < 2:
            return []
        filled = np.interp(np.arange(len(means)), np.flatnonzero(known), means[known])
        steady &= is_steady(filled, MIN_CHANGE_SHARE * width)
    return [(first + int(a + STATISTIC_DELAY_BLOCKS) * length, first + int(b - STATISTIC_DELAY_BLOCKS) * length)
            for a, b in true_runs(steady) if b - a >= MIN_INTERVAL_BLOCKS]


def _time_at_levels(speed: np.ndarray, intervals: Sequence[tuple[int, int]], most: float,
                    span: float) -> float:
    """Samples in the intervals, at most `most` at each level of speed."""
    level = sorted((float(np.nanmean(speed[a:b])), b - a) for a, b in intervals)
    total, here, last = 0.0, 0.0, None
    for mean, count in level:
        if last is not None and mean - last > 0.02 * span:
            total, here = total + min(here, most), 0.0
        here, last = here + count, mean
    return total + min(here, most)
