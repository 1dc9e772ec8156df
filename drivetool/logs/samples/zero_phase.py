"""Low-pass filters without delay, on signals with segments and missing values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache

import numpy as np
import scipy

# A choice: up to so many missing values in a row are interpolated for the filter; they stay missing in the result.
MAX_BRIDGED_SAMPLES = 3


def low_pass(values: np.ndarray, segments: Iterable[tuple[int, int]], cutoff: float, order: int) -> np.ndarray:
    """(n,) values through a Butterworth filter, there and back.

    values   (n,), NaN where missing; filtered within each segment
    cutoff   in cycles per sample, below 0.5; each pass has -3 dB there, both together -6 dB
    """
    if not values.any():  # most derivatives of an equation
        return values.copy()
    sections = _sections(order, cutoff)
    # The initial transient of the filter lasts a few periods of its cut-off.
    padding = max(3 * (2 * len(sections) + 1), int(np.ceil(3 / cutoff)))
    filtered = values.copy()
    for first, last in segments:
        for a, b in _bridged_stretches(values, first, last):
            part = values[a:b]
            known = np.isfinite(part)
            place = np.arange(b - a)
            even = part if known.all() else np.interp(place, place[known], part[known])
            if len(even) > 3:
                even = scipy.signal.sosfiltfilt(sections, even, padlen=min(padding, len(even) - 1))
            filtered[a:b] = np.where(known, even, np.nan)
    return filtered


@cache  # the regressions of a fit filter a thousand signals by one design, which costs more than the filtering
def _sections(order: int, cutoff: float) -> np.ndarray:
    """(sections, 6) the Butterworth filter of low_pass."""
    return scipy.signal.butter(order, 2 * cutoff, output="sos")


def _bridged_stretches(values: np.ndarray, first: int, last: int) -> Iterator[tuple[int, int]]:
    """Stretches that begin and end with a value and lack at most MAX_BRIDGED_SAMPLES in a row."""
    known = first + np.flatnonzero(np.isfinite(values[first:last]))
    if len(known):
        cuts = np.flatnonzero(np.diff(known) > MAX_BRIDGED_SAMPLES + 1)
        begins = np.concatenate([[known[0]], known[cuts + 1]])
        ends = np.concatenate([known[cuts], [known[-1]]]) + 1
        yield from zip(begins.tolist(), ends.tolist(), strict=True)
