"""Errors and coverage of intervals from the rows of a results file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from tests.study.shared.figures import held, share

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
    far = int(np.sum((stated[:, [0, 2]] > FAR).any(axis=1)))
    return Coverage(held(stated[:, :1], level), held(stated[:, 1:], level), share(far, len(stated), level),
                    len(stated), len(over) - len(stated))
