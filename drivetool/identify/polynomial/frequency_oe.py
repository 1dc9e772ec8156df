"""Output error in the frequency domain: a polynomial model through the measured response."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.errors import NotEnoughData
from drivetool.identify.frequency import (
    MAX_CHI_SQUARE,
    LineProblem,
    Response,
    line_weights,
    noise_covariance,
    sandwich,
)
from drivetool.identify.polynomial.pem_fit import PemFit
from drivetool.identify.polynomial.pem_model import Structure
from drivetool.identify.problem import Point, solve


@dataclass(frozen=True)
class PolynomialResponse:
    """G = B/F over its coefficients, in the place of a HeldResponse.

    step  sample interval [s]; frequency (n,) Hz
    """

    structure: Structure
    step: float
    frequency: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Of the coefficients."""
        return self.structure.names

    def at(self, values: Sequence[float], gradient: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """((n,) complex G, (n, k) complex dG)."""
        s, values = self.structure, np.asarray(values, float)
        delay = np.exp(-2j * np.pi * self.frequency * self.step)  # 1/q
        top, bottom = (np.polyval(s.polynomial(p, values)[::-1], delay) for p in "BF")
        g, slopes = top / bottom, np.zeros((len(delay), len(values) if gradient else 0), complex)
        for letter, factor in (("B", 1.0 / bottom), ("F", -g / bottom)) if gradient else ():
            _, table = s.basis(letter)
            slopes[:, s.part(letter)] = factor[:, None] * (delay[:, None] ** np.arange(len(table)) @ table)
        return g, slopes


def fit_to_response(fit: PemFit, r: Response, step: float, weighting: str) -> tuple[PemFit, float]:
    """An output-error model moved from the time domain to the lines of a response.

    fit        in the time domain: the start
    r          of the motor's speed, as it is sampled
    weighting  variance (maximum likelihood), or coherence: V = sum (coherence/f) |ln G - ln G^|^2
    returns    the moved model with its covariance, and chi-square per degree under the variances
    raises     NotEnoughData: fewer coherent lines than coefficients
    source     bus driveline paper: a third-order output-error model in the frequency domain
    """
    good = r.coherence >= 0.5
    k = len(fit.values)
    if good.sum() < k + 2:
        raise NotEnoughData(f"at least {k + 2} excited lines with a coherence above 0.5", f"{int(good.sum())}",
                            "Excite more lines, widen --band, or lower --order.")
    r = r.at(good)
    model = PolynomialResponse(fit.structure, step, r.frequency)

    def problem(kind: str) -> LineProblem:
        weight, logarithm = line_weights(r, kind)
        return LineProblem(model, r.g, weight, logarithm, r.bins, np.full(k, -np.inf), np.full(k, np.inf),
                           0.3 * np.abs(fit.values) + 1e-3)

    first = solve(problem("coherence"), Point(fit.values, ()), max_iterations=200, relative=1e-12)
    best = solve(problem("variance"), first.point, max_iterations=200, relative=1e-12)
    chi = best.cost / max(problem("variance").count - k, 1)
    chosen = problem(weighting)
    solution = first if weighting == "coherence" else best
    covariance = sandwich(chosen, solution) if chi >= MAX_CHI_SQUARE else noise_covariance(chosen, solution, r)
    point = replace(fit.solution.point, values=solution.point.values)
    held = replace(fit.problem, held=np.ones(k, bool))
    return replace(fit, solution=replace(solve(held, point, max_iterations=5, damping=1e-9),
                                         iterations=solution.iterations),
                   covariance=covariance), chi
