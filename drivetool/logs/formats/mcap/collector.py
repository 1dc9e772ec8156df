"""A column that grows block by block."""

from __future__ import annotations

import numpy as np


class Collector:
    """Up to `most` numbers; integers until the first block of floats.

    Numbers are copied out of a block while it is in the processor's cache, and once.
    """

    def __init__(self, capacity: int):
        self._most, self._count, self._kept = capacity, 0, np.zeros(0)

    def add(self, numbers: np.ndarray) -> None:
        """Append (n,) integers or floats."""
        if not self._count:
            self._kept = np.empty(self._most, numbers.dtype)
        elif self._kept.dtype.kind == "i" and numbers.dtype.kind == "f":
            self._kept = self._kept.astype(float)
        self._kept[self._count:self._count + len(numbers)] = numbers
        self._count += len(numbers)

    @property
    def values(self) -> np.ndarray:
        """(n,) all that was added."""
        return self._kept[:self._count]
