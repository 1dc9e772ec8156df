"""The steps in which a channel was logged."""

from __future__ import annotations

import numpy as np

COARSE = 0.1  # share of the noise variance that rounding explains, from which it is a cause: a step of 1.1 std
OFF = 1e-3  # of a step, that a difference may be off by for every step it is long, where there are few to tell
MANY = 20  # differences, from which chance does not make them multiples of anything
LOOKED = 300  # of them, at most
APART = 100  # steps at most that the nearest two values may be apart
AGREE = 0.9  # mean cosine of the differences over the step: one of multiples, next to zero of any


def resolution(y: np.ndarray) -> float | None:
    """The step of which the values (n,) are multiples, None if there is none.

    Values that go far, as angles do, need not repeat, and neighbours may be several steps apart: the step is the
    largest whole part of the least difference of which the others are multiples.
    """
    values = np.unique(y)
    gaps = np.sort(np.diff(values))
    gaps = gaps[gaps > 1e-9 * max(np.abs(values).max(initial=0.0), 1e-300)]
    if len(gaps) < 2:
        return None
    if len(gaps) < MANY:
        step = float(gaps[0])
        steps = np.round(gaps / step)
        return step if np.all(np.abs(gaps / step - steps) < OFF * steps) else None
    some = gaps[np.linspace(0, len(gaps) - 1, min(LOOKED, len(gaps))).astype(int)]
    parts = np.arange(1, APART + 1)
    found = np.flatnonzero(_agreement(some, gaps[0] / parts) > AGREE)
    if not found.size:
        return None
    step = gaps[0] / parts[found[0]]
    return float(some.sum() / np.round(some / step).sum())


def _agreement(gaps: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """(m,) mean cosine of (n,) differences over each of (m,) steps."""
    return np.cos(2.0 * np.pi * gaps / steps[:, None]).mean(axis=1)
