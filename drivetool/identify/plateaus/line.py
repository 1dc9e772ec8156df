"""The friction line through steady points: its identifiable parts, and their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from drivetool.errors import NotEnoughData
from drivetool.identify.plateaus.points import SteadyPoints

LINE_KEYS = ("viscous", "idle_torque", "coulomb", "drag")
# The scatter is larger than predicted below this probability: the usual strict level, one false alarm in a hundred.
SCATTER_SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class FrictionLine:
    """A fitted line T = viscous w + idle_torque + coulomb sgn(w) + drag w |w|.

    values       key -> value, fitted or not; the line is these and `carried` together
    free         keys that were fitted, in the order of `covariance`
    conditional  keys whose values hold only together with an assumed one
    at_bound     keys that are held at zero because they came out negative -> the value they had
    quantile     of Student's t for 95 % intervals
    chi2, dof, probability of the scatter; unexplained: whether the noise does not explain it
    inflation    of the standard deviations by the scatter; rmse of the residuals
    weights      (len(free), k): free values = weights @ (torque less what is held), for joint covariances
    carried      key -> part of the line that parameters held elsewhere carry
    """

    values: Mapping[str, float]
    free: tuple[str, ...]
    covariance: np.ndarray
    conditional: tuple[str, ...]
    at_bound: Mapping[str, tuple[float, float]]
    quantile: float
    chi2: float
    dof: int
    probability: float
    unexplained: bool
    inflation: float
    rmse: float
    weights: np.ndarray
    carried: Mapping[str, float]

    def torque(self, speed: np.ndarray) -> np.ndarray:
        """(n,) torque of the line at the speeds (n,)."""
        return _design_matrix(speed,
                              LINE_KEYS) @ np.array([self.values[k] + self.carried.get(k, 0.0) for k in LINE_KEYS])


def fit_line(points: SteadyPoints, held: Mapping[str, float], start: Mapping[str, float],
             carried: Mapping[str, float]) -> FrictionLine:
    """Weighted least squares of T = viscous w + idle_torque + coulomb sgn(w) + drag w |w|.

    points   with the variance of torque - c speed
    held     key -> value that stays; start: key -> value to assume where the points do not identify it
    carried  key -> what is known to be part of the line besides
    returns  Line; viscous friction, Coulomb friction and drag that come out negative are set to zero
    """
    values = dict(held)
    known = _design_matrix(points.speed, LINE_KEYS) @ np.array([carried.get(key, 0.0) for key in LINE_KEYS])
    torque = points.torque - known
    free = [key for key in LINE_KEYS if key not in held]
    both = len(set(np.sign(points.speed))) == 2
    if not both and "coulomb" in free and "idle_torque" in free:
        free.remove("coulomb")
        values["coulomb"] = 0.0
    conditional = tuple(_undetermined_keys(points, free))
    # Assume as little as it takes; the drag first, then the viscous friction, a start value of it is often known.
    for key in ("drag", "viscous", "coulomb"):
        if key in free and key in _undetermined_keys(points, free):
            free.remove(key)
            values[key] = start.get(key, 0.0)
    at_bound = {}
    while True:
        found, covariance, weights = _weighted_least_squares(points, torque, free, values)
        negative = [k for k in free if k != "idle_torque" and found[k] < 0]
        if not negative:
            break
        worst = negative[0]
        at = free.index(worst)
        at_bound[worst] = (found[worst], float(np.sqrt(covariance[at, at])))
        free.remove(worst)
        values[worst] = 0.0
    values |= found
    residual = torque - _design_matrix(points.speed, LINE_KEYS) @ np.array([values[k] for k in LINE_KEYS])
    chi2, dof = float(np.sum(residual**2 / points.variance)), len(residual) - len(free)
    probability = float(scipy.stats.chi2.sf(chi2, dof)) if dof > 0 else 1.0
    rmse = float(np.sqrt(np.mean(residual**2)))
    unexplained = probability < SCATTER_SIGNIFICANCE
    # Batches and residuals both measure the noise; if they agree, they are averaged by their freedom.
    inflation = np.sqrt(chi2 / dof if unexplained else (points.dof + chi2) / (points.dof + dof))
    quantile = float(scipy.stats.t.ppf(0.975, dof if unexplained else points.dof + dof))
    return FrictionLine(values, tuple(free), covariance * inflation**2, conditional, at_bound, quantile, chi2, dof,
                probability, unexplained, float(inflation), rmse, weights, dict(carried))


def _design_matrix(speed: np.ndarray, keys: Sequence[str]) -> np.ndarray:
    """(k, len(keys)) columns of the line."""
    columns = {"viscous": speed, "idle_torque": np.ones_like(speed), "coulomb": np.sign(speed),
               "drag": speed * np.abs(speed)}
    return np.column_stack([columns[key] for key in keys]) if keys else np.zeros((len(speed), 0))


def _undetermined_keys(points: SteadyPoints, free: Sequence[str]) -> list[str]:
    """Keys that are collinear with others at the levels there are, and so could take any value."""
    matrix = _design_matrix(points.levels * np.sign(points.speed), free)
    if not free:
        return []
    matrix = matrix / np.abs(matrix).max(axis=0)
    _, sizes, rows = np.linalg.svd(matrix, full_matrices=True)
    rank = int(np.sum(sizes > 1e-9 * sizes[0]))
    null_parts = np.abs(rows[rank:]).max(axis=0, initial=0.0)
    return [key for key, part in zip(free, null_parts, strict=True) if part > 1e-6]


def _weighted_least_squares(points: SteadyPoints, torque: np.ndarray, free: Sequence[str],
                            values: Mapping[str, float]) -> tuple[dict[str, float], np.ndarray, np.ndarray]:
    """(key -> value, covariance, weights) of the free keys, the others taken from `values`."""
    if not free:
        return {}, np.zeros((0, 0)), np.zeros((0, len(points.speed)))
    others = [key for key in LINE_KEYS if key not in free]
    rest = torque - _design_matrix(points.speed, others) @ np.array([values[key] for key in others])
    matrix = _design_matrix(points.speed, free)
    scale = np.abs(matrix).max(axis=0)
    weight = 1 / points.variance
    # Scaled columns: speeds of 1e3 and ones side by side would lose digits.
    normal = (matrix / scale).T @ ((matrix / scale) * weight[:, None])
    covariance = np.linalg.inv(normal) / np.outer(scale, scale)
    weights = covariance @ (matrix * weight[:, None]).T
    found = weights @ rest
    return {key: float(value) for key, value in zip(free, found, strict=True)}, covariance, weights


def refuse_scatter(points: SteadyPoints, line: FrictionLine, what: str) -> None:
    """Raise NotEnoughData where a line leaves half of the torque, unless the noise explains it.

    what  for the message, for example "motor torque over motor speed"
    """
    rms = float(np.sqrt(np.mean(points.torque**2)))
    if line.dof > 0 and line.unexplained and line.rmse > 0.5 * rms:
        way = np.sign(points.speed)
        # A load drives in one direction only.
        brakes = len(set(way)) > 1 and bool(np.all(way * points.torque < 0.0))
        raise NotEnoughData(
            f"steady points close to a friction line ({what})",
            f"a scatter of {line.rmse:.3g} about the line, with an rms torque of {rms:.3g}",
            "The torque is against the motion in both directions, where it should overcome friction: invert torque "
            "or speed in the channel map, with sign: -1." if brakes else
            "Keep the load constant while the speed is stepped, and check both channels.")
