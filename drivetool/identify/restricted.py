"""The noise ratio by restricted maximum likelihood: what the fit itself has swallowed is added back.

A fit of ten unknowns to a short record follows the slow part of the torque noise. Plain maximum
likelihood then finds too little torque noise (a fifth less on a 6 s record) and states intervals that
are too narrow by as much. The restricted likelihood counts only what the unknowns cannot follow.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from drivetool.identify.innovations import Fit, settle
from drivetool.identify.least_squares import schur
from drivetool.identify.noise import Noise, filtered, natural_ratio
from drivetool.identify.problem import Normal, Point, Problem

ROUNDS = 4
SETTLED = 0.05  # change of the log ratio


def restricted(problem: Problem, fit: Fit) -> Fit:
    """The fit with its noise ratio by restricted likelihood, settled again.

    problem  that the fit is of; white torque noise only, coloured noise is left as it is
    source   Patterson and Thompson 1971; Harville 1977
    """
    if fit.noise.memory is not None:
        return fit
    for _ in range(ROUNDS):
        before, noise = fit.noise.ratio, _best(problem, fit)
        fit = settle(problem, replace(fit, noise=noise))
        if abs(np.log(noise.ratio / before)) < SETTLED:
            break
    return fit


def _best(problem: Problem, fit: Fit) -> Noise:
    """The noise at which the restricted likelihood is largest: grid, then golden section."""
    def value(log_ratio: float) -> float:
        return minus_restricted(problem, fit.point, replace(fit.noise, ratio=float(np.exp(log_ratio))))

    grid = np.log(natural_ratio(problem, fit.point)) + np.log(10.0) * np.linspace(-5.0, 1.0, 13)
    best = int(np.argmin([value(x) for x in grid]))
    ends = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found = minimize_scalar(value, bounds=ends, method="bounded", options={"xatol": 0.02, "maxiter": 20})
    return replace(fit.noise, ratio=float(np.exp(found.x)))


def minus_restricted(problem: Problem, point: Point, noise: Noise) -> float:
    """-log restricted likelihood, up to a constant; sensor variance and unknowns profiled out."""
    passes = filtered(problem, point, noise)
    normal = problem.normal(point, [f.gains for f in passes])
    logs = sum(float(np.sum(np.log(f.variance[np.isfinite(f.innovations)]))) for f in passes)
    determinant, gained = _information(normal)
    spare = max(problem.count - problem.unknowns, 1)
    left = normal.cost - gained
    if not np.isfinite(left) or left <= 0.0:
        return np.inf
    return 0.5 * (spare * np.log(left / spare) + logs + determinant)


def _information(normal: Normal) -> tuple[float, float]:
    """(log determinant of the normal matrix, cost that one step to its minimum would save)."""
    matrix, slope, inverses = schur(normal)
    total, gained = 0.0, 0.0
    for own, inverse, own_slope in zip(normal.own, inverses, normal.own_slope, strict=True):
        total += float(np.linalg.slogdet(own)[1])
        gained += float(own_slope @ inverse @ own_slope)
    size = np.sqrt(np.diag(normal.shared))
    seen = size > 0.0
    scaled = matrix[np.ix_(seen, seen)] / np.outer(size[seen], size[seen])
    values, vectors = np.linalg.eigh(scaled)
    good = values > 1e-13 * max(values.max(initial=0.0), 1e-300)
    part = vectors[:, good].T @ (slope[seen] / size[seen])
    total += float(np.sum(np.log(values[good])) + 2.0 * np.sum(np.log(size[seen])))
    return total, gained + float(np.sum(part**2 / values[good]))
