"""Several ways into the optimum, until two of them agree.

Across a gap a likelihood has many peaks, and a start forty per cent off lies between them. What
helps is cheap: take the totals from the record (rough.py), look at many variations of the shape
parameters through one pass of an observer each, and descend from the best ones by cooling
observers (cooling.py). Where two descents of different origin end at the best value found, it
counts as confirmed; where not, more are made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from drivetool.identify.noise import Noise, excerpt, natural_ratio
from drivetool.identify.problem import Point, Problem, Solution, schur
from drivetool.identify.setup import Outcome, Task, first_point
from drivetool.identify.starts.attempts import attempted, that_held
from drivetool.identify.starts.cooling import SHAPE, frozen_value, observers
from drivetool.identify.starts.rough import balanced
from drivetool.progress import counted

CONFIRMED = 5.0  # log likelihood within which another start must come
APART = 20.0  # the same for their parameters, by the curvature there
DRAWS = 40  # variations looked at
SPREAD = 0.3  # std of their logarithms
GLANCE = 8000  # samples looked at
GLANCES = (1.0, 0.1)  # torque noise of the looks, over that which moves the output by its sensor noise
# Which candidate, by whose observer, from how hot.
WAYS = ((0, "linear", 10.0), (1, "linear", 1.0), (0, "exact", 10.0), (2, "linear", 1.0), (1, "linear", 10.0),
        (3, "linear", 1.0), (2, "exact", 10.0), (4, "linear", 1.0), (3, "linear", 10.0), (5, "linear", 1.0))

AGAIN = ("linear", 0.1)  # from the best so far, where the last steps went astray
AT_ONCE = 2  # looks, and descents to begin with, that are made together
EVERY = 3  # descents after which that is tried

T = TypeVar("T")


@dataclass(frozen=True)
class Descent(Generic[T]):
    """One way in: where it began, by which observer, its -log likelihood, and what it ended at."""

    start: Mapping[str, float]
    way: str
    value: float
    end: T


def searched(task: Task, starts: Sequence[Mapping[str, float]], seed: int,
             descend: Callable[[Task, str, float, float], tuple[float, T, Task]],
             gap: Callable[[T, T], float], most: int | None = None) -> list[Descent[T]]:
    """Descents from several starts, in the order made; the first two, of which no less will do, at once.

    starts   values to begin with, one mapping each
    descend  (task at its start values, "linear" or "exact" observer, how hot, the lowest -log likelihood
             so far) -> (-log likelihood, end, the task at the end)
    gap      (end, another) -> log likelihood by which the parameters of the two lie apart
    most     descents; None: as many as it takes for two to agree
    """
    candidates = ranked(task, starts, seed)
    found: list[Descent[T]] = []
    ends: list[Task] = []

    def made(index: int, way: str, hot: float) -> tuple[Descent[T], Task] | None:
        start = candidates[min(index, len(candidates) - 1)]
        lowest = min((d.value for d in found), default=np.inf)
        if (led := attempted(lambda: descend(start, way, hot, lowest))) is None:
            return None
        value, end, there = led
        return Descent(dict(zip(task.free, values_of(start).tolist(), strict=True)), way, value, end), there

    ways = WAYS[: most or len(WAYS)]
    with ThreadPoolExecutor(AT_ONCE) as pool:
        pair = list(pool.map(lambda way: made(*way), ways[:AT_ONCE]))
    for k, way in enumerate(counted("starts", ways, len(ways))):
        if (descent := pair[k] if k < len(pair) else made(*way)) is None:
            continue
        found.append(descent[0])
        ends.append(descent[1])
        if len(found) % EVERY == 0:
            i = min(range(len(found)), key=lambda j: found[j].value)
            again = attempted(lambda i=i: descend(ends[i], *AGAIN, found[i].value))
            if again is not None and again[0] < found[i].value:
                found[i], ends[i] = replace(found[i], value=again[0], end=again[1]), again[2]
        if most is None and confirmed(found, gap):
            break
    return that_held(found or [None] * len(ways))


def confirmed(found: Sequence[Descent[T]], gap: Callable[[T, T], float]) -> bool:
    """Whether a second one ends as high as the best, and at the same place."""
    best = min(found, key=lambda d: d.value)
    return any(d is not best and d.value - best.value < CONFIRMED and gap(best.end, d.end) < APART for d in found)


def apart(problem: Problem, one: Solution, other: Solution) -> float:
    """Log likelihood by which two sets of parameters lie apart, by the curvature at the first.

    Directions that the record does not tell do not count.
    """
    matrix, _, _ = schur(one.normal)
    variance = one.cost / max(problem.count - problem.unknowns, 1)
    change = other.point.values - one.point.values
    return float(0.5 * change @ matrix @ change / variance) if variance > 0.0 else 0.0


def agrees(outcome: Outcome, start: Mapping[str, Any]) -> bool:
    """Whether a start ended as good as the best one, and at the same values."""
    behind = start.get("minus_log_likelihood_above_best")
    if behind is None:
        behind = 0.5 * outcome.problem.count * float(np.log(start["cost_over_best"]))
    return behind < CONFIRMED and start.get("apart", 0.0) < APART


def values_of(task: Task) -> np.ndarray:
    """(k,) the values of the free parameters."""
    return np.array([task.drive.value(n) or 0.0 for n in task.free])


def ranked(task: Task, starts: Sequence[Mapping[str, float]], seed: int) -> list[Task]:
    """The first start, then the starts and their variations by what a glance at them says."""
    begun = [balanced(task.at(values)) for values in starts]
    others = begun[1:] + [task.at(values) for values in starts]
    rng = np.random.default_rng(seed)
    others += [_varied(begun[k % len(begun)], rng) for k in range(DRAWS)]
    problem, linear = task.problem(), task.linear_problem()
    natural = natural_ratio(problem, first_point(begun[0].drive, problem, task.roles))
    small, flat = excerpt(problem, GLANCE), excerpt(linear, GLANCE)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        looks = list(pool.map(lambda t: least(glances(small, flat, t, natural, GLANCES)), others))
    order = sorted(range(len(others)), key=lambda i: (looks[i], i))
    return begun[:1] + [others[i] for i in order]


def least(values: Sequence[float]) -> float:
    """The least, infinity where one is no number."""
    return float(np.nan_to_num(min(values), nan=np.inf))


def _varied(task: Task, rng: np.random.Generator) -> Task:
    """Other shape parameters, the sum of the inertias kept."""
    names = [n for n in task.free if n.endswith(SHAPE) and (task.drive.value(n) or 0.0) > 0.0]
    factors = np.exp(SPREAD * rng.standard_normal(len(names)))
    new = {n: task.drive.value(n) * f for n, f in zip(names, factors, strict=True)}
    inertias = [n for n in names if n.endswith(".inertia")]
    if inertias:
        share = sum(task.drive.value(n) for n in inertias) / sum(new[n] for n in inertias)
        new |= {n: new[n] * share for n in inertias}
    return task.at(new)


def glances(problem: Problem, linear: Problem, task: Task, natural: float, shares: Sequence[float]) -> list[float]:
    """-log likelihood of a task's values under the linear drive's observers, one per share of the torque noise."""
    point = Point(values_of(task), first_point(task.drive, problem, task.roles).starts)
    values = []
    for share in shares:
        noise = Noise(share * natural, None, problem.scale, share * natural)
        values.append(frozen_value(problem, point, observers(problem, linear, point, noise)))
    return values
