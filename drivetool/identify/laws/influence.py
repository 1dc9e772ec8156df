"""Each block's share of the error of a fit: for intervals that hold where the errors are correlated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from drivetool.identify.estimate import Z95, inverted
from drivetool.identify.motion import BLOCKS
from drivetool.identify.noise import filtered, with_state
from drivetool.identify.setup import Outcome

SLACK = float(student.ppf(0.975, BLOCKS - 1)) / Z95  # a variance of so few blocks is uncertain itself


@dataclass(frozen=True)
class Scores:
    """What a fit's traces say of the free parameters at its point, start states eliminated.

    each      (BLOCKS, k, k) information of each block; slopes: (BLOCKS, k) of half the cost, per block
    variance  of a weighted residual
    """

    each: np.ndarray
    slopes: np.ndarray
    variance: float

    @property
    def matrix(self) -> np.ndarray:
        """(k, k) information of all blocks."""
        return self.each.sum(axis=0)

    @property
    def inverse(self) -> np.ndarray:
        """(k, k) of the information, without the directions that nothing tells."""
        size = np.sqrt(np.maximum(np.diag(self.matrix), 0.0))
        size[size <= 0.0] = 1.0
        inverse, _ = inverted(self.matrix / np.outer(size, size), 1e-13)
        return inverse / np.outer(size, size)

    @property
    def influence(self) -> np.ndarray:
        """(BLOCKS, k) shares of the error of the free parameters."""
        return -self.slopes @ self.inverse

    @property
    def blocks(self) -> np.ndarray:
        """(k,) in how many blocks that count alike lies as much of what tells each parameter as there is in one.

        source  Carter, Schnepel and Steigerwald 2017: the effective number of clusters
        """
        inverse = self.inverse
        told = np.einsum("ij,bjk,ki->bi", inverse, self.each, inverse)
        whole = np.where(told.sum(axis=0) > 0.0, told.sum(axis=0), 1.0)
        return 1.0 / np.maximum(np.sum((told / whole) ** 2, axis=0), 1.0 / len(told))


def influence_of(outcome: Outcome) -> tuple[np.ndarray, np.ndarray]:
    """((k, k) information-matrix covariance of the free parameters, (BLOCKS, k) shares of their error).

    Both NaN where the sensitivities run away.

    source  White 1982 for the sandwich; Bester, Conley and Hansen 2011 for few contiguous blocks
    """
    found = scores_of(outcome)
    if found is None:
        k = len(outcome.problem.names)
        return np.full((k, k), np.nan), np.full((BLOCKS, k), np.nan)
    return found.variance * found.inverse, found.influence


def scores_of(outcome: Outcome) -> Scores | None:
    """The scores of a fit; None where the sensitivities run away."""
    problem, point, fit = outcome.problem, outcome.solution.point, outcome.fit
    gains = None
    if fit is not None:
        gains = [f.gains for f in filtered(problem, point, fit.noise)]
        problem, point = problem.with_memory(fit.noise.memory), with_state(point, fit.noise)
    k, count = len(problem.names), sum(t.size for t in problem.traces)
    each, slopes, cost, done = np.zeros((BLOCKS, k, k)), np.zeros((BLOCKS, k)), 0.0, 0
    for i, (trace, plant) in enumerate(zip(problem.traces, problem.plants(point.values, True), strict=True)):
        s = plant.system
        own = s.nq + np.setdiff1d(problem.free_start, problem.known(i))
        sums = np.zeros((BLOCKS, s.ns, s.ns))
        weight = None if gains else 1.0 / problem.scale
        parts = plant.sensitivities(trace, point.starts[i], gains[i] if gains else None, weight)
        if problem.lag:
            rows = problem.differenced(parts, trace).reshape(trace.size - problem.lag, -1, s.ns)
            parts = [(slice(0, len(rows)), rows)]
        for part, rows in parts:
            block = (done + np.arange(part.start, part.stop)) * BLOCKS // count
            for b in np.unique(block):
                flat = rows[block == b].reshape(-1, s.ns)
                with np.errstate(over="ignore", invalid="ignore"):
                    sums[b] += flat.T @ flat
        done += trace.size
        whole = sums.sum(axis=0)
        if not np.isfinite(whole).all():
            return None
        size = np.sqrt(np.diag(whole)[own])
        size[size == 0.0] = 1.0
        # What the start states take up, by the whole trace.
        taken = np.linalg.lstsq(whole[np.ix_(own, own)] / np.outer(size, size), whole[own, :k] / size[:, None],
                                rcond=1e-12)[0] / size[:, None]
        crossed = sums[:, :k, own] @ taken
        each += sums[:, :k, :k] - crossed - crossed.swapaxes(1, 2) + taken.T @ sums[:, own[:, None], own] @ taken
        slopes += sums[:, :k, -1] - sums[:, own, -1] @ taken
        cost += whole[-1, -1]
    return Scores(each, slopes, float(cost / max(problem.count - problem.unknowns, 1)))


def sandwich(influence: np.ndarray) -> np.ndarray:
    """(k, k) covariance from the blocks' shares of the error, its slack for few blocks included."""
    around = influence - influence.mean(axis=0)
    return SLACK**2 * around.T @ around * BLOCKS / (BLOCKS - 1.0)


def sized(matrix: np.ndarray, std: np.ndarray) -> np.ndarray:
    """The correlations of a matrix with other standard deviations."""
    size = np.sqrt(np.diag(matrix))
    factor = np.divide(std, size, out=np.zeros_like(std), where=size > 0.0)
    return matrix * np.outer(factor, factor)
