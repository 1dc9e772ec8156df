"""One linear step from where a model is: where it would go, what it would gain, what is told of each value."""

from __future__ import annotations

import numpy as np

from drivetool.identify.estimate import inverted
from drivetool.identify.problem import Normal, Problem, schur

SINGULAR = 1e-10  # share of the largest eigenvalue below which a direction counts as none
IMITATED = 1e-9  # share of its own square that must be left of an amplitude: less is rounding


def linear_step(problem: Problem, normal: Normal, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(k,) Gauss-Newton step of the parameters that move, their standard deviations, log likelihood it gains.

    What others imitate to the last digit has no standard deviation that is a number.
    """
    matrix, slope, _ = schur(normal)
    i = np.flatnonzero(moves & (np.diag(matrix) > 0.0))
    step, std = np.zeros(len(slope)), np.full(len(slope), np.inf)
    size = np.sqrt(np.diag(matrix)[i])
    inverse, lost = inverted(matrix[np.ix_(i, i)] / np.outer(size, size), SINGULAR)
    step[i] = -(inverse @ (slope[i] / size)) / size
    variance = normal.cost / max(problem.count - problem.unknowns, 1)
    std[i] = np.where(lost, np.inf, np.sqrt(variance * np.maximum(np.diag(inverse), 0.0)) / size)
    return step, std, float(-0.5 * slope @ step / variance)


def alone(problem: Problem, normal: Normal, own: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(k,) standard deviation of each of a cause's own amplitudes where its others are zero; infinite: not told.

    own, rest  which amplitudes are the cause's, and which other parameters are free to imitate it
    """
    matrix, _, _ = schur(normal)
    std = np.full(len(matrix), np.inf)
    known = np.diag(matrix) > 0.0
    i, j = np.flatnonzero(own & known), np.flatnonzero(rest & known)
    size = np.sqrt(np.where(known, np.diag(matrix), 1.0))
    unit = matrix / np.outer(size, size)
    inverse, _ = inverted(unit[np.ix_(j, j)], SINGULAR)
    left = 1.0 - np.sum((unit[np.ix_(i, j)] @ inverse) * unit[np.ix_(i, j)], axis=1)
    variance = normal.cost / max(problem.count - problem.unknowns, 1)
    told = left > IMITATED
    std[i[told]] = np.sqrt(variance / left[told]) / size[i[told]]
    return std
