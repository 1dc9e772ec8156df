"""From a fit to the lines of a table: value, interval, status, and why there is no interval."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive import TOTALS, Drive
from drivetool.finding import Finding
from drivetool.identify.estimate.estimate import Z95, Covariance, Parameter
from drivetool.identify.estimate.lines import line_of, whole_table, with_intervals_only
from drivetool.identify.problem import Normal, Problem, Solution, blocked_by_bounds, schur
from drivetool.quantity import name_of, quantity_of, record_of, shared

# Variance inflation by the other parameters above which a direction is unidentifiable. A choice: at 1e4 they
# imitate 99.99 % of its effect.
MAX_INFLATION = 1e4
# Standard deviations beyond its bound at which the likelihood has its peak. A choice, the usual significance: with
# less the bound does not press on the parameter.
MIN_BOUND_PUSH = 2.0
Z95_ONE_SIDED = 1.645  # normal quantile of a one-sided 95 % interval, rounded


def covariance_of(problem: Problem, solution: Solution) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(covariance (k, k), inflation (k,), free (k,)): inverse information, start states eliminated.

    inflation  variance over the variance if all other parameters were known; infinite without information
    free       whether a parameter is off its bound, or so weakly pressed against it that it does not count as known
               for the others; the rest has no covariance
    """
    normal = solution.normal
    matrix, _, _ = schur(normal)
    free = ~blocked_by_bounds(problem, solution.point, normal) | (_push_in_std(problem, solution) < MIN_BOUND_PUSH)
    k = len(free)
    covariance, inflation = np.full((k, k), np.nan), np.full(k, np.inf)
    own = np.diag(normal.shared)
    i = np.flatnonzero(free & (own > 0.0))
    if len(i) == 0:
        return covariance, inflation, free
    variance = solution.cost / max(problem.count - problem.unknowns, 1)
    size = np.sqrt(own[i])
    inverse, lost = inverted(matrix[np.ix_(i, i)] / np.outer(size, size), 1e-13)
    covariance[np.ix_(i, i)] = variance * inverse / np.outer(size, size)
    inflation[i] = np.where(lost, np.inf, np.diag(inverse))
    return covariance, inflation, free


def inverted(matrix: np.ndarray, min_share: float) -> tuple[np.ndarray, np.ndarray]:
    """((k, k) inverse of a symmetric matrix without its null directions, (k,) whether a parameter is in those).

    least  share of the largest eigenvalue below which a direction is null
    """
    values, vectors = np.linalg.eigh(matrix)
    good = values > min_share * values.max(initial=1e-300)
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T
    return inverse, np.sum(vectors[:, ~good] ** 2, axis=1) > 1e-3


def held_uncertainty(problem: Problem, normal: Normal, held: Covariance) -> np.ndarray:
    """(k, k) covariance of the fitted values by the uncertainty of held ones.

    problem  with the held names after the k fitted ones; normal: its equations at the estimate
    held     covariance of the held values, in the order of those last names
    """
    moved = sensitivity_to_held(normal, len(problem.names) - len(held.names))
    return moved @ held.matrix @ moved.T


def sensitivity_to_held(normal: Normal, k: int) -> np.ndarray:
    """(k, m) how the first k parameters of normal equations move with each of the m that are held after them."""
    matrix, _, _ = schur(normal)
    return -np.linalg.pinv(matrix[:k, :k], hermitian=True) @ matrix[:k, k:]


def parameters_of(problem: Problem, solution: Solution, before: Drive, after: Drive,
                  extra: np.ndarray | None = None,
                  ) -> tuple[tuple[Parameter, ...], Covariance | None, tuple[Finding, ...]]:
    """One Parameter per value of the drive, their covariance, and findings on what is not identifiable.

    before, after  the drive with start values and with fitted values
    extra          (k, k) covariance that comes from held values
    """
    covariance, inflation, free = covariance_of(problem, solution)
    covariance = covariance + _covariance_from_bounds(problem, solution, free)
    if extra is not None:
        covariance = covariance + extra
    lines, findings = [], []
    on_bound = blocked_by_bounds(problem, solution.point, solution.normal)
    for j, name in enumerate(problem.names):
        value = float(solution.point.values[j])
        std = float(np.sqrt(covariance[j, j])) if np.isfinite(covariance[j, j]) else None
        bounds = float(problem.low[j]), float(problem.high[j])
        line = line_of(after, name, value).replace(start=before.known_value(name))
        identified = std is not None and is_identifiable(value, std, inflation[j], before, name)
        if not free[j] or (on_bound[j] and identified):
            lines.append(line.at_bound(_one_sided_distance(problem, solution, j), bounds))
        elif not identified:
            partners = correlated_with(covariance, problem.names, j) if np.isfinite(inflation[j]) else [
                n for i, n in enumerate(problem.names) if i != j and free[i] and not np.isfinite(inflation[i])]
            reason = why_not_identifiable(name, partners, after)
            lines.append(line.without_interval(reason, "not-identifiable"))
            findings.append(Finding(
                "warning", "not-identifiable", f"{name} is not identifiable from this record: {reason}.",
                {"value": value, **({"std": std} if std is not None else {})}, experiment_for(name, after),
                parameter=None if name in after.known_torques else name))  # the factor of a law is none of a drive
        else:
            lines.append(line.with_interval(std, bounds))
    shared = with_intervals_only(Covariance(problem.names, covariance), lines)
    return whole_table(lines, after, _why_held), shared, tuple(findings)


