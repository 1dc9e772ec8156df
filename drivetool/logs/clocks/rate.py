"""From a faster clock to a slower one without aliasing, and from one grid to another.

The grid is that of the fastest sensor, so what is asked of the loop (references) alone can be faster than it.
Taken at the grid points, it would carry aliases, and `spectra` and the instruments of the inverse criterion
would take them for what the loop was asked. So it is weighted with a sinc in a Kaiser window, cut off at 0.4
of the new rate: up to 0.3 of the new rate nothing changes (1e-3), from 0.5 on at most 1e-3 is left. No delay.
An input is averaged over the step in which it is going to be held: that keeps its impulse, which is what the
drive feels.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from drivetool.logs import BRIDGE_STEPS, GAP_STEPS, median_step

# From this ratio of rates on.
FASTER = 1.25
# Steps of a clock at a fixed rate are within half a step of the usual one, but for those beside lost samples; of
# one without a rate (events at random, with exponential intervals) a third is.
REGULAR = 0.8
CUT_OFF, HALF_WIDTH, BETA = 0.4, 10, 6.0


def average(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n,) mean over [at, at + step) of an input that is held from sample to sample.

    time, values  (m,) of the input
    """
    used = held_for(time)
    edges = np.column_stack([time, time + used]).ravel()

    def integral(slope):
        total = np.cumsum(slope * used)
        rising = np.column_stack([total - slope * used, total]).ravel()
        return np.interp(at + step, edges, rising) - np.interp(at, edges, rising)

    share = integral(np.ones(len(time))) / step
    mean = integral(values) / step
    # Within one value there is nothing to average, and nothing to round.
    first, last = (np.searchsorted(time, at + edge * step, side="right") - 1 for edge in (1e-6, 1 - 1e-6))
    return np.where(share > 0.999, np.where(first == last, values[first], mean), np.nan)


def held_for(time: np.ndarray) -> np.ndarray:
    """(m,) how long each value of an input is known to act [s].

    At a fixed rate: until the next one, if none was lost between them. A command that is sent now and then, at no
    rate, stays for as long as one at a rate may be late.
    """
    own = median_step(time)
    steps = np.append(np.diff(time), own)
    regular = np.mean(np.abs(steps - own) < 0.5 * own) > REGULAR
    return np.where(steps <= GAP_STEPS * own, steps, own if regular else GAP_STEPS * own)


def low_passed(at: np.ndarray, step: float, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n,) values of a reference at the new times, without what a grid of `step` cannot show.

    time, values  (m,) of the reference, on a faster clock; NaN near its ends and its gaps
    """
    own = median_step(time)
    count = round((time[-1] - time[0]) / own) + 1
    grid = time[0] + np.arange(count) * own
    even = np.interp(grid, time, values)
    right = np.clip(np.searchsorted(time, grid, side="right"), 1, len(time) - 1)
    even[time[right] - time[right - 1] > (BRIDGE_STEPS + 0.1) * own] = np.nan
    centre = np.round((at - time[0]) / own).astype(np.int64)
    reach = int(np.ceil(HALF_WIDTH * step / own))
    total, weights = np.zeros(len(at)), np.zeros(len(at))
    for k in range(-reach, reach + 1):
        index = centre + k
        away = (at - (time[0] + index * own)) / step
        weight = _weight(away)
        inside = (index >= 0) & (index < count)
        # A weight of zero does not ask for the sample.
        total += np.where(weight == 0, 0.0, weight * np.where(inside, even[np.clip(index, 0, count - 1)], np.nan))
        weights += weight
    return total / weights


def _weight(away: np.ndarray) -> np.ndarray:
    """The windowed sinc at distances in steps of the new grid, from a table (to 1e-7)."""
    return np.interp(np.abs(away), *_table(), right=0.0)


@cache
def _table() -> tuple[np.ndarray, np.ndarray]:
    away = np.linspace(0.0, HALF_WIDTH, 20_001)
    window = np.i0(BETA * np.sqrt(1 - (away / HALF_WIDTH) ** 2)) / np.i0(BETA)
    weight = np.sinc(2 * CUT_OFF * away) * window
    weight[-1] = 0.0
    return away, weight
