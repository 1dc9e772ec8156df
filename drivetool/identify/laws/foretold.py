"""Which laws the motion foretells in parts of the record that were left out: the drive lacks them.

The innovations of a fit are linear in the factors of known torques, with exact sensitivities under frozen gains. So
sums of products by block are all that the search needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.identify.laws.laws import UNFELT, Law
from drivetool.identify.noise import Noise, filtered, with_state
from drivetool.identify.problem import Point
from drivetool.identify.setup import Task, has_gap

FOLDS = 8  # contiguous blocks
# Log likelihood that a law must gain where it was not fitted: the best of fifty that are none does so once in 1e5.
GAIN = 15.0
# The same across a gap, where the filter's likelihood is rough: right models had up to 20.
ACROSS_GAP = 40.0
SHADOW = 0.1  # of the largest gain: what is less may be its shadow, and is looked for again when that law is in
MOST = 5
BATCH = 8  # columns whose sensitivities are worked out in one pass


def with_laws(task: Task, laws: Sequence[Law], factors: Sequence[float] | None = None) -> Task:
    """The task with further laws as known torques of free factors, named motor.law1 and so on by their body."""
    if not laws:
        return task
    there, more = task.drive.known_torques, sum(law.size for law in laws)
    bodies = [law.body for law in laws for _ in range(law.size)]
    names = tuple(f"{body}.law{len(there) + i + 1}" for i, body in enumerate(bodies))
    factors = np.zeros(more) if factors is None else factors
    drive = replace(task.drive, known_torques=(*there, *names),
                    values={**task.drive.values, **dict(zip(names, map(float, factors), strict=True))})
    experiments = []
    for k, e in enumerate(task.experiments):
        columns = np.nan_to_num(np.column_stack([law.columns[k] for law in laws]))
        experiments.append(replace(e, signals={**e.signals, **dict(zip(names, columns.T, strict=True))}))
    roles = replace(task.roles, inputs=(*task.roles.inputs, *names))
    return replace(task, drive=drive, free=(*task.free, *names), roles=roles, experiments=tuple(experiments))


def foretold(task: Task, point: Point, noise: Noise, laws: Sequence[Law],
             most: int = MOST) -> tuple[list[Law], np.ndarray]:
    """(the laws that a fit lacks, the one that foretells most first; their factors).

    task, point, noise   of an innovations fit
    laws                 that are not in it yet
    most                 that may be taken
    """
    sums, count = _sums(task, point, noise, laws), task.problem().count
    return foretelling(sums, count, len(task.free), laws, ACROSS_GAP if has_gap(task) else GAIN, most)


def foretelling(sums: np.ndarray, count: int, fitted: int, laws: Sequence[Law], least: float = GAIN,
                most: int = MOST) -> tuple[list[Law], np.ndarray]:
    """(the laws that foretell blocks to which they were not fitted, the best first; their factors).

    sums    (FOLDS, p + 1, p + 1) of products of [fitted parameters, law columns, error], of `count` values
    fitted  number of the parameters; least: log likelihood that a law must gain
    """
    chosen, base = [], np.arange(fitted)
    places, k = [], len(base)
    for law in laws:
        places.append(np.arange(k, k + law.size))
        k += law.size
    now, largest, whole = _left_out(sums, base), 0.0, sums.sum(axis=0)
    # A drive feels at most all of the noise. More than all is a sensor's, which feedback has put on the torque.
    if not now > 0.0:
        return [], np.empty(0)
    possible = [i for i, law in enumerate(laws)
                if law.name != UNFELT or -_solved(whole, np.concatenate([base, places[i]]))[-1] > 0.0]
    while len(chosen) < min(most, len(possible)):
        left = {i: _left_out(sums, np.concatenate([base, *(places[j] for j in chosen), places[i]]))
                for i in possible if i not in chosen}
        best = min(left, key=left.__getitem__)
        gain = 0.5 * count * np.log(now / left[best])
        if gain < max(least, SHADOW * largest):
            break
        largest = max(gain, largest)
        chosen.append(best)
        now = left[best]
    columns = np.concatenate([base, *(places[j] for j in chosen)])
    return [laws[i] for i in chosen], -_solved(whole, columns)[len(base):]


def _sums(task: Task, point: Point, noise: Noise, laws: Sequence[Law]) -> np.ndarray:
    """(folds, p + 1, p + 1) sums of products of [fitted parameters, law columns, error], start states taken out."""
    task = task.at_point(point)
    passes, starts = filtered(task.problem(), point, noise), with_state(point, noise).starts
    tasks = [task, *(with_laws(replace(task, free=()), batch) for batch in _batches(laws))]
    problems = [t.problem().with_memory(noise.memory) for t in tasks]
    plants = [p.plants(np.array([t.drive.values[n] for n in t.free]), True)
              for p, t in zip(problems, tasks, strict=True)]
    count, width = sum(t.size for t in problems[0].traces), len(task.free) + sum(law.size for law in laws) + 1
    total, done = np.zeros((FOLDS, width, width)), 0
    for i, trace in enumerate(problems[0].traces):
        states = plants[0][i].system.nq + np.setdiff1d(np.arange(plants[0][i].nx), problems[0].known(i))
        size = len(states) + width
        whole = np.zeros((FOLDS, size, size))
        for chunk in zip(*(each[i].sensitivities(p.traces[i], starts[i], passes[i].gains)
                           for each, p in zip(plants, problems, strict=True)), strict=True):
            part, first = chunk[0]
            columns = [rows[:, :, :len(t.free)] for (_, rows), t in zip(chunk, tasks, strict=True)]
            flat = np.concatenate([first[:, :, states], *columns, first[:, :, -1:]], axis=2)
            fold = (done + np.arange(part.start, part.stop)) * FOLDS // count
            for f in np.unique(fold):
                rows = flat[fold == f].reshape(-1, size)
                with np.errstate(over="ignore", invalid="ignore"):
                    whole[f] += rows.T @ rows
        # What runs away under the gains foretells nothing.
        lost = ~np.isfinite(np.einsum("fii->i", whole))
        whole[:, lost], whole[:, :, lost] = 0.0, 0.0
        total += _without(whole, len(states))
        done += trace.size
    return total


def _batches(laws: Sequence[Law]) -> list[list[Law]]:
    """Laws that are worked out in one pass."""
    found: list[list[Law]] = []
    for law in laws:
        if not found or sum(x.size for x in found[-1]) + law.size > BATCH:
            found.append([])
        found[-1].append(law)
    return found


def _without(sums: np.ndarray, nx: int) -> np.ndarray:
    """Sums of products with the first nx columns projected out of the others, by all folds together."""
    both = sums.sum(axis=0)
    size = np.sqrt(np.diag(both)[:nx])
    size[size == 0.0] = 1.0
    share = np.linalg.lstsq(both[:nx, :nx] / np.outer(size, size), both[:nx, nx:] / size[:, None], rcond=1e-12)[0]
    share = share / size[:, None]
    cross = np.einsum("zc,fzd->fcd", share, sums[:, :nx, nx:])
    square = np.einsum("zc,fzy,yd->fcd", share, sums[:, :nx, :nx], share)
    return sums[:, nx:, nx:] - cross - np.swapaxes(cross, 1, 2) + square


def _solved(sums: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Least squares of the error on some columns."""
    size = np.sqrt(np.maximum(np.diag(sums)[columns], 0.0))
    size[size == 0.0] = 1.0
    matrix = sums[np.ix_(columns, columns)] / np.outer(size, size)
    return np.linalg.lstsq(matrix, sums[columns, -1] / size, rcond=1e-12)[0] / size


def _left_out(sums: np.ndarray, columns: np.ndarray) -> float:
    """Squared error of all blocks, each foretold by what was fitted to the others."""
    size = np.sqrt(np.maximum(np.diag(sums.sum(axis=0))[columns], 0.0))
    size[size == 0.0] = 1.0
    matrix = sums[:, columns[:, None], columns] / np.outer(size, size)
    right = sums[:, columns, -1] / size
    found = 0.0
    for f in range(len(sums)):
        rest, slope = matrix.sum(axis=0) - matrix[f], right.sum(axis=0) - right[f]
        value = np.linalg.lstsq(rest + 1e-7 * np.trace(rest) / len(rest) * np.eye(len(rest)), slope, rcond=1e-12)[0]
        found += sums[f, -1, -1] - 2.0 * value @ right[f] + value @ matrix[f] @ value
    return float(found)
