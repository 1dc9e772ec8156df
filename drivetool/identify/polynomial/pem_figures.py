"""Figures of a drive by a polynomial model: poles, zeros, notches, resonances, response, with their std.

Every figure comes with its exact gradient over the coefficients; the std follows by the delta method.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drivetool.identify.estimate import std_by_gradient
from drivetool.identify.polynomial.pem_fit import PemFit
from drivetool.identify.polynomial.pem_model import Structure

# Damping ratio, about 1/sqrt(2), below which a pair has a resonance or a notch in its response.
MAX_RINGING_DAMPING = 0.7
MAX_NYQUIST_SHARE = 0.8  # of the Nyquist frequency, a choice; zeros beyond it come from sampling


@dataclass(frozen=True)
class Root:
    """A pole or zero in continuous time, s = ln(z)/step.

    gradient  (k,) complex: of s over the coefficients
    """

    s: complex
    gradient: np.ndarray


@dataclass(frozen=True)
class RootPair:
    """A pair of complex roots: frequency [rad/s] and damping ratio with std.

    both gradients (k,) over the coefficients
    """

    rad_s: float
    damping: float
    d_rad_s: np.ndarray
    d_damping: np.ndarray


def roots_of(structure: Structure, values: np.ndarray, letter: str, step: float) -> list[Root]:
    """The roots of a polynomial, slow ones first, those at z = 0 left out."""
    part, rate = structure.part(letter), structure.rate
    k = part.stop - part.start
    lead = np.array([1.0]) if letter != "B" else np.empty(0)
    p = np.concatenate([lead, values[part]])
    while letter == "B" and len(p) > 1 and p[0] == 0.0:
        p = p[1:]
    found = []
    slope = np.polyder(p)
    for x in np.roots(p):
        z = 1.0 + rate * x
        below = np.polyval(slope, x)
        if abs(z) < 1e-12 or below == 0.0:
            continue
        gradient = np.zeros(len(values), complex)
        gradient[part] = -(x ** np.arange(k - 1, -1, -1)) / below
        found.append(Root(complex(np.log(z + 0j)) / step, gradient * rate / z / step))
    return sorted(found, key=lambda r: (abs(r.s), r.s.imag))


def pairs_of(roots: list[Root], step: float) -> list[RootPair]:
    """Weakly damped pairs within the band, by frequency."""
    found = []
    for r in roots:
        w = abs(r.s)
        if r.s.imag <= 0.0 or r.s.imag > MAX_NYQUIST_SHARE * np.pi / step or abs(
                r.s.real) > MAX_RINGING_DAMPING * w:
            continue
        dw = (np.conj(r.s) * r.gradient).real / w
        zeta = -r.s.real / w
        found.append(RootPair(float(w), float(zeta), dw, -r.gradient.real / w - zeta * dw / w))
    return sorted(found, key=lambda p: p.rad_s)


@dataclass(frozen=True)
class ModelFigures:
    """Poles, zeros and pairs of a fitted model, over its covariance."""

    fit: PemFit
    step: float
    poles: list[Root]
    zeros: list[Root]
    resonances: list[RootPair]
    notches: list[RootPair]

    @cached_property
    def unstable(self) -> str:
        """Unstable poles, in words; empty if there are none.

        A real one that is not distinguishable from an integrator does not count.
        """
        bad, longest = [], max(len(d.y) for d in self.fit.problem.stretches) * self.step
        for r in self.poles:
            if r.s.real <= 0.0:
                continue
            std = self.std(r.gradient.real)
            slow = abs(r.s.imag) == 0.0 and r.s.real * longest < 0.5
            if slow and (std is None or r.s.real < 3.0 * std or r.s.real * longest < 0.05):
                continue
            bad.append(f"{r.s.real:.3g}{r.s.imag:+.3g}j" if r.s.imag else f"{r.s.real:.3g}")
        return ", ".join(bad)

    def std(self, gradient: np.ndarray) -> float | None:
        """By the delta method; None where the covariance has no value."""
        return std_by_gradient(gradient, self.fit.covariance)

    def pair(self, p: RootPair) -> dict[str, object]:
        """A pair as plain numbers."""
        std = self.std(p.d_rad_s)
        return {"rad_s": {"value": p.rad_s, "std": std},
                "hz": {"value": p.rad_s / (2 * np.pi), "std": None if std is None else std / (2 * np.pi)},
                "damping_ratio": {"value": p.damping, "std": self.std(p.d_damping)}}

    def response(self, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((n,) complex G, (n,) std of its magnitude) at frequencies [Hz], held input."""
        g, slopes = self.slopes(frequency)
        radial = (slopes * np.abs(g)[:, None]).real
        variance = np.einsum("ij,jk,ik->i", radial, self.fit.covariance, radial)
        return g, np.sqrt(np.maximum(variance, 0.0))

    def slopes(self, frequency: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((n,) complex G, (n, k) change of ln G with the coefficients) at frequencies [Hz]."""
        s, values = self.fit.structure, self.fit.values
        z = np.exp(-2j * np.pi * np.asarray(frequency) * self.step)  # 1/q
        bottom_letter = s.dynamics
        top = np.polyval(s.polynomial("B", values)[::-1], z)
        bottom = np.polyval(s.polynomial(bottom_letter, values)[::-1], z)
        g = top / bottom
        gradient = np.zeros((len(z), len(values)), complex)
        with np.errstate(divide="ignore", invalid="ignore"):  # a model without response has no ln G
            for letter, factor in (("B", 1.0 / top), (bottom_letter, -1.0 / bottom)):
                _, table = s.basis(letter)
                powers = z[:, None] ** np.arange(len(table))
                gradient[:, s.part(letter)] = factor[:, None] * (powers @ table)
        return g, gradient


def figures_of(fit: PemFit, step: float) -> ModelFigures:
    """Poles, zeros and pairs of a fit."""
    s, values = fit.structure, fit.values
    poles, zeros = roots_of(s, values, s.dynamics, step), roots_of(s, values, "B", step)
    return ModelFigures(fit, step, poles, zeros, pairs_of(poles, step), pairs_of(zeros, step))
