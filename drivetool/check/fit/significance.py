"""Significance of a gain in log likelihood: its p-value, corrected for the number of hypotheses searched."""

from __future__ import annotations

import numpy as np
import scipy

# Bonferroni factor: hypotheses of one search that a record can distinguish, at most (a choice).
SEARCHED_HYPOTHESES = 1e5
# Log likelihood below which no cause is fitted or tested: one parameter gains 1.92 by chance at 95 % (Wilks
# 1938).
MIN_TESTABLE_GAIN = 2.0


def neg_log_p_corrected(lead: float, further: int) -> float:
    """-ln of the Bonferroni-corrected p-value of a lead in log likelihood by so many further parameters."""
    return float(-log_chi2_tail(2.0 * max(lead, 0.0), max(further, 1)) - np.log(SEARCHED_HYPOTHESES))


def log_chi2_tail(x: float, degrees: int) -> float:
    """Log of the upper tail of a chi-square at x; by its series where the tail underflows."""
    half, there = 0.5 * degrees, float(scipy.special.gammaincc(0.5 * degrees, 0.5 * x))
    if there > 1e-250:
        return float(np.log(there))
    y = 0.5 * x
    return float((half - 1.0) * np.log(y) - y - scipy.special.gammaln(half) + np.log1p((half - 1.0) / y))
