"""Each block's influence on the error of a fit: for intervals that are valid for correlated errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from drivetool.identify.estimate import Z95, inverted
from drivetool.identify.motion import INFLUENCE_BLOCKS
from drivetool.identify.noise import filtered, with_disturbance_state
from drivetool.identify.problem import nonzero_scale
from drivetool.identify.setup import Outcome

# Student's t over the normal quantile: a variance of so few blocks is uncertain itself.
FEW_BLOCKS_FACTOR = float(scipy.special.stdtrit(INFLUENCE_BLOCKS - 1, 0.975)) / Z95


@dataclass(frozen=True)
class Scores:
    """Information and scores of the free parameters at a fit's point, start states eliminated.

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
        """(k, k) of the information, without the unidentifiable directions."""
        size = nonzero_scale(np.sqrt(np.maximum(np.diag(self.matrix), 0.0)))
        inverse, _ = inverted(self.matrix / np.outer(size, size), 1e-13)
        return inverse / np.outer(size, size)

    @property
    def influence(self) -> np.ndarray:
        """(BLOCKS, k) shares of the error of the free parameters."""
        return -self.slopes @ self.inverse

    @property
    def blocks(self) -> np.ndarray:
        """(k,) effective number of blocks with information about each parameter.

        source  Carter, Schnepel and Steigerwald 2017: the effective number of clusters
        """
        inverse = self.inverse
        information = np.einsum("ij,bjk,ki->bi", inverse, self.each, inverse)
        whole = np.where(information.sum(axis=0) > 0.0, information.sum(axis=0), 1.0)
        return 1.0 / np.maximum(np.sum((information / whole) ** 2, axis=0), 1.0 / len(information))


def influence_of(outcome: Outcome) -> tuple[np.ndarray, np.ndarray]:
    """((k, k) information-matrix covariance of the free parameters, (BLOCKS, k) shares of their error).

    Both NaN where the sensitivities diverge.

    source  White 1982 for the sandwich; Bester, Conley and Hansen 2011 for few contiguous blocks
    """
    found = scores_of(outcome)
    if found is None:
        k = len(outcome.problem.names)
        return np.full((k, k), np.nan), np.full((INFLUENCE_BLOCKS, k), np.nan)
    return found.variance * found.inverse, found.influence


def scores_of(outcome: Outcome) -> Scores | None:
    """The scores of a fit; None where the sensitivities diverge."""
    problem, point, fit = outcome.problem, outcome.solution.point, outcome.fit
    gains = None
    if fit is not None:
        gains = [f.gains for f in filtered(problem, point, fit.noise)]
        problem, point = problem.with_memory(fit.noise.memory), with_disturbance_state(point, fit.noise)
    k, count = len(problem.names), sum(t.size for t in problem.traces)
    each, slopes, cost, done = np.zeros((INFLUENCE_BLOCKS, k, k)), np.zeros((INFLUENCE_BLOCKS, k)), 0.0, 0
    for i, (trace, plant) in enumerate(zip(problem.traces, problem.plants(point.values, True), strict=True)):
        s = plant.system
        own = s.nq + np.setdiff1d(problem.free_start, problem.known(i))
        sums = np.zeros((INFLUENCE_BLOCKS, s.ns, s.ns))
        weight = None if gains else 1.0 / problem.scale
        parts = plant.sensitivities(trace, point.starts[i], gains[i] if gains else None, weight)
        if problem.lag:
            rows = problem.differenced(parts, trace).reshape(trace.size - problem.lag, -1, s.ns)
            parts = [(slice(0, len(rows)), rows)]
        for part, rows in parts:
            add_products(sums, rows, done + part.start, count)
        done += trace.size
        whole = sums.sum(axis=0)
        if not np.isfinite(whole).all():
            return None
        size = nonzero_scale(np.sqrt(np.diag(whole)[own]))
        # What the start states explain, by the whole trace.
        explained = np.linalg.lstsq(whole[np.ix_(own, own)] / np.outer(size, size), whole[own, :k] / size[:, None],
                                    rcond=1e-12)[0] / size[:, None]
        cross = sums[:, :k, own] @ explained
        each += (sums[:, :k, :k] - cross - cross.swapaxes(1, 2)
                 + explained.T @ sums[:, own[:, None], own] @ explained)
        slopes += sums[:, :k, -1] - sums[:, own, -1] @ explained
        cost += whole[-1, -1]
    return Scores(each, slopes, float(problem.variance(cost)))


def add_products(sums: np.ndarray, rows: np.ndarray, first: int, count: int) -> None:
    """Add products of the columns of rows (m, ny, k) to the sums (blocks, k, k) of their blocks, in place.

    first  sample of the first row, of `count` samples in blocks of one length
    """
    block = (first + np.arange(len(rows))) * len(sums) // count
    for b in np.unique(block):
        flat = rows[block == b].reshape(-1, rows.shape[2])
        with np.errstate(over="ignore", invalid="ignore"):
            sums[b] += flat.T @ flat


def sandwich_covariance(influence: np.ndarray) -> np.ndarray:
    """(k, k) covariance from the blocks' shares of the error, widened for the small number of blocks."""
    deviations = influence - influence.mean(axis=0)
    return FEW_BLOCKS_FACTOR**2 * deviations.T @ deviations * INFLUENCE_BLOCKS / (INFLUENCE_BLOCKS - 1.0)


def with_standard_deviations(matrix: np.ndarray, std: np.ndarray) -> np.ndarray:
    """The correlations of a matrix with other standard deviations."""
    size = np.sqrt(np.diag(matrix))
    factor = np.divide(std, size, out=np.zeros_like(std), where=size > 0.0)
    return matrix * np.outer(factor, factor)
