"""Shares, quantiles and ratios of quantiles, with their intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import beta

RESAMPLES = 4000  # of a bootstrap; ends of a 99 % interval then rest on 20 of them each
BOOTSTRAP_SEED = 20


def share(hits: float, of: int, level: float = 0.99) -> tuple[float, float, float]:
    """(share, lower end, upper end) by Clopper and Pearson 1934, two-sided.

    hits  a whole number, or a mean of such: then by their beta quantiles all the same
    """
    if of == 0:
        return float("nan"), 0.0, 1.0
    tail = 0.5 * (1.0 - level)
    low = 0.0 if hits == 0 else float(beta.ppf(tail, hits, of - hits + 1))
    high = 1.0 if hits >= of else float(beta.ppf(1.0 - tail, hits + 1, of - hits))
    return hits / of, low, high


def held(over: np.ndarray, level: float = 0.99) -> tuple[float, float, float]:
    """(share, lower end, upper end) of errors within their half-widths.

    over  (n, k) error over half-width at k places of n records; the places of one record go together, so that
          the interval is that of n records
    """
    return share(float(np.sum(over <= 1.0)) / max(over.shape[1], 1), len(over), level)


def quantile(values: np.ndarray, q: float) -> np.ndarray | float:
    """Of the last axis, linear between neighbours; infinite where the upper of them is, NaN of nothing."""
    if values.shape[-1] == 0:
        return float("nan")
    ordered = np.sort(values, axis=-1)
    at = q * (values.shape[-1] - 1)
    low, high = ordered[..., int(np.floor(at))], ordered[..., int(np.ceil(at))]
    with np.errstate(invalid="ignore"):  # between two that are infinite
        return np.where(low == high, low, low + (at % 1.0) * (high - low))[()]


def ratio(mine: np.ndarray, theirs: np.ndarray, q: float = 0.5,
          strata: Sequence[str] | None = None) -> tuple[float, float, float]:
    """(quantile of mine over that of theirs, ends of its 99 % interval): a paired bootstrap over records.

    mine, theirs  (n,) errors on the same records
    strata        (n,) kinds of record, each of which keeps its number
    """
    kinds = np.zeros(len(mine)) if strata is None else np.unique(list(strata), return_inverse=True)[1]
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    groups = [np.flatnonzero(kinds == kind) for kind in np.unique(kinds)]
    chosen = np.hstack([rng.choice(group, (RESAMPLES, len(group))) for group in groups])
    with np.errstate(invalid="ignore", divide="ignore"):
        drawn = quantile(mine[chosen], q) / quantile(theirs[chosen], q)
        value = quantile(mine, q) / quantile(theirs, q)
    drawn = drawn[~np.isnan(drawn)]
    return tuple(float(x) for x in (value, quantile(drawn, 0.005), quantile(drawn, 0.995)))