def _why_held(name: str) -> str:
    return "stated for this recording" if record_of(name) else "held at its start value"


def _covariance_from_bounds(problem: Problem, solution: Solution, free: np.ndarray) -> np.ndarray:
    """(k, k) covariance of the others, since a parameter on its bound may lie inside.

    With a well-known sum, one part is as uncertain as the other.
    """
    matrix, _, _ = schur(solution.normal)
    found = np.zeros_like(matrix)
    i = np.flatnonzero(free & (np.diag(matrix) > 0.0))
    for j in np.flatnonzero(~free):
        gain = np.linalg.pinv(matrix[np.ix_(i, i)], rcond=1e-13, hermitian=True) @ matrix[i, j]
        found[np.ix_(i, i)] += np.outer(gain, gain) * (_one_sided_distance(problem, solution, j) / Z95) ** 2
    return found


def _push_in_std(problem: Problem, solution: Solution) -> np.ndarray:
    """(k,) distance of each parameter from the likelihood's peak, in its standard deviations."""
    matrix, slope, _ = schur(solution.normal)
    variance = solution.cost / max(problem.count - problem.unknowns, 1)
    std = np.sqrt(variance * np.maximum(np.diag(np.linalg.pinv(matrix, rcond=1e-13, hermitian=True)), 0.0))
    return np.abs(slope) * std / max(variance, 1e-300)  # a fit without any error has no slope either


def _one_sided_distance(problem: Problem, solution: Solution, j: int) -> float:
    """How far inside its bound the parameter may lie: 95 %, one-sided."""
    matrix, _, _ = schur(solution.normal)
    variance = solution.cost / max(problem.count - problem.unknowns, 1)
    std = np.sqrt(variance * max(np.linalg.pinv(matrix, rcond=1e-13, hermitian=True)[j, j], 0.0))
    # The slope pushes against the bound: the likelihood falls as exp(-s x - x^2 / (2 std^2)).
    push = _push_in_std(problem, solution)[j]
    return float(std * (np.sqrt(push**2 + Z95_ONE_SIDED**2) - push)) if std > 0.0 else 0.0


def is_identifiable(value: float, std: float, inflation: float, drive: Drive, name: str) -> bool:
    """Whether a parameter is identifiable: its interval is informative and no other parameter imitates it."""
    size = max(abs(value), abs(drive.value(name) or 0.0))
    size = size if np.isfinite(size) else abs(value)
    if not np.isfinite(inflation):  # a direction without information: the std is that of the others
        return False
    if drive.quantity(name).neutral is None:
        return std < size
    return not (inflation > MAX_INFLATION and std > size)


def correlated_with(covariance: np.ndarray, names: Sequence[str], j: int) -> list[str]:
    """Parameters that are strongly correlated with parameter j."""
    if not np.isfinite(covariance[j, j]) or covariance[j, j] <= 0.0:
        return []
    return [name for i, name in enumerate(names)
            if i != j and np.isfinite(covariance[i, i]) and covariance[i, i] > 0.0
            and abs(covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j])) > 0.9]


def why_not_identifiable(name: str, partners: Sequence[str], drive: Drive) -> str:
    """The reason in words."""
    if partners:
        return (f"its estimate is correlated with that of {', '.join(partners)}; only their combination is "
                "identifiable")
    return f"it has no significant effect on the outputs ({drive.quantity(name).meaning})"


def experiment_for(name: str, drive: Drive) -> str:
    """The experiment that identifies a parameter."""
    name = shared(name)
    suffix = quantity_of(name)
    if suffix in TOTALS.values() and name not in TOTALS:
        return f"Log the shaft torque or the load speed, or fit total.{suffix} instead."
    for effect, owner, _ in drive.effects():
        if suffix in effect.quantities and (name_of(owner, suffix) == name or name in TOTALS):
            return f"Needed: {effect.needs}."
    return "Hold it with --hold."
