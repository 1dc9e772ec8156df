"""Laws that the motion predicts and the drive lacks, found in the residual torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from drivetool.identify.inverse.regression import InverseFit, InverseRegression, solve_inverse
from drivetool.identify.laws import (
    FOLDS,
    MAX_LAWS,
    MIN_LAW_GAIN,
    STRIBECK_NAME,
    Law,
    forward_selection,
    law_library,
    projected_within_bounds,
    projection_of_laws,
)
from drivetool.identify.motion import AUTOREGRESSION_ORDER, Motions, autoregression, smoothed
from drivetool.identify.setup import Roles, Task
from drivetool.quantity import name_of


def missing_laws_of(record: InverseRegression) -> tuple[str, ...]:
    """Names of the laws that predict held-out blocks of the records.

    record  at fitted values. The residual torque is whitened first, or its memory would pass for a law. With a
            reference the laws are over the motion that the reference predicts, since a disturbance moves the
            measured one too. Without one, a law must explain a larger share of the residual than the residual is
            of the torque
    """
    known = {law.name for law in record.laws[0]}
    laws = [law for law in _candidate_laws(record, _exogenous_motion(record)) if law.name not in known]
    if not laws:
        return ()
    parts, powers, measured = [], np.zeros(2), record.with_motion()
    others = record.with_motion(predicted=True) if record.predicted else measured
    for i, (e, q, z) in enumerate(zip(record.experiments, measured, others, strict=True)):
        used = q.used & z.used
        powers += [float(np.sum(v[used] ** 2)) for v in (q.residual, q.torque)]
        used, residual = used[::record.kept], q.residual[::record.kept]
        columns = [smoothed(np.nan_to_num(c), e, record.seen.each[i], record.seen.lag > 0)[::record.kept][used]
                   for law in laws for c in law.on_grid(i).T]
        rows = np.column_stack([z.slopes[::record.kept][used], *columns, residual[used]])
        # Only what has used samples alone before it counts, and there the rows left out do not matter.
        white = scipy.signal.lfilter(autoregression(np.where(used, residual, 0.0)), [1.0], rows, axis=0)
        whole = np.convolve(used, np.ones(AUTOREGRESSION_ORDER + 1),
                            "full")[:len(used)] > AUTOREGRESSION_ORDER + 0.5
        parts.append(white[whole[used]])
    rows = np.concatenate(parts)
    fold = np.arange(len(rows)) * FOLDS // max(len(rows), 1)
    sums = np.array([rows[fold == f].T @ rows[fold == f] for f in range(FOLDS)])
    share = 0.0 if record.predicted or powers[1] <= 0.0 else min(powers[0] / powers[1], 1.0 - 1e-12)
    min_gain = max(MIN_LAW_GAIN, -0.5 * len(rows) * float(np.log1p(-share)))
    return tuple(law.name for law in forward_selection(sums, len(rows), len(record.free), laws, min_gain)[0])


def solve_with_laws(record: InverseRegression) -> InverseFit:
    """A fit, with the missing laws as further torques."""
    fit, names = solve_inverse(record), ()
    while more := missing_laws_of(fit.at)[:MAX_LAWS - len(names)]:
        names = (*names, *more)
        fit = solve_inverse(with_laws(fit.at.alone(own_parameters_of(fit)[1]), names))
    return fit


def with_laws(record: InverseRegression, names: Sequence[str]) -> InverseRegression:
    """The record with laws as torques of free factors on the motor's body, as far as its motion allows them."""
    measured = {law.name: law for law in _candidate_laws(record, record.seen) if law.name in names}
    if not measured:
        return record
    foreseen = measured
    if record.predicted:
        over = _candidate_laws(record, _exogenous_motion(record))
        foreseen = measured | {law.name: law for law in over if law.name in measured}
    body, count = record.drive.bodies[0], sum(law.size for law in measured.values())
    factors = tuple(name_of(body, f"law{i + 1}") for i in range(count))
    values = {**record.drive.values, **dict.fromkeys(factors, 0.0)}
    drive = replace(record.drive, known_torques=factors, values=values)
    return replace(record, drive=drive, free=(*record.own, *factors),
                   laws=(tuple(measured.values()), tuple(foreseen[n] for n in measured)))


def own_parameters_of(fit: InverseFit) -> tuple[np.ndarray, np.ndarray]:
    """((k, k + m) from the fitted to the drive's own parameters, see `nearest_line`; (k,) those in bounds)."""
    record = fit.at
    task = Task(record.drive, record.own, Roles((), ()), record.experiments)
    seen = {record.drive.bodies[0]: record.seen}
    line = projection_of_laws(task, record.laws[0], seen)
    return line, projected_within_bounds(task, line @ fit.values, seen) if record.laws[0] else fit.values


def _exogenous_motion(record: InverseRegression) -> Motions:
    return replace(record.seen, each=record.predicted) if record.predicted else record.seen


def _candidate_laws(record: InverseRegression, seen: Motions) -> tuple[Law, ...]:
    """The candidate laws: no friction peak at low speed, since reversals are left out or rounded."""
    found = law_library(seen, record.drive.motion_unit == "rad", record.drive.bodies[0])
    return tuple(law for law in found if not (law.parameter or law.name.startswith(STRIBECK_NAME)))
