"""From a fit to the lines of a table: value, interval, status, and why there is no interval."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from drivetool.drive import AT, TOTALS, Drive, shared
from drivetool.errors import Finding
from drivetool.identify.estimate.estimate import Covariance, Parameter
from drivetool.identify.problem import Normal, Problem, Solution, blocked, schur

# Variance inflation by the other parameters above which a direction counts as not told.
COLLINEAR = 1e4
# Standard deviations beyond its bound at which the likelihood would have its peak: less than this
# and the bound says nothing about the parameter.
WEAK = 2.0
Z95 = 1.959963984540054
ONE_SIDED = 1.645  # standard deviations below which a normal variable is in 95 %


def covariance_of(problem: Problem, solution: Solution) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(covariance (k, k), inflation (k,), free (k,)): inverse information, start states eliminated.

    inflation  variance over the variance if all other parameters were known; infinite where the
               record says nothing
    free       whether a parameter is off its bound, or so weakly pressed against it that the
               others are not to be judged as if it were known; the rest has no covariance
    """
    normal = solution.normal
    matrix, _, _ = schur(normal)
    free = ~blocked(problem, solution.point, normal) | (_push(problem, solution) < WEAK)
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


def inverted(matrix: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """((k, k) inverse of a symmetric matrix without its null directions, (k,) what has a part in those).

    least  share of the largest eigenvalue below which a direction is null
    """
    values, vectors = np.linalg.eigh(matrix)
    good = values > least * values.max(initial=1e-300)
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T
    return inverse, np.sum(vectors[:, ~good] ** 2, axis=1) > 1e-3


def held_uncertainty(problem: Problem, normal: Normal, held: Covariance) -> np.ndarray:
    """(k, k) what the uncertainty of held values adds to the covariance of the fitted ones.

    problem  with the held names after the k fitted ones; normal: its equations at the estimate
    held     covariance of the held values, in the order of those last names
    """
    moved = moved_by_held(normal, len(problem.names) - len(held.names))
    return moved @ held.matrix @ moved.T


def moved_by_held(normal: Normal, k: int) -> np.ndarray:
    """(k, m) how the first k parameters of normal equations move with each of the m that are held after them."""
    matrix, _, _ = schur(normal)
    return -np.linalg.pinv(matrix[:k, :k], hermitian=True) @ matrix[:k, k:]


def parameters_of(problem: Problem, solution: Solution, before: Drive, after: Drive,
                  extra: np.ndarray | None = None,
                  ) -> tuple[tuple[Parameter, ...], Covariance | None, tuple[Finding, ...]]:
    """One Parameter per value of the drive, their covariance, and what could not be told.

    before, after  the drive with start values and with fitted values
    extra          (k, k) covariance that comes from held values
    """
    covariance, inflation, free = covariance_of(problem, solution)
    covariance = covariance + _from_bounds(problem, solution, free)
    if extra is not None:
        covariance = covariance + extra
    lines, findings = {}, []
    on_bound = blocked(problem, solution.point, solution.normal)
    for j, name in enumerate(problem.names):
        value = float(solution.point.values[j])
        std = float(np.sqrt(covariance[j, j])) if np.isfinite(covariance[j, j]) else None
        low, high = problem.low[j], problem.high[j]
        common = (name, value, after.unit(name), before.told(name))
        known = std is not None and told(value, std, inflation[j], before, name)
        if not free[j] or (on_bound[j] and known):
            upper = _beyond_bound(problem, solution, j)
            limit = (float(low), float(min(low + upper, high))) if value <= low else (
                float(max(high - upper, low)), float(high))
            lines[name] = Parameter(*common, None, limit, "at-bound",
                                    why_on_bound(value))
        elif not known:
            partners = partners_of(covariance, problem.names, j) if np.isfinite(inflation[j]) else [
                n for i, n in enumerate(problem.names) if i != j and free[i] and not np.isfinite(inflation[i])]
            reason = why_not(name, partners, after)
            lines[name] = Parameter(*common, None, None, "not-identifiable", reason)
            findings.append(Finding(
                "warning", "not-identifiable", f"{name} cannot be told from this record: {reason}.",
                {"value": value, **({"std": std} if std is not None else {})}, experiment_for(name, after),
                parameter=None if name in after.known_torques else name))  # the factor of a law is none of a drive
        else:
            ci = (max(value - Z95 * std, float(low)), min(value + Z95 * std, float(high)))
            lines[name] = Parameter(*common, std, ci, "fitted")
    for name, value in after.values.items():
        lines.setdefault(name, Parameter(name, float(value), after.unit(name), float(value),
                                         status="held", reason=_why_held(name)))
    order = [n for n in after.quantities if n in lines]
    kept = [j for j, n in enumerate(problem.names) if lines[n].status == "fitted"]
    matrix = covariance[np.ix_(kept, kept)]
    shared = Covariance(tuple(problem.names[j] for j in kept), matrix) if kept else None
    return tuple(lines[n] for n in order), shared, tuple(findings)


def without_untold(findings: Sequence[Finding], names: Collection[str]) -> list[Finding]:
    """The findings but those that a fit cannot tell one of these parameters: of it something else is said."""
    return [f for f in findings if not (f.code == "not-identifiable" and f.parameter in names)]


def _why_held(name: str) -> str:
    return "stated for this recording" if AT in name else "held at its start value"


def why_on_bound(value: float) -> str:
    """Why a value has no interval to both sides."""
    return f"the best value lies on the bound {value:g}; the interval is one-sided"


def _from_bounds(problem: Problem, solution: Solution, free: np.ndarray) -> np.ndarray:
    """(k, k) what it adds to the covariance of the others that a parameter on its bound may lie inside.

    Of a sum that is known well the one part is as uncertain as the other.
    """
    matrix, _, _ = schur(solution.normal)
    found = np.zeros_like(matrix)
    i = np.flatnonzero(free & (np.diag(matrix) > 0.0))
    for j in np.flatnonzero(~free):
        gain = np.linalg.pinv(matrix[np.ix_(i, i)], rcond=1e-13, hermitian=True) @ matrix[i, j]
        found[np.ix_(i, i)] += np.outer(gain, gain) * (_beyond_bound(problem, solution, j) / Z95) ** 2
    return found


def _push(problem: Problem, solution: Solution) -> np.ndarray:
    """(k,) how many of its standard deviations the peak of a parameter lies from where it is."""
    matrix, slope, _ = schur(solution.normal)
    variance = solution.cost / max(problem.count - problem.unknowns, 1)
    std = np.sqrt(variance * np.maximum(np.diag(np.linalg.pinv(matrix, rcond=1e-13, hermitian=True)), 0.0))
    return np.abs(slope) * std / max(variance, 1e-300)  # a fit without any error has no slope either


def _beyond_bound(problem: Problem, solution: Solution, j: int) -> float:
    """How far inside its bound the parameter may lie: 95 %, one-sided."""
    matrix, _, _ = schur(solution.normal)
    variance = solution.cost / max(problem.count - problem.unknowns, 1)
    std = np.sqrt(variance * max(np.linalg.pinv(matrix, rcond=1e-13, hermitian=True)[j, j], 0.0))
    # The slope pushes against the bound: the likelihood falls as exp(-s x - x^2 / (2 std^2)).
    push = _push(problem, solution)[j]
    return float(std * (np.sqrt(push**2 + ONE_SIDED**2) - push)) if std > 0.0 else 0.0


def told(value: float, std: float, inflation: float, drive: Drive, name: str) -> bool:
    """Whether an interval says something: not a blur that other parameters can imitate."""
    size = max(abs(value), abs(drive.value(name) or 0.0))
    size = size if np.isfinite(size) else abs(value)
    if not np.isfinite(inflation):  # a direction without information: the std is that of the others
        return False
    if drive.quantity(name).neutral is None:
        return std < size
    return not (inflation > COLLINEAR and std > size)


def partners_of(covariance: np.ndarray, names: Sequence[str], j: int) -> list[str]:
    """Parameters that trade against one another with parameter j."""
    if not np.isfinite(covariance[j, j]) or covariance[j, j] <= 0.0:
        return []
    found = []
    for i, name in enumerate(names):
        if i != j and np.isfinite(covariance[i, i]) and covariance[i, i] > 0.0:
            rho = covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j])
            if abs(rho) > 0.9:
                found.append(name)
    return found


def why_not(name: str, partners: Sequence[str], drive: Drive) -> str:
    """The reason in words."""
    if partners:
        return f"it trades against {', '.join(partners)}, and only their combination shows"
    return f"it does not show in the outputs ({drive.quantity(name).meaning})"


def experiment_for(name: str, drive: Drive) -> str:
    """What to record so that a parameter shows."""
    name = shared(name)
    suffix = name.rpartition(".")[2]
    if suffix in TOTALS.values() and name not in TOTALS:
        return f"Log the shaft torque or the load speed, or fit total.{suffix} instead."
    for effect, owner, _ in drive.effects():
        if f"{owner}.{suffix}" == name or (name in TOTALS and suffix in effect.quantities):
            return f"Needed: {effect.needs}."
    return "Hold it with --hold."
