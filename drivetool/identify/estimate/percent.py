"""The fit of a model in percent, and its words."""

from __future__ import annotations

import numpy as np


def fit_percent(measured: np.ndarray, modelled: np.ndarray) -> float:
    """100 (1 - |y - y^| / |y - mean y|) over the samples that both have; NaN for a constant signal."""
    good = np.isfinite(measured) & np.isfinite(modelled)
    y, e = measured[good], (measured - modelled)[good]
    # By its range: rounding of the mean gives a constant signal a spurious variance.
    deviation = np.linalg.norm(y - y.mean()) if len(y) and np.ptp(y) > 0.0 else 0.0
    return float(100.0 * (1.0 - np.linalg.norm(e) / deviation)) if deviation > 0.0 else float("nan")


def fit_text(percent: float, digits: str = ".4g") -> str:
    """'93.12 %', or why there is no figure."""
    return "undefined (the signal is constant)" if np.isnan(percent) else f"{percent:{digits}} %"
