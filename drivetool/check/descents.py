"""Causes by descents: observers that cool (identify/cooling.py), begun where the base once began.

A base that lacks a law bends its parameters to make up for it and takes the rest for noise of the torque. Under
so loud a noise no law gains much, and from so bent a base none is reached. Worst is a gap beside another law, for
while that is missing the contacts come at wrong times: neither shows alone, both together do.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.causes import FITTED
from drivetool.check.causes.cause import Start
from drivetool.check.causes.starts import torque_size
from drivetool.check.model import BROKEN, Masks, Model, at_rest, fit, judge
from drivetool.check.structure import carried
from drivetool.identify.engine import Task, by_cooling
from drivetool.identify.innovations import Fit
from drivetool.identify.problem import Point
from drivetool.logs.experiment import Experiment
from drivetool.progress import counted

GAP = "backlash"
LAWS = (GAP, "coulomb-motor", "coulomb-load", "stribeck-motor", "stribeck-load", "asymmetric-friction",
        "quadratic-drag", "hardening-stiffness", "load-dependent-damping", "third-mass", "torque-ripple",
        "imbalance")
WAYS = (("linear", 1.0), ("linear", 10.0), ("exact", 1.0))  # observers, and how hot; the first for all but a gap
SOME = 0.03  # of the torque's spread: the dry friction that a descent begins with
SCREEN = 1  # round of the fit after a descent
WORKERS = 2


@dataclass(frozen=True)
class _End:
    task: Task
    fit: Fit


def descended(stand: Model, codes: Sequence[str], train: Sequence[Experiment], masks: Masks) -> dict[str, Model]:
    """Causes on top of a base where their descents ended, by code, the likeliest first.

    stand  the base where the descents begin
    codes  causes to try: those that have a descent
    train  records to fit to; masks: their samples in the problem of the base
    """
    causes = {c.code: c for c in FITTED if c.code in codes and c.code in LAWS}

    def work(code: str) -> _End | None:
        try:
            tasks = [_seeded(start, stand) for start in causes[code].starts(stand)]
            return _best_end(tasks, train, WAYS if code == GAP else WAYS[:1])
        except BROKEN:
            return None

    with ThreadPoolExecutor(WORKERS) as pool:
        ends = list(counted("a second look", pool.map(work, causes), len(causes)))
    found = {code: _model(code, end, stand, masks)
             for code, end in zip(causes, ends, strict=True) if end is not None}
    return dict(sorted(found.items(), key=lambda item: item[1].value))


def with_gap(stand: Model, gap: Model) -> Model:
    """The stand with the gap that a descent has found, all else as it stands."""
    values = {n: gap.fitted.drive.value(n) for n in gap.task.free if n not in stand.task.free}
    task = gap.task.at({**{n: stand.fitted.drive.value(n) for n in stand.task.free}, **values})
    problem = task.problem()
    return replace(stand, code=GAP, task=task, problem=problem, point=carried(stand, task, problem))


def _seeded(start: Start, base: Model) -> Task:
    """The task of a start, dry friction at a size that a descent can move."""
    return start.task.at({n: SOME * torque_size(base, n.rpartition(".")[0]) for n in start.amplitudes
                          if n.endswith((".coulomb", ".stribeck"))})


def _best_end(tasks: Sequence[Task], train: Sequence[Experiment],
              ways: Sequence[tuple[str, float]]) -> _End | None:
    """The best end of the descents from some tasks."""
    ends = []
    for task in tasks:
        own = replace(task, experiments=tuple(train))
        problem, linear = own.problem(), own.linear_problem()
        for way, hot in ways:
            try:
                ends.append(_End(task, by_cooling(own, problem, linear if way == "linear" else None, hot, SCREEN)))
            except BROKEN:
                continue
    return min((e for e in ends if np.isfinite(e.fit.value)), key=lambda e: e.fit.value, default=None)


def _model(code: str, end: _End, base: Model, masks: Masks) -> Model:
    """An end as an explanation of all records: those that only judge begin where the base has them."""
    task, problem = end.task, end.task.problem()
    starts = carried(base, task, problem).starts
    point = Point(end.fit.point.values, (*end.fit.point.starts, *starts[len(end.fit.point.starts):]))
    return Model(code, task, problem, point, end.fit.noise, judge(problem, point, end.fit.noise, masks))


def gap_alone(both: Model, base: Model, masks: Masks) -> Model:
    """The base with the gap, fitted from the values of the gap beside another law."""
    task = both.fitted
    names = {n for n in task.free if n in base.task.free or n.endswith(".half_gap")}
    drive = replace(base.task.drive, values={**base.task.drive.values, **{n: task.drive.value(n) for n in names}})
    alone = replace(base.task, drive=drive, free=tuple(n for n in drive.quantities if n in names))
    problem = alone.problem()
    return at_rest(fit(GAP, alone, problem, carried(base, alone, problem), base.noise, masks), masks)
