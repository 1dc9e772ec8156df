"""Whether held-out records need other parameter values than the fitted ones: machines change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.fit import (
    FIT_ERRORS,
    Model,
    fit,
    linear_step,
    on_task,
    over_traces,
    run_residual_tests,
    with_likeliest_noise,
)
from drivetool.check.heldout.scores import REFIT_ITERATIONS, Fold
from drivetool.finding import Finding
from drivetool.identify.noise import filtered_normal_equations
from drivetool.identify.problem import nonzero_scale, schur

# Log likelihood of other values, besides one per free parameter. A choice: so clear that no inexact law
# explains it.
MIN_CHANGE_GAIN = 25.0
# Of the gain of all parameters. A choice: few parameters that reach it explain the change.
SUFFICIENT_GAIN_SHARE = 0.9
MAX_CHANGED_PARAMETERS = 3  # a choice: a change in more parameters is no single physical cause
# A choice: parameters that are fitted separately, the largest expected gains first.
MAX_CANDIDATE_PARAMETERS = 2
MIN_RECORD_EIGENVALUE = 1e-12  # of the largest, below which neither record identifies a direction: rounding
# Log likelihood left in residuals with own values, below which the drive describes the records: as
# MIN_CHANGE_GAIN.
MAX_OWN_RESIDUAL = 25.0


@dataclass(frozen=True)
class Change:
    """Parameters that differ in held-out records.

    values     parameter -> (fitted value, value of the held-out records with the others fixed: without an interval,
               because part of the change may belong to those)
    gained     log likelihood that these bring
    described  whether the drive describes the records with values of their own
    records    their names
    """

    values: dict[str, tuple[float, float]]
    gained: float
    described: bool
    records: tuple[str, ...]


def change_between(model: Model, folds: Sequence[Fold]) -> Change | None:
    """Parameters that differ in the held-out records, None if they agree or only halves of records are held out.

    model  over all records
    """
    if len(folds) != 1:
        return None
    try:
        fitted = over_traces(model, [i for i, mask in enumerate(folds[0].test) if not mask.any()])
        return _change(*_held_out(model, folds[0]), fitted)
    except FIT_ERRORS:  # a record that cannot be fitted is no evidence
        return None


def _held_out(model: Model, fold: Fold) -> tuple[Model, list[np.ndarray]]:
    """(the model over the held-out records only, noise estimated there; masks of their samples)."""
    keep = [i for i, mask in enumerate(fold.test) if mask.any()]
    masks = [fold.again[i] for i in keep]
    return with_likeliest_noise(replace(over_traces(model, keep), task=model.fitted), masks), masks


def _information(model: Model) -> np.ndarray:
    """(k, k) of the free parameters, start states eliminated."""
    normal = filtered_normal_equations(model.problem, model.point, model.noise)
    return schur(normal)[0] / model.problem.variance(normal.cost)


def share_beyond(change: np.ndarray, information: np.ndarray, before: np.ndarray) -> float:
    """The share of a gain in log likelihood that the errors of both fits do not explain.

    Held-out records that identify a value better than the training records gain by a new value without any change.

    change  (k,) of the values; information: (k, k) of the held-out records
    before  (k, k) information of the training records: what they do not identify may have any value
    source  Wald 1943: the difference of two estimates over the sum of their covariances
    """
    whole = float(change @ information @ change)
    size = nonzero_scale(np.sqrt(np.diag(information + before)))
    both = np.linalg.pinv((information + before) / np.outer(size, size), rcond=MIN_RECORD_EIGENVALUE,
                          hermitian=True) / np.outer(size, size)
    return float(change @ before @ both @ information @ change) / whole if whole > 0.0 else 0.0


def _change(held: Model, masks: list[np.ndarray], fitted: Model) -> Change | None:
    own = fit(held, masks, max_iterations=REFIT_ITERATIONS)
    possible = held.value - own.value
    min_gain = MIN_CHANGE_GAIN + len(held.task.free)
    if not possible > min_gain:
        return None
    share = share_beyond(own.point.values - held.point.values, _information(own), _information(fitted))
    if not share * possible > min_gain:
        return None
    changed: tuple[str, ...] = ()
    best = held
    while len(changed) < MAX_CHANGED_PARAMETERS and held.value - best.value < SUFFICIENT_GAIN_SHARE * possible:
        trials = [fit(_with_free(best, held, (*changed, name)), masks, max_iterations=REFIT_ITERATIONS)
                  for name in _best_candidates(best, held, changed)]
        if not trials:
            break
        best = min(trials, key=lambda m: m.value)
        changed = best.task.free
    values = {n: (held.task.drive.value(n), float(best.point.values[j]))
              for j, n in enumerate(best.task.free)}
    left = run_residual_tests(own)
    return Change(values, held.value - best.value, left.total < MAX_OWN_RESIDUAL,
                  tuple(dict.fromkeys(t.name for t in held.problem.traces)))


def _with_free(best: Model, held: Model, names: Sequence[str]) -> Model:
    """The best model so far with these parameters free, the others at the fitted values."""
    return on_task(best, replace(best.fitted, free=tuple(n for n in held.task.free if n in names)))


def _best_candidates(best: Model, held: Model, changed: Sequence[str]) -> list[str]:
    """The parameters of the largest expected gain by one Gauss-Newton step, beside those already changed."""
    free = held.task.free
    whole = _with_free(best, held, free)
    normal = filtered_normal_equations(whole.problem, whole.point, whole.noise)
    expected_gain = {}
    for name in free:
        if name not in changed:
            moving = np.array([n in (*changed, name) for n in free])
            expected_gain[name] = linear_step(whole.problem, normal, moving)[2]
    return sorted(expected_gain, key=lambda n: -expected_gain[n])[:MAX_CANDIDATE_PARAMETERS]


def change_clause(change: Change, model: Model) -> str:
    """The values with which the held-out records fit best, in one clause."""
    drive = model.task.drive
    each = [f"{n} {after:.{_distinguishing_digits(before, after)}g} instead of "
            f"{before:.{_distinguishing_digits(before, after)}g} "
            f"{drive.unit(n)}".rstrip() for n, (before, after) in change.values.items()]
    return (f"{' and '.join(change.records)} {'fits' if len(change.records) == 1 else 'fit'} best with "
            f"{', '.join(each)}, all other values held")


def _distinguishing_digits(one: float, other: float) -> int:
    """Digits in which two values differ visibly, at least three."""
    return max(3, 2 + int(np.log10(max(abs(one), abs(other)) / max(abs(one - other), 1e-12 * abs(one) + 1e-300))))


def records_differ_text(change: Change, model: Model) -> str:
    """The outcome of a diagnosis that found nothing else."""
    if change.described:
        return (f"The parameters differ between the records: {change_clause(change, model)}. With these values the "
                "model describes the held-out data, and the other records identify no cause of the catalogue.")
    return (f"The model lacks an effect that no cause of the catalogue explains, and the parameters differ between "
            f"the records: {change_clause(change, model)}.")


def finding_of(change: Change, model: Model) -> Finding:
    """The same as a finding."""
    rest = (" With these values the model describes the held-out data, which are left out."
            if change.described else "")
    evidence = {f"{n}.{what}": value for n, (before, after) in change.values.items()
                for what, value in (("fitted", before), ("held_out", after))}
    return Finding(
        "warning", "parameters-change", f"{change_clause(change, model)}.{rest}",
        {**evidence, "log_likelihood": change.gained},
        "If the machine was warmer, worn or set up differently, fit each record separately. Hold out one that was "
        "made under the conditions of the others. If it covers another range, include it in the fit: the model may "
        "lack an effect.")
