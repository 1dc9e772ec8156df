"""Criteria of a load-step response: integrals of the error, all in closed form.

In modal coordinates the Lyapunov equation is diagonal, so integrals of squares are double sums over
the modes; the absolute value is integrated lobe by lobe (speed_loop/response.py).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import factorial

import numpy as np

from drivetool.errors import BadOption
from drivetool.tune.optimisation.sections import CriterionSection
from drivetool.tune.speed_loop import Loop, Modes, Settings, absolute_integrals, decompose

CRITERION_NAMES = ("IAE", "ISE", "IE", "ITSE", "IT2SE")
MAX_TIME_POWER = 16  # power of time; beyond it the figure depends on the slowest mode only


class Criterion(CriterionSection):
    """An integral criterion of the response to a unit step of load torque.

    name     IE: |int e|; IAE: int |e|; ISE: int e^2; IT<k>SE: int t^k e^2, ITSE for k = 1
    weights  signal -> weight. Signals are load_speed, motor_speed
             and <motor>_torque, the latter minus its value at rest; weighted errors are summed
             for IE and IAE, their squares for the others
    source   Tallfors 2005, (3.1) and sec. 3.3; the minimum printed in its figure 3.8 shows that
             the power of time is outside the square
    """

    @property
    def power(self) -> int | None:
        """Power of time in a criterion of squares; None for the others."""
        if self.name in ("IE", "IAE"):
            return None
        return 0 if self.name == "ISE" else int(re.fullmatch(r"IT(\d*)SE", self.name)[1] or 1)


def criterion(name: str, weights: Mapping[str, float] | None = None) -> Criterion:
    """A checked criterion.

    raises  BadOption: an unknown name, a power of time too high, a negative weight, none above zero
    """
    found = re.fullmatch(r"IE|ISE|IAE|IT(\d*)SE", name.upper())
    if not found or int(found[1] or 1) > MAX_TIME_POWER:
        raise BadOption(f"a criterion, IT<k>SE up to k = {MAX_TIME_POWER}", f"'{name}'", "Choose one.",
                        CRITERION_NAMES)
    weights = {"load_speed": 1.0} | dict(weights or {})
    wrong = [f"{k}={v:g}" for k, v in weights.items() if not 0.0 <= v < np.inf]
    if wrong or not any(weights.values()):
        raise BadOption("non-negative weights, at least one of them positive", ", ".join(wrong) or "only zeros",
                        "Correct --weight.")
    return Criterion(name.upper(), {k: v for k, v in weights.items() if v > 0.0})


def criterion_values(loop: Loop, wanted: Criterion, gain: np.ndarray, integral_time: np.ndarray,
           second: np.ndarray) -> np.ndarray:
    """(m,) the criterion of m settings, each (m,); infinite where the loop is unstable."""
    names = list(wanted.weights)
    rates, weights = decompose(loop.matrices(gain, integral_time, second), loop.b,
                               loop.outputs(names, gain, integral_time, second))
    total = np.zeros(len(rates))
    for k, name in enumerate(names):
        total += _closed_integral(wanted, rates, weights[:, k] * wanted.weights[name])
    total[~(rates.real.max(axis=1) < 0.0) | ~np.isfinite(total)] = np.inf
    return total


def criterion_value(loop: Loop, wanted: Criterion, settings: Settings) -> float:
    """The criterion of one setting."""
    return float(criterion_values(loop, wanted, *settings.columns)[0])


def impact_drops(loop: Loop, names: Sequence[str], gain: np.ndarray, integral_time: np.ndarray,
                 second: np.ndarray) -> np.ndarray:
    """(m, ny) largest |integral| of signals at m settings; infinite where unstable."""
    rates, weights = decompose(loop.matrices(gain, integral_time, second), loop.b,
                               loop.outputs(names, gain, integral_time, second))
    return np.column_stack([absolute_integrals(rates, weights[:, k])[:, 1] for k in range(len(names))])


def signals(loop: Loop, settings: Settings, names: Sequence[str]) -> dict[str, Modes]:
    """Responses of signals to a unit step of load torque."""
    rates, weights = decompose(loop.matrices(*settings.columns), loop.b, loop.outputs(names, *settings.columns))
    return {name: Modes(rates[0], weights[0, k], float(-weights[0, k].sum().real)) for k, name in enumerate(names)}


def _closed_integral(wanted: Criterion, rates: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(m,) over rows of modes."""
    if wanted.name == "IE":
        return np.abs((weights / rates).sum(axis=1).real)
    if wanted.name == "IAE":
        return absolute_integrals(rates, weights)[:, 0]
    n = wanted.power
    pairs = -(rates[:, :, None] + rates[:, None, :])
    return factorial(n) * np.einsum("mi,mij,mj->m", weights, pairs ** -(n + 1.0), weights).real
