"""What chance makes of a gain: how seldom parameters that mean nothing lead as far, and what is too little."""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincc, gammaln

LOOKED = 1e5  # things that a search looks at and that a record can tell apart, at most
TRIFLE = 2.0  # log likelihood below which a cause is not fitted or judged


def unlikely(lead: float, further: int) -> float:
    """Natural log of one over the share of records without a cause in which one of so many parameters leads so."""
    return float(-log_tail(2.0 * max(lead, 0.0), max(further, 1)) - np.log(LOOKED))


def log_tail(x: float, degrees: int) -> float:
    """Log of the share of a chi-square above x; far out, where the share is no number any more, by its series."""
    half, there = 0.5 * degrees, float(gammaincc(0.5 * degrees, 0.5 * x))
    if there > 1e-250:
        return float(np.log(there))
    y = 0.5 * x
    return float((half - 1.0) * np.log(y) - y - gammaln(half) + np.log1p((half - 1.0) / y))
