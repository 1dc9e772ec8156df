"""The same field of many messages: read in place where they lie at equal distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Offsets:
    """Where messages begin in `data` (a (m,) array of bytes).

    starts  (n,) rising
    stride  their distance [bytes] if it is always the same, else 0
    """

    data: np.ndarray
    starts: np.ndarray
    stride: int

    @classmethod
    def of(cls, data: np.ndarray, starts: np.ndarray) -> Offsets:
        """The places, and whether they are at equal distances."""
        stride = int(starts[1] - starts[0]) if len(starts) > 2 else 0
        if stride <= 0 or starts[-1] - starts[0] != stride * (len(starts) - 1) or \
                not np.all(starts[1:] - starts[:-1] == stride):
            stride = 0
        return cls(data, starts, stride)

    def read(self, offset: int, kind: str | np.dtype) -> np.ndarray:
        """(n,) values of a kind, `offset` bytes after each start; a view or a copy."""
        kind = np.dtype(kind)
        if not len(self.starts):
            return np.zeros(0, kind)
        if self.stride:
            return np.ndarray((len(self.starts),), kind, self.data, int(self.starts[0]) + offset, (self.stride,))
        rows = np.lib.stride_tricks.sliding_window_view(self.data, kind.itemsize)[self.starts + offset]
        return np.ascontiguousarray(rows).view(kind)[:, 0]

    def rows(self, offset: int, size: int) -> np.ndarray:
        """(n, size) bytes, `offset` after each start."""
        if self.stride:
            return np.ndarray((len(self.starts), size), np.uint8, self.data, int(self.starts[0]) + offset,
                              (self.stride, 1))
        return np.lib.stride_tricks.sliding_window_view(self.data, size)[self.starts + offset]
