"""The quantisation step of a logged channel."""

from __future__ import annotations

import numpy as np

# Share of rounding, step^2 / 12, in the noise variance from which it is a cause: a step of 1.1 std.
MIN_ROUNDING_VARIANCE_SHARE = 0.1
# Of a step: error of a difference per step of its length, where there are few to test. A choice: rounding of
# decimals is far less.
STEP_MULTIPLE_TOLERANCE = 1e-3
# Differences, from which chance does not make all of them multiples of one step.
MIN_DIFFERENCES_FOR_COSINE = 20
MAX_DIFFERENCES = 300  # a choice: limits the cost, more add no certainty
MAX_STEPS_BETWEEN_VALUES = 100  # a choice: bounds the search for the integer fraction
# Mean cosine of 2 pi difference / step: one for multiples, near zero for any other values.
MIN_MEAN_COSINE = 0.9


def resolution(y: np.ndarray) -> float | None:
    """The step of which the values (n,) are multiples, None if there is none.

    Values of a wide range, as of angles, need not repeat, and neighbours may differ by several steps. The step is
    the largest integer fraction of the least difference of which the others are multiples.
    """
    values = np.unique(y)
    gaps = np.sort(np.diff(values))
    gaps = gaps[gaps > 1e-9 * max(np.abs(values).max(initial=0.0), 1e-300)]
    if len(gaps) < 2:
        return None
    if len(gaps) < MIN_DIFFERENCES_FOR_COSINE:
        step = float(gaps[0])
        steps = np.round(gaps / step)
        return step if np.all(np.abs(gaps / step - steps) < STEP_MULTIPLE_TOLERANCE * steps) else None
    some = gaps[np.linspace(0, len(gaps) - 1, min(MAX_DIFFERENCES, len(gaps))).astype(int)]
    parts = np.arange(1, MAX_STEPS_BETWEEN_VALUES + 1)
    found = np.flatnonzero(_mean_cosine(some, gaps[0] / parts) > MIN_MEAN_COSINE)
    if not found.size:
        return None
    step = gaps[0] / parts[found[0]]
    return float(some.sum() / np.round(some / step).sum())


def _mean_cosine(gaps: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """(m,) mean cosine of (n,) differences over each of (m,) steps."""
    return np.cos(2.0 * np.pi * gaps / steps[:, None]).mean(axis=1)
