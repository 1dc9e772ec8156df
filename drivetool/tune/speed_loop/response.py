"""The step response of a closed loop as a sum of modes, with exact figures: extrema and closed integrals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from drivetool.drive.arrays import ModalSums, address_of, packed
from drivetool.drive.compile import function

MAX_EXTREMA = 4096  # stored. A choice: a mode of damping ratio 1e-3 has fewer before it has decayed to 1e-5.


def absolute_integrals(rates: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(m, 2) integral of |signal| from 0 to infinity, and the largest |integral up to t|, of m signals.

    rates, weights  (m, n) complex, as of `Modes`
    returns         infinite where a mode does not decay
    """
    found = np.full((len(rates), 2), np.inf)
    decaying = (rates.real.max(axis=1) < 0.0) & np.isfinite(weights).all(axis=1)
    found[decaying] = _follow(rates[decaying], weights[decaying])[0]
    return found


def _follow(rates: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both integrals (m, 2) of m signals, and times and values (2, extrema) of the extrema of the last."""
    magnitudes = np.abs(weights)
    # One mode per conjugate pair, with twice its weight, and no negligible ones.
    kept = (magnitudes > 1e-15 * magnitudes.max(axis=1, keepdims=True)) & (rates.imag >= 0.0)
    order = np.argsort(~kept, axis=1, kind="stable")
    rates, weights = (np.take_along_axis(z, order, axis=1) for z in (rates, weights * (1.0 + np.sign(rates.imag))))
    sums = ModalSums(
        *(z.view(float).reshape(*z.shape, 2) for z in (rates, weights, weights * rates, weights / rates)),
        count=kept.sum(axis=1), step=np.empty((2, rates.shape[1], 2)), extrema=np.empty((2, MAX_EXTREMA)),
        found=np.empty((len(rates), 2)))
    table = packed(sums)
    n = function("extrema")(address_of(table))
    return sums.found, sums.extrema[:, :n]


@dataclass(frozen=True)
class Modes:
    """A signal after a unit step of load torque, minus its final value: sum weights exp(rates t).

    rates, weights  (n,) complex, in conjugate pairs
    rest            final value
    """

    rates: np.ndarray
    weights: np.ndarray
    rest: float = 0.0

    @property
    def stable(self) -> bool:
        """Whether it decays."""
        return bool(np.max(self.rates.real) < 0.0)

    def at(self, time: np.ndarray) -> np.ndarray:
        """(n,) the signal at times (n,) [s], its rest included."""
        return np.real(np.exp(np.outer(time, self.rates)) @ self.weights) + self.rest

    @cached_property
    def integrals_and_extrema(self) -> tuple[np.ndarray, np.ndarray]:
        """Integrals (2,) as of `absolute_integrals`; times and values less the rest (2, extrema) after t = 0."""
        found, extrema = _follow(self.rates[None], self.weights[None])
        return found[0], extrema

    def last_outside(self, band: float) -> float:
        """Last time at which |signal - rest| exceeds the band; 0 if it never does."""
        times, values = np.c_[[0.0, self.weights.sum().real], self.integrals_and_extrema[1]]
        out = np.flatnonzero(np.abs(values) > band)
        if not len(out):
            return 0.0
        k = out[-1]
        level = np.copysign(band, values[k])
        end = times[k + 1] if k + 1 < len(times) else times[k] + 60.0 / -np.max(self.rates.real)
        return scipy.optimize.brentq(lambda t: (np.exp(self.rates * t) @ self.weights).real - level,
                                     times[k], end, xtol=1e-14 * end, rtol=1e-14)


def decompose(a: np.ndarray, b: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modes of y = rows x, dx/dt = a x + b from rest, minus the final value.

    a        (m, n, n); b (n,); rows (ny, n)
    returns  rates (m, n), weights (m, ny, n), complex
    """
    rates, vectors = np.linalg.eig(a)
    rates, vectors = rates.astype(complex), vectors.astype(complex)
    steady_state = np.linalg.solve(a, np.broadcast_to(b, a.shape[:-1])[..., None])
    with np.errstate(all="ignore"):
        coordinates = np.linalg.solve(vectors, steady_state.astype(complex))[..., 0]
    return rates, (rows @ vectors) * coordinates[:, None, :]
