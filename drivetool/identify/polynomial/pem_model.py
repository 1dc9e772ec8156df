"""Polynomial models of one input and one output, and their prediction errors with exact gradients.

    A(q) y(t) = B(q)/F(q) (u(t) - u0) + C(q)/D(q) e(t)

arx: A, B. armax: A, B, C. innovations: A, B, C of one order, which is the innovations form in observer
coordinates (K = c - a). oe: B, F. bj: B, F, C, D. The dynamics are polynomials in (q - 1)/rate: at a high
sampling rate all poles crowd at q = 1, and coefficients of powers of q lose ten digits there.

Written here and not taken from a library: those on PyPI for such models (SIPPY) minimise by finite
differences, fit one record from rest, and give no covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
import scipy

from drivetool.identify.problem import Normal, Point

Kind = Literal["arx", "armax", "innovations", "oe", "bj"]
KINDS: tuple[Kind, ...] = ("oe", "bj", "arx", "armax", "innovations")
POLYNOMIALS = {"arx": "AB", "armax": "ABC", "innovations": "ABC", "oe": "BF", "bj": "BFCD"}


@dataclass(frozen=True)
class Structure:
    """Which polynomials there are and how long.

    order  of the dynamics; noise: of C and D where they are not the dynamics'
    extra  coefficients of B beyond the order: one for the mean speed over an interval
    rate   scale of the powers of q - 1
    """

    kind: Kind
    order: int
    noise: int = 2
    extra: int = 0
    rate: float = 1.0

    def size(self, letter: str) -> int:
        """Free coefficients of a polynomial."""
        if letter not in POLYNOMIALS[self.kind]:
            return 0
        if letter == "B":
            return self.order + self.extra
        return self.noise if letter == "D" or (letter == "C" and self.kind != "innovations") else self.order

    @property
    def names(self) -> tuple[str, ...]:
        """Of the coefficients: b1, b2 ... in the order of the values."""
        return tuple(f"{p.lower()}{i}" for p in POLYNOMIALS[self.kind] for i in range(1, self.size(p) + 1))

    @property
    def noise_parameters(self) -> int:
        """Coefficients that describe the noise alone."""
        return self.size("C") + self.size("D")

    def part(self, letter: str) -> slice:
        """Where the coefficients of a polynomial stand among the values."""
        start = 0
        for p in POLYNOMIALS[self.kind]:
            if p == letter:
                return slice(start, start + self.size(p))
            start += self.size(p)
        return slice(start, start)

    def basis(self, letter: str) -> tuple[np.ndarray, np.ndarray]:
        """(base (k+1,), T (k+1, k)) with powers of 1/q from zero up: polynomial = base + T values."""
        return _basis(self.size(letter), letter in "ABF" or self.kind == "innovations", letter != "B", self.rate)

    def polynomial(self, letter: str, values: np.ndarray) -> np.ndarray:
        """Coefficients over 1/q; a polynomial the structure lacks is one."""
        if not self.size(letter):
            return np.ones(1)
        base, table = self.basis(letter)
        return base + table @ values[self.part(letter)]

    @property
    def dynamics(self) -> str:
        """The polynomial that has the poles."""
        return "F" if self.kind in ("oe", "bj") else "A"


@lru_cache(maxsize=256)
def _basis(k: int, slow: bool, leading_one: bool, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """(base (k+1,), T (k+1, k)); slow: over powers of (q - 1)/rate, leading_one: with a leading one."""
    table = np.eye(k + 1, k, -1)
    for j in range(1, k + 1 if slow else 1):
        table[:, j - 1] = rate**j * _shifted_differences(j, k)
    base = np.zeros(k + 1)
    if leading_one:
        base = _shifted_differences(0, k) if slow else np.eye(1, k + 1)[0]
    base.setflags(write=False)
    table.setflags(write=False)
    return base, table


def _shifted_differences(shift: int, degree: int) -> np.ndarray:
    """(degree + 1,) of q^-shift (1 - q^-1)^(degree - shift)."""
    row = np.array([1.0])
    for _ in range(degree - shift):
        row = np.convolve(row, [1.0, -1.0])
    return np.concatenate([np.zeros(shift), row])


@dataclass(frozen=True)
class Stretch:
    """Torque u (n,) and output y (n,) of an uninterrupted stretch, and where it comes from."""

    u: np.ndarray
    y: np.ndarray
    name: str = ""


@dataclass(frozen=True)
class Prediction:
    """A polynomial model as a least-squares problem for `least_squares.solve`.

    Shared values: the coefficients. Start of a stretch: its initial state (order values), and u0, the torque
    that keeps it at rest.
    """

    structure: Structure
    stretches: tuple[Stretch, ...]
    size: np.ndarray
    held: np.ndarray | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Of the shared values."""
        return self.structure.names

    @property
    def low(self) -> np.ndarray:
        """No bounds."""
        return np.full(len(self.names), -np.inf)

    @property
    def high(self) -> np.ndarray:
        """No bounds."""
        return np.full(len(self.names), np.inf)

    @property
    def count(self) -> int:
        """Measured values."""
        return sum(len(s.y) for s in self.stretches)

    @property
    def unknowns(self) -> int:
        """Everything that is fitted."""
        return len(self.names) + len(self.stretches) * self.own

    @property
    def own(self) -> int:
        """Start values of a stretch."""
        return self.structure.order + 1

    @cached_property
    def heads(self) -> np.ndarray:
        """(order, order) from start values to the pulses that they represent.

        Differences of rising order: single pulses through slow poles are nearly collinear.
        """
        n = self.structure.order
        table = np.zeros((n, n))
        for m in range(n):
            table[: m + 1, m] = _shifted_differences(0, m)
        return table

    def zeros(self) -> tuple[np.ndarray, ...]:
        """Initial starts, all zero."""
        return tuple(np.zeros(self.own) for _ in self.stretches)

    def errors(self, values: np.ndarray, start: np.ndarray, stretch: Stretch) -> np.ndarray:
        """(n,) one-step prediction errors."""
        return self._signals(values, start, stretch)[-1]

    def simulated(self, values: np.ndarray, start: np.ndarray, stretch: Stretch) -> np.ndarray:
        """(n,) the output in a free run."""
        s = self.structure
        top, pulse = s.polynomial("B", values), _padded(self.heads @ start[:-1], len(stretch.u))
        bottom = s.polynomial(s.dynamics, values)
        return scipy.signal.lfilter(top, bottom, stretch.u - start[-1]) + scipy.signal.lfilter([1.0], bottom, pulse)

    def _signals(self, values: np.ndarray, start: np.ndarray, stretch: Stretch):
        """Polynomials, (torque, model output, equation error, prediction error)."""
        p = {letter: self.structure.polynomial(letter, values) for letter in "ABFCD"}
        v = stretch.u - start[-1]
        driven = scipy.signal.lfilter(p["B"], [1.0], v) + _padded(self.heads @ start[:-1], len(v))
        w = scipy.signal.lfilter([1.0], p["F"], driven)
        s = scipy.signal.lfilter(p["A"], [1.0], stretch.y) - w
        return p, v, w, s, scipy.signal.lfilter(p["D"], p["C"], s)

    def jacobian(self, values: np.ndarray, start: np.ndarray, stretch: Stretch) -> tuple[np.ndarray, np.ndarray]:
        """(errors (n,), derivatives (n, k + own))."""
        p, v, w, s, e = self._signals(values, start, stretch)
        kind, n = POLYNOMIALS[self.structure.kind], len(v)

        def through(x: np.ndarray) -> np.ndarray:
            """Effect of a change of the driven side on the errors, poles before zeros."""
            return scipy.signal.lfilter(p["D"], p["C"], scipy.signal.lfilter([1.0], p["F"], x))

        base = {"B": lambda: -through(v), "F": lambda: through(w),
                "A": lambda: scipy.signal.lfilter(p["D"], p["C"], stretch.y),
                "C": lambda: -scipy.signal.lfilter([1.0], p["C"], e),
                "D": lambda: scipy.signal.lfilter([1.0], p["C"], s)}
        if self.held is not None and self.held.all():
            columns = [np.zeros((n, len(self.names)))]  # only the start values are wanted, at a third of the cost
        else:
            columns = [_delayed_columns(base[letter](), len(table)) @ table
                       for letter in kind for _, table in (self.structure.basis(letter),)]
        columns.append(-_delayed_columns(through(_padded(np.ones(1), n)), self.own - 1) @ self.heads)
        columns.append(through(scipy.signal.lfilter(p["B"], [1.0], np.ones(n)))[:, None])
        return e, np.hstack(columns)

    # The interface of least_squares.solve.

    def normal(self, point: Point, gains: object = None) -> Normal:
        """Normal equations at a point."""
        k = len(self.names)
        shared, slope, cost = np.zeros((k, k)), np.zeros(k), 0.0
        cross, own, own_slope = [], [], []
        for start, stretch in zip(point.starts, self.stretches, strict=True):
            e, j = self.jacobian(point.values, start, stretch)
            if self.held is not None:
                j[:, :k][:, self.held] = 0.0
            total = j.T @ j
            push = j.T @ e
            shared, slope, cost = shared + total[:k, :k], slope + push[:k], cost + float(e @ e)
            cross.append(total[:k, k:])
            own.append(total[k:, k:])
            own_slope.append(push[k:])
        return Normal(shared, tuple(cross), tuple(own), slope, tuple(own_slope), cost)

    def cost(self, point: Point, gains: object = None) -> float:
        """Sum of squared errors; infinite where the predictor is unstable."""
        c = self.structure.polynomial("C", point.values)
        if len(c) > 1 and np.abs(np.roots(c)).max() >= 1.0:
            return np.inf
        total = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for start, stretch in zip(point.starts, self.stretches, strict=True):
                e = self.errors(point.values, start, stretch)
                total += float(e @ e)
        return total if np.isfinite(total) else np.inf

    def moved(self, point: Point, step: np.ndarray, own: Sequence[np.ndarray]) -> Point:
        """The point after a step."""
        return Point(point.values + step, tuple(a + b for a, b in zip(point.starts, own, strict=True)))


def _padded(head: np.ndarray, n: int) -> np.ndarray:
    """(n,) zero but for its first values."""
    x = np.zeros(n)
    x[: len(head)] = head
    return x


def _delayed_columns(x: np.ndarray, count: int) -> np.ndarray:
    """(n, count) a signal delayed by 0, 1, ... samples."""
    table = np.zeros((len(x), count))
    for j in range(count):
        table[j:, j] = x[: len(x) - j]
    return table
