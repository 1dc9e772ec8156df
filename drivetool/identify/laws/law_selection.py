"""Forward selection, by cross-validation over blocks, of the laws that a drive lacks.

The innovations of a fit are linear in the factors of known torques, with exact sensitivities under frozen gains. So
the search needs sums of products by block alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.identify.laws.influence import add_products
from drivetool.identify.laws.laws import Law, places_of
from drivetool.identify.noise import Noise, filtered, with_disturbance_state
from drivetool.identify.problem import Point, nonzero_scale
from drivetool.identify.setup import Task, has_gap
from drivetool.quantity import name_of

FOLDS = 8  # contiguous blocks; a choice within the usual 5 to 10 (Hastie, Tibshirani, Friedman, section 7.10)
# Log likelihood that a law must gain on held-out blocks: the best of fifty spurious ones does so once in 1e5.
MIN_LAW_GAIN = 15.0
# The same across a gap, where the filter's likelihood has many local optima: right models had up to 20.
MIN_LAW_GAIN_ACROSS_GAP = 40.0
# Of the largest gain. A smaller gain may only be correlated with that law, and is tested again with it in the fit.
MIN_GAIN_SHARE = 0.1
MAX_LAWS = 5  # a choice: a drive that lacks more laws needs another model
# Columns whose sensitivities are computed in one pass; a choice of memory against time.
SENSITIVITY_BATCH_COLUMNS = 8


def with_laws(task: Task, laws: Sequence[Law], factors: Sequence[float] | None = None) -> Task:
    """The task with further laws as known torques of free factors, named motor.law1 and so on by their body."""
    if not laws:
        return task
    known, more = task.drive.known_torques, sum(law.size for law in laws)
    bodies = [law.body for law in laws for _ in range(law.size)]
    names = tuple(name_of(body, f"law{len(known) + i + 1}") for i, body in enumerate(bodies))
    factors = np.zeros(more) if factors is None else factors
    drive = replace(task.drive, known_torques=(*known, *names),
                    values={**task.drive.values, **dict(zip(names, map(float, factors), strict=True))})
    experiments = []
    for k, e in enumerate(task.experiments):
        columns = np.nan_to_num(np.column_stack([law.on_grid(k) for law in laws]))
        experiments.append(replace(e, signals={**e.signals, **dict(zip(names, columns.T, strict=True))}))
    roles = replace(task.roles, inputs=(*task.roles.inputs, *names))
    return replace(task, drive=drive, free=(*task.free, *names), roles=roles, experiments=tuple(experiments))


def select_laws(task: Task, point: Point, noise: Noise, laws: Sequence[Law],
                max_laws: int = MAX_LAWS) -> tuple[list[Law], np.ndarray]:
    """(the laws that a fit lacks, the one with the largest gain first; their factors).

    task, point, noise   of an innovations fit
    laws                 that are not in it yet
    max_laws             that may be taken
    """
    sums, count = _sums(task, point, noise, laws), task.problem().count
    return forward_selection(sums, count, len(task.free), laws,
                             MIN_LAW_GAIN_ACROSS_GAP if has_gap(task) else MIN_LAW_GAIN,
                             max_laws)


def forward_selection(sums: np.ndarray, count: int, fitted: int, laws: Sequence[Law],
                      min_gain: float = MIN_LAW_GAIN,
                      max_laws: int = MAX_LAWS) -> tuple[list[Law], np.ndarray]:
    """(the laws that predict held-out blocks, the best first; their factors).

    sums    (FOLDS, p + 1, p + 1) of products of [fitted parameters, law columns, error], of `count` values
    fitted  number of the parameters; min_gain: log likelihood that a law must gain
    """
    chosen, base = [], np.arange(fitted)
    places = [np.arange(own.start, own.stop) for own in places_of(laws, fitted)]
    error, largest_gain, whole = _cross_validation_error(sums, base), 0.0, sums.sum(axis=0)
    if not error > 0.0:
        return [], np.empty(0)
    while len(chosen) < max_laws:
        # At most all of the noise acts on the drive: a factor beyond that is sensor noise, fed back to the torque.
        # And no transmission gains torque: one that seems to makes up for a torque that is not the drive's.
        before = np.concatenate([base, *(places[j] for j in chosen)])
        with_each = {i: np.concatenate([before, places[i]]) for i in range(len(laws)) if i not in chosen}
        error_with = {i: _cross_validation_error(sums, columns) for i, columns in with_each.items()
                      if not laws[i].positive or -_least_squares(whole, columns)[-laws[i].size] > 0.0}
        if not error_with:
            break
        best = min(error_with, key=error_with.__getitem__)
        gain = 0.5 * count * np.log(error / error_with[best])
        if gain < max(min_gain, MIN_GAIN_SHARE * largest_gain):
            break
        largest_gain = max(gain, largest_gain)
        chosen.append(best)
        error = error_with[best]
    columns = np.concatenate([base, *(places[j] for j in chosen)])
    return [laws[i] for i in chosen], -_least_squares(whole, columns)[len(base):]


def _sums(task: Task, point: Point, noise: Noise, laws: Sequence[Law]) -> np.ndarray:
    """(folds, p + 1, p + 1) sums of products of [fitted parameters, law columns, error], without start states."""
    task = task.at_point(point)
    passes, starts = filtered(task.problem(), point, noise), with_disturbance_state(point, noise).starts
    batches = _law_batches(laws)
    # Of the tasks with laws only the traces stay in memory.
    problems = [p.with_memory(noise.memory) for p in (
        task.problem(), *(with_laws(replace(task, free=()), batch).problem() for batch in batches))]
    values = [np.array([task.drive.values[n] for n in task.free]),
              *(np.zeros(sum(law.size for law in batch)) for batch in batches)]
    plants = [p.plants(v, True) for p, v in zip(problems, values, strict=True)]
    count, width = sum(t.size for t in problems[0].traces), len(task.free) + sum(law.size for law in laws) + 1
    total, done = np.zeros((FOLDS, width, width)), 0
    for i, trace in enumerate(problems[0].traces):
        states = plants[0][i].system.nq + np.setdiff1d(np.arange(plants[0][i].nx), problems[0].known(i))
        size = len(states) + width
        whole = np.zeros((FOLDS, size, size))
        for chunk in zip(*(each[i].sensitivities(p.traces[i], starts[i], passes[i].gains)
                           for each, p in zip(plants, problems, strict=True)), strict=True):
            part, first = chunk[0]
            columns = [rows[:, :, :len(v)] for (_, rows), v in zip(chunk, values, strict=True)]
            flat = np.concatenate([first[:, :, states], *columns, first[:, :, -1:]], axis=2)
            add_products(whole, flat, done + part.start, count)
        # Columns that diverge under the gains are left out.
        lost = ~np.isfinite(np.einsum("fii->i", whole))
        whole[:, lost], whole[:, :, lost] = 0.0, 0.0
        total += _project_out(whole, len(states))
        done += trace.size
    return total


def _law_batches(laws: Sequence[Law]) -> list[list[Law]]:
    """Laws whose sensitivities are computed in one pass."""
    found: list[list[Law]] = []
    for law in laws:
        if not found or sum(x.size for x in found[-1]) + law.size > SENSITIVITY_BATCH_COLUMNS:
            found.append([])
        found[-1].append(law)
    return found


def _project_out(sums: np.ndarray, nx: int) -> np.ndarray:
    """Sums of products with the first nx columns projected out of the others, by all folds together."""
    both = sums.sum(axis=0)
    size = nonzero_scale(np.sqrt(np.diag(both)[:nx]))
    share = np.linalg.lstsq(both[:nx, :nx] / np.outer(size, size), both[:nx, nx:] / size[:, None], rcond=1e-12)[0]
    share = share / size[:, None]
    cross = np.einsum("zc,fzd->fcd", share, sums[:, :nx, nx:])
    square = np.einsum("zc,fzy,yd->fcd", share, sums[:, :nx, :nx], share)
    return sums[:, nx:, nx:] - cross - np.swapaxes(cross, 1, 2) + square


def _least_squares(sums: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Least squares of the error on some columns."""
    size = nonzero_scale(np.sqrt(np.maximum(np.diag(sums)[columns], 0.0)))
    matrix = sums[np.ix_(columns, columns)] / np.outer(size, size)
    return np.linalg.lstsq(matrix, sums[columns, -1] / size, rcond=1e-12)[0] / size


def _cross_validation_error(sums: np.ndarray, columns: np.ndarray) -> float:
    """Cross-validation error: the squared error of each block by a fit to the others, summed."""
    size = nonzero_scale(np.sqrt(np.maximum(np.diag(sums.sum(axis=0))[columns], 0.0)))
    matrix = sums[:, columns[:, None], columns] / np.outer(size, size)
    right = sums[:, columns, -1] / size
    found = 0.0
    for f in range(len(sums)):
        rest, slope = matrix.sum(axis=0) - matrix[f], right.sum(axis=0) - right[f]
        value = np.linalg.lstsq(rest + 1e-7 * np.trace(rest) / len(rest) * np.eye(len(rest)), slope, rcond=1e-12)[0]
        found += sums[f, -1, -1] - 2.0 * value @ right[f] + value @ matrix[f] @ value
    return float(found)
