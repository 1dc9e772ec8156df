"""Curves with fewer points, that look the same."""

from __future__ import annotations

from itertools import pairwise

import numpy as np


def decimated(x: np.ndarray, y: np.ndarray, bins: int = 800) -> tuple[np.ndarray, np.ndarray]:
    """At most 2 points per bin, the least and the greatest, so that no peak is lost.

    x, y     (n,) of a curve over rising x; NaN where there is nothing
    returns  shorter x, y in the order of x; where evenly spaced x have a gap, a NaN in it, so that no line
             is drawn over what was not recorded
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    edges = [0, *(_gap_places(x) + 1), len(x)]
    parts = [_thinned_stretch(x[a:b], y[a:b], len(x), bins) for a, b in pairwise(edges)]
    for k in range(len(parts) - 1, 0, -1):
        parts.insert(k, (x[edges[k] - 1:edges[k]], np.array([np.nan])))
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _gap_places(x: np.ndarray) -> np.ndarray:
    """Places after which evenly spaced samples have a gap; none where they are not evenly spaced."""
    steps = np.diff(x)
    if len(steps) < 3:
        return np.empty(0, int)
    usual = np.median(steps)
    wide = steps > 1.5 * usual
    even = np.abs(steps - usual) < 0.01 * usual
    return np.flatnonzero(wide) if np.mean(even | wide) == 1.0 and even.mean() > 0.9 else np.empty(0, int)


def _thinned_stretch(x: np.ndarray, y: np.ndarray, total: int, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """A stretch of a curve of so many samples; bins of the whole."""
    if total <= 2 * bins:
        return x, y
    width = -(-total // bins)
    rows = np.pad(y, (0, -len(y) % width), mode="edge").reshape(-1, width)
    base = np.arange(len(rows)) * width
    low = np.argmin(np.where(np.isnan(rows), np.inf, rows), axis=1) + base
    high = np.argmax(np.where(np.isnan(rows), -np.inf, rows), axis=1) + base
    keep = np.minimum(np.sort(np.concatenate([low, high])), len(y) - 1)
    return x[keep], y[keep]
