"""Tests of single samples: spikes, the quantisation step, values that are only repeated."""

from __future__ import annotations

import numpy as np

# A median absolute deviation of normal noise times this is its standard deviation.
STD_PER_MAD = 1.4826
# The reciprocal to four digits: 1 / 0.6745 is less than 1.4826 by 1e-5 of it.
MAD_PER_STD = 0.6745
# Samples of a running median at once. A choice: windows of all samples at once would fill the memory.
MEDIAN_BLOCK_SAMPLES = 100_000


def remove_spikes(values: np.ndarray, window: int = 7, threshold: float = 5.0) -> tuple[np.ndarray, np.ndarray]:
    """Spikes replaced by the running median.

    values     (n,), NaN where missing; window: samples around each one, made odd
    threshold  in STD_PER_MAD median absolute deviations from the running median, those of the window and
               of the whole, and more than one quantisation step
    returns    (n,) values, (n,) whether each was a spike
    source     Hampel 1974; the deviation of the whole is a floor, since that of few samples varies
    """
    known = np.flatnonzero(np.isfinite(values))
    spikes = np.zeros(len(values), bool)
    half = window // 2
    if len(known) < 2 * half + 1:
        return values, spikes
    given = values[known]
    median, local_mad = running_median(given, half)
    distance = np.abs(given - median)
    # On a ramp a sample is often its own median; second differences see the noise there too.
    global_noise = np.median(np.abs(np.diff(given, 2))) / np.sqrt(6)
    limit = threshold * STD_PER_MAD * np.maximum(local_mad, max(np.median(distance), global_noise))
    found = distance > np.maximum(limit, 1.5 * quantisation_step(given))
    spikes[known] = found
    if not found.any():
        return values, spikes
    values = values.copy()
    values[known[found]] = median[found]
    return values, spikes


def running_median(values: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray]:
    """(running median, median absolute deviation from it in the window), ends mirrored."""
    padded = np.pad(values, half, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    median, mad = np.empty(len(values)), np.empty(len(values))
    for first in range(0, len(values), MEDIAN_BLOCK_SAMPLES):
        part = windows[first:first + MEDIAN_BLOCK_SAMPLES]
        middle = np.median(part, axis=1)
        median[first:first + MEDIAN_BLOCK_SAMPLES] = middle
        mad[first:first + MEDIAN_BLOCK_SAMPLES] = np.median(np.abs(part - middle[:, None]), axis=1)
    return median, mad


def quantisation_step(values: np.ndarray) -> float:
    """The step in which values (n,) are quantised; 0.0 if they are not.

    Taken is the smallest change above rounding, if nearly all changes are whole multiples of it.
    """
    change = np.abs(np.diff(values[np.isfinite(values)]))
    if not len(change) or change.max() == 0:
        return 0.0
    rounding = 1e-9 * max(np.ptp(values[np.isfinite(values)]), 1e-300)
    change = change[change > rounding]
    if not len(change):
        return 0.0
    least = float(change.min())
    # The least change seen may be a few steps.
    for divisor in range(1, 9):
        small = change[change < 1e5 * least / divisor]
        # Refined over the changes, so that rounding of the least one does not add up.
        step = float(small.sum() / np.round(divisor * small / least).sum()) if len(small) else 0.0
        off = np.abs(small / step - np.round(small / step)) if step else np.ones(1)
        if float(np.mean(off < 0.05)) * len(small) / len(change) > 0.95:
            return step
    return 0.0


def hold_count(values: np.ndarray) -> int:
    """How often every value appears in a row; 1 where values just happen to repeat.

    values  (n,), NaN where missing. Held means: nearly all runs are of one length, and the values
            change by more than single quantisation steps between them
    """
    values = values[np.isfinite(values)]
    change = np.flatnonzero(values[1:] != values[:-1])
    if len(change) < 20:
        return 1
    runs = np.diff(change)
    usual = int(np.median(runs))
    if usual < 2 or np.mean(np.abs(runs - usual) <= 0.1 * usual) < 0.9:
        return 1
    step = quantisation_step(values)
    return 1 if step and np.median(np.abs(np.diff(values))[change]) < 3 * step else usual
