"""Multi-start search for the optimum, until two starts agree.

Across a gap a likelihood has many local optima, and a start forty per cent off lies between them. Three cheap steps
help. The totals come from the record (rigid_body_regression.py). Many variations of the shape parameters are
screened by one pass of an observer each. The best are fitted by continuation in process noise
(process_noise_continuation.py). Two starts that end at the best value found confirm it; otherwise more are made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from drivetool.identify.noise import Noise, first_samples_of, unit_noise_ratio
from drivetool.identify.problem import Point, Problem, Solution, schur
from drivetool.identify.setup import Outcome, Task, first_point
from drivetool.identify.starts.attempts import attempt_or_none, without_failed
from drivetool.identify.starts.process_noise_continuation import SHAPE_QUANTITIES, frozen_observers, frozen_value
from drivetool.identify.starts.rigid_body_regression import scaled_to_totals
from drivetool.progress import counted
from drivetool.quantity import quantity_of

# Log likelihood between two ends that agree, a choice: descents stop some units from the optimum.
MAX_AGREEING_LOSS = 5.0
# The same between their parameters, by the curvature there. A choice, above the former: flat directions differ
# most.
MAX_AGREEING_DISTANCE = 20.0
SHAPE_DRAWS = 40  # variations screened, a choice: each costs one pass over a part of the record
SHAPE_DRAW_STD = 0.3  # std of their logarithms: start values may be wrong by a third
SCREENING_SAMPLES = 8000  # samples screened, a choice that bounds the time of a pass
# Torque noise of the screening, over that which moves the output by its sensor noise. A choice: an observer
# strongly corrected by the record has few local optima, a weakly corrected one separates the variations better.
SCREENING_NOISE_RATIOS = (1.0, 0.1)
# Candidate, observer, initial noise ratio of the continuation.
DESCENT_PLAN = ((0, "linear", 10.0), (1, "linear", 1.0), (0, "exact", 10.0), (2, "linear", 1.0),
                (1, "linear", 10.0),
                (3, "linear", 1.0), (2, "exact", 10.0), (4, "linear", 1.0), (3, "linear", 10.0), (5, "linear", 1.0))

REPEATED_DESCENT = ("linear", 0.1)  # from the best so far, whose last steps may have ended in a local optimum
PARALLEL_STARTS = 2  # screening passes, and first descents, in parallel: two descents must agree in any case
DESCENTS_PER_REPEAT = 3  # descents after which a repeated one is made, a choice

T = TypeVar("T")


@dataclass(frozen=True)
class Descent(Generic[T]):
    """One start: its values, the observer, its -log likelihood, and its end."""

    start: Mapping[str, float]
    way: str
    value: float
    end: T


def multi_start_search(task: Task, starts: Sequence[Mapping[str, float]], seed: int,
             descend: Callable[[Task, str, float, float], tuple[float, T, Task]],
             distance: Callable[[T, T], float], max_descents: int | None = None) -> list[Descent[T]]:
    """Descents from several starts, in the order made; the first two, which are always needed, in parallel.

    starts        start values, one mapping each
    descend       (task at its start values, "linear" or "exact" observer, initial noise ratio, the lowest
                  -log likelihood so far) -> (-log likelihood, end, the task at the end)
    distance      (end, another) -> log likelihood by which the parameters of the two differ
    max_descents  None: as many as it takes for two to agree
    """
    candidates = ranked_starts(task, starts, seed)
    found: list[Descent[T]] = []
    ends: list[Task] = []

    def descent_from(index: int, way: str, noise_ratio: float) -> tuple[Descent[T], Task] | None:
        start = candidates[min(index, len(candidates) - 1)]
        lowest = min((d.value for d in found), default=np.inf)
        if (result := attempt_or_none(lambda: descend(start, way, noise_ratio, lowest))) is None:
            return None
        value, end, end_task = result
        return Descent(dict(zip(task.free, free_values(start).tolist(), strict=True)), way, value, end), end_task

    ways = DESCENT_PLAN[: max_descents or len(DESCENT_PLAN)]
    with ThreadPoolExecutor(PARALLEL_STARTS) as pool:
        pair = list(pool.map(lambda way: descent_from(*way), ways[:PARALLEL_STARTS]))
    for k, way in enumerate(counted("starts", ways, len(ways))):
        if (descent := pair[k] if k < len(pair) else descent_from(*way)) is None:
            continue
        found.append(descent[0])
        ends.append(descent[1])
        if len(found) % DESCENTS_PER_REPEAT == 0:
            i = min(range(len(found)), key=lambda j: found[j].value)
            repeated = attempt_or_none(lambda i=i: descend(ends[i], *REPEATED_DESCENT, found[i].value))
            if repeated is not None and repeated[0] < found[i].value:
                found[i], ends[i] = replace(found[i], value=repeated[0], end=repeated[1]), repeated[2]
        if max_descents is None and descents_agree(found, distance):
            break
    return without_failed(found or [None] * len(ways))


def descents_agree(found: Sequence[Descent[T]], distance: Callable[[T, T], float]) -> bool:
    """Whether a second descent ends at the likelihood of the best, and at the same parameters."""
    best = min(found, key=lambda d: d.value)
    return any(d is not best and d.value - best.value < MAX_AGREEING_LOSS
               and distance(best.end, d.end) < MAX_AGREEING_DISTANCE for d in found)


def log_likelihood_distance(problem: Problem, one: Solution, other: Solution) -> float:
    """Log likelihood by which two sets of parameters differ, by the curvature at the first.

    Unidentifiable directions do not count.
    """
    matrix, _, _ = schur(one.normal)
    variance = problem.variance(one.cost)
    change = other.point.values - one.point.values
    return float(0.5 * change @ matrix @ change / variance) if variance > 0.0 else 0.0


def start_agrees(outcome: Outcome, start: Mapping[str, Any]) -> bool:
    """Whether a start ended at the likelihood of the best one, and at the same values."""
    loss = start.get("minus_log_likelihood_above_best")
    if loss is None:
        loss = 0.5 * outcome.problem.count * float(np.log(start["cost_over_best"]))
    return loss < MAX_AGREEING_LOSS and start.get("apart", 0.0) < MAX_AGREEING_DISTANCE


def free_values(task: Task) -> np.ndarray:
    """(k,) the values of the free parameters."""
    return np.array([task.drive.value(n) or 0.0 for n in task.free])


def ranked_starts(task: Task, starts: Sequence[Mapping[str, float]], seed: int) -> list[Task]:
    """The first start, then the other starts and the variations in the order of their screening values."""
    balanced_starts = [scaled_to_totals(task.at(values)) for values in starts]
    others = balanced_starts[1:] + [task.at(values) for values in starts]
    rng = np.random.default_rng(seed)
    others += [_with_varied_shape(balanced_starts[k % len(balanced_starts)], rng) for k in range(SHAPE_DRAWS)]
    problem, linear = task.problem(), task.linear_problem()
    natural = unit_noise_ratio(problem, first_point(balanced_starts[0].drive, problem, task.roles))
    small, flat = first_samples_of(problem, SCREENING_SAMPLES), first_samples_of(linear, SCREENING_SAMPLES)

    def lowest(start: Task) -> float:
        values = screening_values(small, flat, start, natural, SCREENING_NOISE_RATIOS)
        return float(np.nan_to_num(min(values), nan=np.inf))

    with ThreadPoolExecutor(PARALLEL_STARTS) as pool:
        scores = list(pool.map(lowest, others))
    order = sorted(range(len(others)), key=lambda i: (scores[i], i))
    return balanced_starts[:1] + [others[i] for i in order]


def _with_varied_shape(task: Task, rng: np.random.Generator) -> Task:
    """Other shape parameters, the sum of the inertias kept."""
    names = [n for n in task.free if quantity_of(n) in SHAPE_QUANTITIES and (task.drive.value(n) or 0.0) > 0.0]
    factors = np.exp(SHAPE_DRAW_STD * rng.standard_normal(len(names)))
    new = {n: task.drive.value(n) * f for n, f in zip(names, factors, strict=True)}
    inertias = [n for n in names if quantity_of(n) == "inertia"]
    if inertias:
        share = sum(task.drive.value(n) for n in inertias) / sum(new[n] for n in inertias)
        new |= {n: new[n] * share for n in inertias}
    return task.at(new)


def screening_values(problem: Problem, linear: Problem, task: Task, natural: float,
                     shares: Sequence[float]) -> list[float]:
    """-log likelihood of a task's values under the linear drive's observers, one per share of the torque noise."""
    point = Point(free_values(task), first_point(task.drive, problem, task.roles).starts)
    values = []
    for share in shares:
        noise = Noise(share * natural, None, problem.scale, share * natural)
        values.append(frozen_value(problem, point, frozen_observers(problem, linear, point, noise)))
    return values
