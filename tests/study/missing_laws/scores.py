"""Errors, intervals and their figures from the rows of a results file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

RESAMPLES = 4000  # of a bootstrap; ends of a 99 % interval then rest on 20 of them each
BOOTSTRAP_SEED = 20
FAR = 3.0  # half-widths beyond which an interval misleads
ROUNDING = 1e-6  # of the truth; smaller errors are those of the simulator and of written digits, and count as none


@dataclass(frozen=True)
class Score:
    """One estimator on one record; errors and half-widths are absolute, NaN where there is no answer or interval.

    inertia       error over the true inertia
    friction      root mean square error of the curve over its mean, over the speeds visited
    idle          error of the idle torque over rated torque
    over          (4,) error over half-width: inertia, and friction at the three marks against the nearest line
    inertia_half  half-width over the true inertia
    friction_half half-width at the middle mark over the mean of the curve
    seconds       of processor time
    """

    inertia: float
    friction: float
    idle: float
    over: np.ndarray
    inertia_half: float
    friction_half: float
    seconds: float


def score(row: Mapping) -> Score:
    """What a row is worth; a failed fit has errors without bound, so that it counts in every quantile."""
    if row.get("failed") or any(value is None for value in row["value"]):
        return Score(np.inf, np.inf, np.inf, np.full(4, np.nan), np.nan, np.nan, row["seconds"])
    truth, (inertia, viscous, coulomb, idle) = row["truth"], row["value"]
    speeds, curve = np.array(truth["speeds"]), np.array(truth["curve"])
    marks, mean = np.array(truth["marks"]), float(np.mean(curve))
    wrong = viscous * speeds + coulomb - curve
    half, friction_half = half_widths(row, marks)
    nearest = truth["line"][0] * marks + truth["line"][1]
    true, halves = np.array([truth["inertia"], *nearest]), np.array([half, *friction_half])
    errors = np.abs(np.array([inertia, *(viscous * marks + coulomb)]) - true)
    over = np.divide(errors, halves, out=np.full(4, np.inf), where=halves != 0.0)
    return Score(abs(inertia / truth["inertia"] - 1.0), float(np.sqrt(np.mean(wrong**2))) / mean,
                 abs(idle - truth["idle"]) / truth["rated"],
                 np.where(errors > ROUNDING * np.abs(true), over, 0.0 * halves), half / truth["inertia"],
                 float(friction_half[1]) / mean, row["seconds"])


def half_widths(row: Mapping, marks: np.ndarray) -> tuple[float, np.ndarray]:
    """(half the stated 95 % interval of the inertia, (3,) of friction at the marks), NaN where none is stated.

    The friction's interval is as many of its stds as the tool's own intervals are of theirs.
    """
    half = np.array([np.nan if not ends or None in ends else 0.5 * (ends[1] - ends[0]) for ends in row["ci95"]])
    link = row["correlation"][1][2]
    covariance = half[1] * half[2] * (np.nan if link is None else link)
    square = (half[1] * marks) ** 2 + half[2] ** 2 + 2.0 * covariance * marks
    return float(half[0]), np.sqrt(np.maximum(square, 0.0))


def share(hits: int, of: int, level: float = 0.99) -> tuple[float, float, float]:
    """(share, lower end, upper end) by Clopper and Pearson 1934, two-sided."""
    if of == 0:
        return float("nan"), 0.0, 1.0
    tail = 0.5 * (1.0 - level)
    low = 0.0 if hits == 0 else float(beta.ppf(tail, hits, of - hits + 1))
    high = 1.0 if hits == of else float(beta.ppf(1.0 - tail, hits + 1, of - hits))
    return hits / of, low, high


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


@dataclass(frozen=True)
class Coverage:
    """Shares of records whose interval holds: (share, low, high), and the number of records without an interval."""

    inertia: tuple[float, float, float]
    friction: tuple[float, float, float]
    far: tuple[float, float, float]
    n: int
    without: int


def coverage(scores: Iterable[Score], level: float = 0.99) -> Coverage:
    """Of the inertia; of friction, the mean over the three marks; and errors of FAR half-widths or more.

    The marks of one record go together, so the interval of friction is that of as many records.
    """
    over = np.array([each.over for each in scores]).reshape(-1, 4)
    stated = over[~np.isnan(over).any(axis=1)]
    n = len(stated)
    held = stated <= 1.0
    marks = held[:, 1:].mean() if n else float("nan")
    low, high = _between(float(held[:, 1:].sum()) / 3.0, n, level)
    far = int(np.sum((stated[:, [0, 2]] > FAR).any(axis=1)))
    return Coverage(share(int(held[:, 0].sum()), n, level), (float(marks), low, high), share(far, n, level), n,
                    len(over) - n)


def _between(hits: float, of: int, level: float) -> tuple[float, float]:
    """Clopper and Pearson's ends for a number of hits that is a mean, by their beta quantiles."""
    if of == 0:
        return 0.0, 1.0
    tail = 0.5 * (1.0 - level)
    return (0.0 if hits == 0.0 else float(beta.ppf(tail, hits, of - hits + 1.0)),
            1.0 if hits >= of else float(beta.ppf(1.0 - tail, hits + 1.0, of - hits)))
