"""One Gauss-Newton step of a model: the step, its gain, and the standard deviation of each value."""

from __future__ import annotations

import numpy as np

from drivetool.identify.estimate import inverted
from drivetool.identify.problem import Normal, Problem, schur

# Of the largest, below which a direction is not identifiable: above rounding of the scaled matrix.
MIN_EIGENVALUE_SHARE = 1e-10
# Share of an amplitude's information that the other parameters must leave: less is rounding.
MIN_UNEXPLAINED_SHARE = 1e-9


def linear_step(problem: Problem, normal: Normal, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(k,) Gauss-Newton step of the parameters that move, their standard deviations, log likelihood it gains.

    A parameter that others reproduce to the last digit has an infinite standard deviation.
    """
    matrix, slope, _ = schur(normal)
    i = np.flatnonzero(moving & (np.diag(matrix) > 0.0))
    step, std = np.zeros(len(slope)), np.full(len(slope), np.inf)
    size = np.sqrt(np.diag(matrix)[i])
    inverse, lost = inverted(matrix[np.ix_(i, i)] / np.outer(size, size), MIN_EIGENVALUE_SHARE)
    step[i] = -(inverse @ (slope[i] / size)) / size
    variance = normal.cost / max(problem.count - problem.unknowns, 1)
    std[i] = np.where(lost, np.inf, np.sqrt(variance * np.maximum(np.diag(inverse), 0.0)) / size)
    return step, std, float(-0.5 * slope @ step / variance)


def amplitude_std(problem: Problem, normal: Normal, own: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(k,) standard deviation of each of a cause's amplitudes, its others zero; infinite: not identifiable.

    own, rest  which amplitudes are the cause's, and which other parameters are free beside it
    """
    matrix, _, _ = schur(normal)
    std = np.full(len(matrix), np.inf)
    known = np.diag(matrix) > 0.0
    i, j = np.flatnonzero(own & known), np.flatnonzero(rest & known)
    size = np.sqrt(np.where(known, np.diag(matrix), 1.0))
    unit = matrix / np.outer(size, size)
    inverse, _ = inverted(unit[np.ix_(j, j)], MIN_EIGENVALUE_SHARE)
    unexplained = 1.0 - np.sum((unit[np.ix_(i, j)] @ inverse) * unit[np.ix_(i, j)], axis=1)
    variance = normal.cost / max(problem.count - problem.unknowns, 1)
    identifiable = unexplained > MIN_UNEXPLAINED_SHARE
    std[i[identifiable]] = np.sqrt(variance / unexplained[identifiable]) / size[i[identifiable]]
    return std
