"""From resonances and notches to a chain: inertias and stiffnesses in closed form.

Without damping the response of a chain at its first body is G(s) = 1/(J s) prod (1 + s^2/z^2)/(1 + s^2/p^2),
and 1/G is a continued fraction whose terms are the bodies and shafts one after another:
1/G = J1 s + 1/(s/k1 + 1/(J2 s + 1/(s/k2 + ...))).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def chain_of(total: float, notches: Sequence[float], resonances: Sequence[float],
             ) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """(inertias, stiffnesses) of the chain, all referred to its first body; empty if there is none.

    total                inertia of all bodies together
    notches, resonances  [rad/s], rising, as many of each; a chain has them in turn, a notch first
    source               Cauer 1926, the continued fraction of a reactance; for two masses this is Tallfors
                         2005, (5.11)-(5.16)
    """
    z, p = np.asarray(notches, float), np.asarray(resonances, float)
    merged = np.ravel(np.column_stack([z, p])) if len(z) == len(p) else np.array([1.0, 0.0])
    if total <= 0.0 or np.any(np.diff(merged) <= 0.0) or np.any(merged <= 0.0):
        return (), ()
    # Over x = s^2, scaled so that the numbers stay near one: 1/G = s top(x)/bottom(x).
    scale = p[-1] ** 2 if len(p) else 1.0
    top, bottom = np.array([total]), np.array([1.0])
    for a, b in zip(p**2 / scale, z**2 / scale, strict=True):
        top, bottom = np.convolve(top, [1.0 / a, 1.0]), np.convolve(bottom, [1.0 / b, 1.0])
    inertias, stiffnesses = [], []
    for _ in range(len(p)):
        j = top[0] / bottom[0]
        inertias.append(float(j))
        top = (top - j * bottom)[1:]  # its first coefficient is zero by construction
        # The remainder is s top/bottom; its inverse bottom/(s top) begins with s/k.
        ratio = bottom[0] / top[0]
        stiffnesses.append(float(scale / ratio))
        bottom = (bottom - ratio * np.concatenate([top, [0.0]]))[1:]
    inertias.append(float(top[0] / bottom[0]))
    if min(inertias + stiffnesses) <= 0.0 or not np.all(np.isfinite(inertias + stiffnesses)):
        return (), ()
    return tuple(inertias), tuple(stiffnesses)
