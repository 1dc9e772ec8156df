"""Starts of a fit of which one may fail: a start without a finite solution never ends a step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

NUMERICAL_FAILURES = (np.linalg.LinAlgError, FloatingPointError)  # beyond floating point: singular, overflown
T = TypeVar("T")


def attempt_or_none(make: Callable[[], T]) -> T | None:
    """The result; None where the numbers fail."""
    try:
        return make()
    except NUMERICAL_FAILURES:
        return None


def without_failed(found: Sequence[T | None]) -> list[T]:
    """Those that did not fail.

    raises  LinAlgError: all did
    """
    successful = [each for each in found if each is not None]
    if found and not successful:
        raise np.linalg.LinAlgError(f"all {len(found)} starts failed numerically")
    return successful
