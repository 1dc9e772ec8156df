"""Profile likelihood of one parameter: the interval that needs no quadratic approximation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivetool.identify.noise import Noise, filtered, minus_log_likelihood_at, solve_under_noise
from drivetool.identify.problem import Point
from drivetool.identify.setup import Outcome, Task
from drivetool.quantity import parse_name

HALF_CHI2_95 = 1.920729410347062  # half the 95 % quantile of chi-square with one degree of freedom


@dataclass(frozen=True)
class Profile:
    """values (n,) ascending, rise (n,) of -log likelihood over the best, 95 % interval.

    low or high is None where the likelihood does not fall far enough within the values tried.
    """

    values: np.ndarray
    rise: np.ndarray
    low: float | None
    high: float | None


def profile(outcome: Outcome, name: str, step: float, max_points: int = 8) -> Profile:
    """Profile of a parameter around an innovations fit, the noise model kept.

    step  first distance from the estimate, about one standard deviation
    most  points on each side
    """
    task = outcome.fitted
    j = outcome.problem.names.index(name)
    best = float(outcome.solution.point.values[j])
    low, high = outcome.problem.low[j], outcome.problem.high[j]
    found = {best: _refit(task, outcome, name, best)}
    for side in (-1.0, 1.0):
        distance = step
        for _ in range(max_points):
            value = float(np.clip(best + side * distance, low, high))
            if value in found:
                break
            found[value] = _refit(task, outcome, name, value)
            if found[value] - min(found.values()) > 1.5 * HALF_CHI2_95 or value in (low, high):
                break
            distance *= 1.6
    values = np.array(sorted(found))
    rise = np.array([found[v] for v in values])
    rise -= rise.min()
    centre = int(np.argmin(rise))
    return Profile(values, rise, _level_crossing(values[: centre + 1][::-1], rise[: centre + 1][::-1]),
                   _level_crossing(values[centre:], rise[centre:]))


def _refit(task: Task, outcome: Outcome, name: str, value: float) -> float:
    """-log likelihood with one parameter fixed and the others fitted again."""
    fixed = task.at({name: value}).with_held({name})
    problem = fixed.problem()
    noise: Noise = outcome.fit.noise
    values = np.array([fixed.drive.value(n) for n in fixed.free])
    point = Point(values, tuple(shifted_start(task, name, value, s) for s in outcome.solution.point.starts))
    best = np.inf
    for _ in range(3):
        gains = [f.gains for f in filtered(problem, point, noise)]
        point = solve_under_noise(problem, point, gains, noise, relative=1e-7).point
        new = minus_log_likelihood_at(problem, point, noise)
        if new > best - 0.01:
            return min(best, new)
        best = new
    return best


def shifted_start(task: Task, name: str, value: float, start: np.ndarray) -> np.ndarray:
    """A start state that leaves a contact closed as far as it was, if a half gap changes."""
    shaft, suffix, _ = parse_name(name)
    old = task.drive.value(name) or 0.0
    column = len(task.drive.bodies) + task.drive.shafts.index(shaft) if suffix == "half_gap" else -1
    if column < 0 or abs(start[column]) < old:
        return start
    new = start.copy()
    new[column] += np.sign(start[column]) * (value - old)
    return new


def _level_crossing(values: np.ndarray, rise: np.ndarray) -> float | None:
    """Where the root of the rise, nearly linear, passes the 95 % level, walking outwards."""
    root = np.sqrt(np.maximum(rise, 0.0))
    level = np.sqrt(HALF_CHI2_95)
    for i in range(1, len(values)):
        if root[i] > level:
            share = (level - root[i - 1]) / (root[i] - root[i - 1])
            return float(values[i - 1] + share * (values[i] - values[i - 1]))
    return None
