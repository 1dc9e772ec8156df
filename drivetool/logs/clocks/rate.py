"""From a faster clock to a slower one without aliasing, and from one grid to another.

The grid is that of the fastest sensor, so only references can be faster than it. Taken at the grid points, they
would carry aliases, and `spectra` and the instruments of the inverse criterion would take these for the reference.
So a reference is weighted with a sinc in a Kaiser window, cut off at 0.4 of the new rate: up to 0.3 of the new rate
nothing changes (1e-3), from 0.5 on at most 1e-3 is left. No delay.
An input is averaged over the step in which it is held: that keeps its impulse, which determines the motion.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from drivetool.logs import GAP_STEPS, MAX_STEPS_WITHIN_SEGMENT, median_step

# A choice: from this ratio of steps on two rates differ; below it, jitter and drift of a clock explain the ratio.
MIN_RATE_RATIO = 1.25
# At a fixed rate, nearly all steps are within half a step of the median one, except beside lost samples. Without a
# rate (events at random, with exponential intervals) a third is.
MIN_REGULAR_STEPS_SHARE = 0.8
# In new rates, in new steps, and the Kaiser beta that together give the 1e-3 above (stop band from 0.5 on).
ANTIALIAS_CUT_OFF, KERNEL_HALF_WIDTH, KAISER_BETA = 0.4, 10, 6.0


def average_over_steps(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n,) mean over [at, at + step) of an input that is held from sample to sample.

    time, values  (m,) of the input
    """
    held = hold_times(time)
    edges = np.column_stack([time, time + held]).ravel()

    def integral(slope):
        total = np.cumsum(slope * held)
        rising = np.column_stack([total - slope * held, total]).ravel()
        return np.interp(at + step, edges, rising) - np.interp(at, edges, rising)

    share = integral(np.ones(len(time))) / step
    mean = integral(values) / step
    # Within one value there is nothing to average, and nothing to round.
    first, last = (np.searchsorted(time, at + edge * step, side="right") - 1 for edge in (1e-6, 1 - 1e-6))
    return np.where(share > 0.999, np.where(first == last, values[first], mean), np.nan)


def hold_times(time: np.ndarray) -> np.ndarray:
    """(m,) how long each value of an input is known to act [s].

    At a fixed rate: until the next one, if none was lost between them. A command that is sent now and then, at no
    rate, stays for as long as one at a rate may be late.
    """
    own = median_step(time)
    steps = np.append(np.diff(time), own)
    regular = np.mean(np.abs(steps - own) < 0.5 * own) > MIN_REGULAR_STEPS_SHARE
    return np.where(steps <= GAP_STEPS * own, steps, own if regular else GAP_STEPS * own)


def low_pass_reference(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n,) values of a reference at the new times, without the frequencies that a grid of `step` cannot represent.

    time, values  (m,) of the reference, on a faster clock; NaN near its ends and its gaps
    """
    reference_step = median_step(time)
    count = round((time[-1] - time[0]) / reference_step) + 1
    grid = time[0] + np.arange(count) * reference_step
    even = np.interp(grid, time, values)
    right = np.clip(np.searchsorted(time, grid, side="right"), 1, len(time) - 1)
    even[time[right] - time[right - 1] > (MAX_STEPS_WITHIN_SEGMENT + 0.1) * reference_step] = np.nan
    centre = np.round((at - time[0]) / reference_step).astype(np.int64)
    reach = int(np.ceil(KERNEL_HALF_WIDTH * step / reference_step))
    total, weights = np.zeros(len(at)), np.zeros(len(at))
    for k in range(-reach, reach + 1):
        index = centre + k
        distance = (at - (time[0] + index * reference_step)) / step
        weight = np.interp(np.abs(distance), *_windowed_sinc_table(), right=0.0)
        inside = (index >= 0) & (index < count)
        # A weight of zero needs no sample there.
        total += np.where(weight == 0, 0.0, weight * np.where(inside, even[np.clip(index, 0, count - 1)], np.nan))
        weights += weight
    return total / weights


@cache
def _windowed_sinc_table() -> tuple[np.ndarray, np.ndarray]:
    """The windowed sinc over distances in steps of the new grid, fine enough to interpolate to 1e-7."""
    distance = np.linspace(0.0, KERNEL_HALF_WIDTH, 20_001)
    window = np.i0(KAISER_BETA * np.sqrt(1 - (distance / KERNEL_HALF_WIDTH) ** 2)) / np.i0(KAISER_BETA)
    weight = np.sinc(2 * ANTIALIAS_CUT_OFF * distance) * window
    weight[-1] = 0.0
    return distance, weight
