"""Whether records held out ask for other values than those that the drive was fitted to: machines change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.fit import BROKEN, Model, fit, likeliest_noise, linear_step, over, remainder
from drivetool.check.heldout.scores import REFIT, Fold
from drivetool.errors import Finding
from drivetool.identify.noise import normal_under
from drivetool.identify.problem import Point, schur
from drivetool.identify.setup import problem_of

PLAIN = 25.0  # log likelihood that other values must bring
WHOLE = 0.9  # of what all parameters bring, that a few account for
FEW = 3  # parameters that are said to have changed
TRIED = 2  # parameters that are fitted by themselves, the most promising ones
NULL = 1e-12  # of the largest eigenvalue, below which neither record tells a direction
OWN = 25.0  # log likelihood to be had with values of their own, below which the drive describes the records


@dataclass(frozen=True)
class Change:
    """What records held out ask for.

    values     parameter -> (value that the drive was fitted to, the one they ask for with the others held: without
               an interval, for a little of the change may belong to those)
    gained     log likelihood that these bring, of `possible` by all parameters
    described  whether the drive describes the records with values of their own
    records    their names
    """

    values: dict[str, tuple[float, float]]
    gained: float
    possible: float
    described: bool
    records: tuple[str, ...]


def change_between(model: Model, folds: Sequence[Fold]) -> Change | None:
    """What the records held out ask for, None if they agree or nothing but halves of records is held out.

    model  over all records
    """
    if len(folds) != 1:
        return None
    try:
        fitted = over(model, [i for i, mask in enumerate(folds[0].test) if not mask.any()])
        return _change(*_held_out(model, folds[0]), fitted)
    except BROKEN:  # what cannot be fitted by itself asks for nothing
        return None


def _held_out(model: Model, fold: Fold) -> tuple[Model, list[np.ndarray]]:
    """(the model over the records held out alone, noise estimated there; which samples of those count)."""
    keep = [i for i, mask in enumerate(fold.test) if mask.any()]
    masks = [fold.again[i] for i in keep]
    return likeliest_noise(replace(over(model, keep), task=model.fitted), masks), masks


def _information(model: Model) -> np.ndarray:
    """(k, k) of the free parameters, start states eliminated."""
    normal = normal_under(model.problem, model.point, model.noise)
    variance = normal.cost / max(model.problem.count - model.problem.unknowns, 1)
    return schur(normal)[0] / variance


def share_beyond(change: np.ndarray, told: np.ndarray, before: np.ndarray) -> float:
    """The share of a gain in log likelihood that the errors of both fits do not bring.

    A record that tells a value better than those of the fit did asks for another one, and gains by it.

    change  (k,) of the values; told: (k, k) information of the records that ask for it
    before  (k, k) information of the records of the fit: what they do not tell may be anything
    source  Wald 1943: the difference of two estimates over the sum of their covariances
    """
    whole = float(change @ told @ change)
    size = np.sqrt(np.diag(told + before))
    size[size == 0.0] = 1.0
    both = np.linalg.pinv((told + before) / np.outer(size, size), rcond=NULL, hermitian=True) / np.outer(size, size)
    return float(change @ before @ both @ told @ change) / whole if whole > 0.0 else 0.0


def _change(held: Model, masks: list[np.ndarray], fitted: Model) -> Change | None:
    own = fit(held, masks, most=REFIT)
    possible = held.value - own.value
    plain = PLAIN + len(held.task.free)
    if not possible > plain:
        return None
    share = share_beyond(own.point.values - held.point.values, _information(own), _information(fitted))
    if not share * possible > plain:
        return None
    told: tuple[str, ...] = ()
    best = held
    while len(told) < FEW and held.value - best.value < WHOLE * possible:
        trials = [fit(_freed(best, held, (*told, name)), masks, most=REFIT)
                  for name in _promising(best, held, told)]
        if not trials:
            break
        best = min(trials, key=lambda m: m.value)
        told = best.task.free
    values = {n: (held.task.drive.value(n), float(best.point.values[j]))
              for j, n in enumerate(best.task.free)}
    left = remainder(own)
    return Change(values, held.value - best.value, possible, left.total < OWN,
                  tuple(dict.fromkeys(t.name for t in held.problem.traces)))


def _freed(best: Model, held: Model, names: Sequence[str]) -> Model:
    """The best model so far with these parameters free, the others where the drive was fitted to."""
    task = replace(best.fitted, free=tuple(n for n in held.task.free if n in names))
    problem = problem_of(task.drive, task.free, task.roles, held.problem.traces)
    values = np.array([task.drive.value(n) for n in task.free])
    point = Point(values, best.point.starts)
    return replace(best, task=task, problem=problem, point=point)


def _promising(best: Model, held: Model, told: Sequence[str]) -> list[str]:
    """The parameters that one linear step says would bring most beside those told."""
    free = held.task.free
    whole = _freed(best, held, free)
    normal = normal_under(whole.problem, whole.point, whole.noise)
    promise = {}
    for name in free:
        if name not in told:
            moves = np.array([n in (*told, name) for n in free])
            promise[name] = linear_step(whole.problem, normal, moves)[2]
    return sorted(promise, key=lambda n: -promise[n])[:TRIED]


def words_of(change: Change, model: Model) -> str:
    """What the records held out ask for, in one clause."""
    drive = model.task.drive
    each = [f"{n} {after:.{_digits(before, after)}g} instead of {before:.{_digits(before, after)}g} "
            f"{drive.unit(n)}".rstrip() for n, (before, after) in change.values.items()]
    return f"{' and '.join(change.records)} asks for {', '.join(each)}, all other values held"


def _digits(one: float, other: float) -> int:
    """Digits in which two values are seen to differ, at least three."""
    return max(3, 2 + int(np.log10(max(abs(one), abs(other)) / max(abs(one - other), 1e-12 * abs(one) + 1e-300))))


def told_apart(change: Change, model: Model) -> str:
    """The outcome of a diagnosis that found nothing else."""
    if change.described:
        return (f"The records differ from one another: {words_of(change, model)}. With values of its own the drive "
                "describes it, and in the other records no cause in the catalogue shows.")
    return (f"Something is missing that no cause in the catalogue explains, and the records differ: "
            f"{words_of(change, model)}.")


def finding_of(change: Change, model: Model) -> Finding:
    """The same as a finding."""
    rest = " With values of its own the drive describes it; it was left out." if change.described else ""
    evidence = {f"{n}.{what}": value for n, (before, after) in change.values.items()
                for what, value in (("fitted", before), ("held_out", after))}
    return Finding(
        "warning", "held-out-record-differs", f"{words_of(change, model)}.{rest}",
        {**evidence, "log_likelihood": change.gained},
        "If the machine was warmer, worn or set up otherwise, fit each record by itself, and hold out one that was "
        "made under the conditions of the others. If it ran in another range, give it with the others: a law may "
        "be missing.")
