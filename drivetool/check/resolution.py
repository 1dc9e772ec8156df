"""The steps in which a channel was logged."""

from __future__ import annotations

import numpy as np

FEW = 5.0  # steps between one value and the next, in the median, of a channel that hardly repeats a value


def resolution(y: np.ndarray) -> float | None:
    """The step of which all values are multiples, None if there is none.

    Values that go far, as angles do, need not repeat: then neighbours must be few steps apart.
    """
    values = np.unique(y)
    if len(values) < 3:
        return None
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-9 * max(np.abs(values).max(), 1e-300)]
    step = float(gaps.min(initial=np.inf))
    if not np.isfinite(step) or (len(values) > 0.5 * len(y) and np.median(gaps) > FEW * step):
        return None
    off = np.abs(gaps / step - np.round(gaps / step))
    return step if np.all(off < 1e-3 * np.maximum(np.round(gaps / step), 1.0)) else None
