"""A number with its gradient over the free parameters: derivatives without differences."""

from __future__ import annotations

import numpy as np


class Dual:
    """value v and gradient d (nq,); arithmetic follows the chain rule."""

    __slots__ = ("d", "v")

    def __init__(self, v: float, d: np.ndarray):
        self.v, self.d = v, d

    def jet(self) -> np.ndarray:
        """(1 + nq,) value, then gradient."""
        return np.concatenate(([self.v], self.d))

    def __add__(self, other: Dual | float) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.v + other.v, self.d + other.d)
        return Dual(self.v + other, self.d)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.v, -self.d)

    def __sub__(self, other: Dual | float) -> Dual:
        return self + (-other)

    def __rsub__(self, other: float) -> Dual:
        return -self + other

    def __mul__(self, other: Dual | float) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.v * other.v, self.v * other.d + other.v * self.d)
        return Dual(self.v * other, self.d * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Dual | float) -> Dual:
        if isinstance(other, Dual):
            q = self.v / other.v
            return Dual(q, (self.d - q * other.d) / other.v)
        return Dual(self.v / other, self.d / other)

    def __rtruediv__(self, other: float) -> Dual:
        q = other / self.v
        return Dual(q, -q / self.v * self.d)
