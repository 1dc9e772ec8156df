"""Memory for unpacked chunks, in few large pieces."""

from __future__ import annotations

import numpy as np

# NumPy requests huge pages for arrays of this size, so that the first touch of a byte is cheap.
ARENA_BYTES = 1 << 24


class Arena:
    """Allocates arrays of bytes one after the other; a piece lives as long as any array in it."""

    def __init__(self) -> None:
        self._piece, self._used = np.empty(0, np.uint8), 0

    def take(self, size: int) -> np.ndarray:
        """(size,) bytes to be written."""
        if size > ARENA_BYTES:
            return np.empty(size, np.uint8)
        if self._used + size > len(self._piece):
            self._piece, self._used = np.empty(ARENA_BYTES, np.uint8), 0
        first, self._used = self._used, self._used + size
        return self._piece[first:self._used]
