"""A gap beside another law: two causes of which neither shows alone.

While the other law is missing the contacts close at wrong times, and the base, bent to make up for both, takes the
rest for noise of the torque. Under so loud a noise neither law gains much, from so bent a base neither is reached.
Both together are, by observers that cool (identify/cooling.py), begun where the base itself once began.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.candidates import CANDIDATES, Start, torque_size
from drivetool.check.hypothesis import BROKEN
from drivetool.check.model import Masks, Model, at_rest, fit, judge
from drivetool.check.structure import carried
from drivetool.identify.engine import Task, by_cooling
from drivetool.identify.innovations import Fit
from drivetool.identify.problem import Point
from drivetool.logs.experiment import Experiment
from drivetool.progress import counted

GAP = "backlash"
BESIDE = ("coulomb-motor", "coulomb-load", "stribeck-motor", "stribeck-load", "asymmetric-friction",
          "quadratic-drag", "load-dependent-damping", "third-mass", "torque-ripple", "imbalance")
WAYS = (("linear", 10.0), ("linear", 1.0), ("exact", 1.0))  # observers for a gap alone, and how hot
WAY = ("linear", 1.0)  # of both together
SOME = 0.03  # of the torque's spread: the dry friction that a descent begins with
SCREEN = 1  # round of the fit after a descent
LEAD = 20.0  # log likelihood by which both together must lead
WORKERS = 2


@dataclass(frozen=True)
class Pair:
    """A gap that shows beside other laws.

    gap      the base with the gap alone, begun where the likeliest pair ended
    further  code -> the gap and that cause, where its descents ended
    """

    gap: Model
    further: Mapping[str, Model]


@dataclass(frozen=True)
class _End:
    task: Task
    fit: Fit


def beside_a_gap(stand: Model, codes: Sequence[str], train: Sequence[Experiment], masks: Masks,
                 value: float) -> Pair | None:
    """The gap and what it shows beside, if both are clearly likelier than a value; None if nothing is.

    stand   the base where it ended, or where it began
    codes   causes that may be named
    train   records to fit to; masks: their samples in the problem of the base
    value   -log likelihood to do better than
    """
    causes = {c.code: c for c in CANDIDATES if c.code in codes}
    if GAP not in causes or len(stand.task.drive.bodies) != 2:
        return None
    gap = _with_gap(stand, causes[GAP].starts, train)
    if gap is None:
        return None

    def work(code: str) -> _End | None:
        try:
            return _descended([_seeded(start, gap) for start in causes[code].starts(gap)], train, [WAY])
        except BROKEN:
            return None

    beside = [code for code in BESIDE if code in causes]
    with ThreadPoolExecutor(WORKERS) as pool:
        ends = list(counted("a gap beside another law", pool.map(work, beside), len(beside)))
    best = {code: end for code, end in zip(beside, ends, strict=True) if end is not None}
    if not best:
        return None
    order = sorted(best, key=lambda code: best[code].fit.value)
    first = at_rest(_model(order[0], best[order[0]], stand, masks), masks)
    if not first.value < value - LEAD:
        return None
    return Pair(_gap_alone(first, stand, masks),
                {code: first if code == order[0] else _model(code, best[code], stand, masks) for code in order})


def _with_gap(stand: Model, starts, train: Sequence[Experiment]) -> Model | None:
    """The stand with the gap that a descent with the gap alone ends at, all else as it stands."""
    try:
        begun = starts(stand)
        end = _descended([s.task for s in begun], train, WAYS)
    except BROKEN:
        return None
    if end is None:
        return None
    name = next(n for n in end.task.free if n not in stand.task.free)
    task = begun[0].task.at({name: float(end.fit.point.values[end.task.free.index(name)])})
    problem = task.problem()
    return replace(stand, code=GAP, task=task, problem=problem, point=carried(stand, task, problem))


def _seeded(start: Start, base: Model) -> Task:
    """The task of a start, dry friction at a size that a descent can move."""
    return start.task.at({n: SOME * torque_size(base) for n in start.amplitudes
                          if n.endswith((".coulomb", ".stribeck"))})


def _descended(tasks: Sequence[Task], train: Sequence[Experiment],
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


def _gap_alone(both: Model, base: Model, masks: Masks) -> Model:
    """The base with the gap, fitted from the values of both together."""
    task = both.fitted
    names = {n for n in task.free if n in base.task.free or n.endswith(".half_gap")}
    drive = replace(base.task.drive, values={**base.task.drive.values, **{n: task.drive.value(n) for n in names}})
    alone = replace(base.task, drive=drive, free=tuple(n for n in drive.quantities if n in names))
    problem = alone.problem()
    return at_rest(fit(GAP, alone, problem, carried(base, alone, problem), base.noise, masks), masks)
