"""Laws that the motion foretells and the drive lacks, found by the torque that is left over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from drivetool.identify.inverse.regression import Inverse, Solved, solved
from drivetool.identify.laws import FOLDS, GAIN, MOST, PEAK, Law, foretelling, library, nearest_line, within_bounds
from drivetool.identify.motion import ORDER, Motions, autoregression, smoothed
from drivetool.identify.setup import Roles, Task


def lacking(record: Inverse) -> tuple[str, ...]:
    """Names of the laws by which blocks of the records are foretold that had no part in fitting them.

    record  at fitted values. What is left of the torque is whitened first, or its memory would pass for a law. With
            a reference the laws are over the motion that it foretells: what moved the body by itself moved the
            measured one too, and without one a law must explain a larger share of what is left than that is of the
            torque
    """
    known = {law.name for law in record.laws[0]}
    laws = [law for law in _library(record, _exogenous(record)) if law.name not in known]
    if not laws:
        return ()
    parts, powers, measured = [], np.zeros(2), record.with_motion()
    others = record.with_motion(foreseen=True) if record.foreseen else measured
    for i, (e, q, z) in enumerate(zip(record.experiments, measured, others, strict=True)):
        columns = [smoothed(np.nan_to_num(c), e, record.seen.each[i], record.seen.lag > 0)
                   for law in laws for c in law.columns[i].T]
        rows = np.column_stack([z.slopes, *columns, q.residual])
        used = q.used & z.used & np.isfinite(rows).all(axis=1)
        powers += [float(np.sum(v[used] ** 2)) for v in (q.residual, q.torque)]
        rows, used = np.where(used[:, None], rows, 0.0)[::record.kept], used[::record.kept]
        white = lfilter(autoregression(rows[:, -1]), [1.0], rows, axis=0)
        whole = np.convolve(used, np.ones(ORDER + 1), "full")[:len(used)] > ORDER + 0.5
        parts.append(white[whole])
    rows = np.concatenate(parts)
    fold = np.arange(len(rows)) * FOLDS // max(len(rows), 1)
    sums = np.array([rows[fold == f].T @ rows[fold == f] for f in range(FOLDS)])
    share = 0.0 if record.foreseen or powers[1] <= 0.0 else min(powers[0] / powers[1], 1.0 - 1e-12)
    least = max(GAIN, -0.5 * len(rows) * float(np.log1p(-share)))
    return tuple(law.name for law in foretelling(sums, len(rows), len(record.free), laws, least)[0])


def solved_with_laws(record: Inverse) -> Solved:
    """A fit, with the laws that it lacks taken out."""
    fit, names = solved(record), ()
    while more := lacking(fit.at)[:MOST - len(names)]:
        names = (*names, *more)
        fit = solved(with_laws(fit.at.alone(own_of(fit)[1]), names))
    return fit


def with_laws(record: Inverse, names: Sequence[str]) -> Inverse:
    """The record with laws as torques of free factors on the motor's body; those that its motion has."""
    measured = {law.name: law for law in _library(record, record.seen) if law.name in names}
    if not measured:
        return record
    foreseen = measured
    if record.foreseen:
        over = _library(record, _exogenous(record))
        foreseen = measured | {law.name: law for law in over if law.name in measured}
    body, count = record.drive.bodies[0], sum(law.size for law in measured.values())
    factors = tuple(f"{body}.law{i + 1}" for i in range(count))
    values = {**record.drive.values, **dict.fromkeys(factors, 0.0)}
    drive = replace(record.drive, known_torques=factors, values=values)
    return replace(record, drive=drive, free=(*record.own, *factors),
                   laws=(tuple(measured.values()), tuple(foreseen[n] for n in measured)))


def own_of(fit: Solved) -> tuple[np.ndarray, np.ndarray]:
    """((k, k + m) from what is fitted to the drive's own parameters, see `nearest_line`; (k,) those in bounds)."""
    record = fit.at
    task = Task(record.drive, record.own, Roles((), ()), record.experiments)
    seen = {record.drive.bodies[0]: record.seen}
    line = nearest_line(task, record.laws[0], seen)
    return line, within_bounds(task, line @ fit.values, seen) if record.laws[0] else fit.values


def _exogenous(record: Inverse) -> Motions:
    return replace(record.seen, each=record.foreseen) if record.foreseen else record.seen


def _library(record: Inverse, seen: Motions) -> tuple[Law, ...]:
    """What may be found: no peak of friction at low speed, since reversals are left out or rounded."""
    found = library(seen, record.drive.motion_unit == "rad", record.drive.bodies[0])
    return tuple(law for law in found if not (law.parameter or law.name.startswith(PEAK)))
