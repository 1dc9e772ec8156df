"""Ways into a fit of which one may break: a start that no equations hold for never ends a step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

BROKEN = (np.linalg.LinAlgError, FloatingPointError)  # beyond what numbers can hold: singular, overflown
T = TypeVar("T")


def attempted(make: Callable[[], T]) -> T | None:
    """What a way leads to; None where it breaks."""
    try:
        return make()
    except BROKEN:
        return None


def that_held(found: Sequence[T | None]) -> list[T]:
    """Those that did not break.

    raises  LinAlgError: all did
    """
    held = [each for each in found if each is not None]
    if found and not held:
        raise np.linalg.LinAlgError(f"none of {len(found)} starts can be followed")
    return held
