"""A gap before a light load: it bounces between the flanks, and the likelihood is all valleys.

Each knock decides the next one, so a fit from a few half gaps ends in the first valley it comes to, hundreds of
units of log likelihood above the best. Under a torque noise on the load too the filter lets the load follow, and
valleys are wider; and the base, which has no gap, takes the load and its shaft for lighter, or heavier, together.
From the best valley the next is looked for close by, as long as there is a better one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np

from drivetool.check.fit import BROKEN, Masks, Model, begun, carried, everything, few_steps, first_noise, fit, judge
from drivetool.check.starts.base import added, present, torque_size
from drivetool.identify.identifiability import load_share
from drivetool.identify.noise import fit_innovations, settle
from drivetool.identify.problem import Point
from drivetool.identify.setup import Outcome, Task, problem_of
from drivetool.identify.starts import CONFIRMED, apart

LIGHT = 0.5  # of the motor's inertia, below which a load is, as far as a base without the gap tells it
SCALES = (0.7, 0.85, 1.0, 1.2, 1.44)  # of the load and its shaft, over what the base has
SHARES = (0.06, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7)  # half gaps, over the twist that the torque makes
CLOSE = tuple(product((0.9, 1.0, 1.1), (0.85, 1.0, 1.17)))  # of load and shaft, and of the gap, over the best's
LISTENED = (1, 4)  # those of them at which the noise is heard, where there are several sensors
STEPS = 10
ROUNDS = 4  # of the fits that follow
RESTED = 24  # rounds in which such a fit comes to rest: from valley to valley a dozen may not do
FOLLOWED = 6  # ends under the load's noise that are followed without it
GAINED = 10.0  # log likelihood over the base without which a gap is none that is worth looking for on
BETTER = 1.0  # the same, by which the next valley must be
VALLEYS = 6  # times that it is looked for, at most


def rattles(base: Model, masks: Masks) -> list[Model]:
    """Fits of a gap from many starts, the likeliest first; none where one is there, or a few half gaps will do."""
    drive = base.fitted.drive
    if len(drive.bodies) != 2 or present(base, f"{drive.shafts[0]}.half_gap"):
        return []
    shaft = drive.shafts[0]
    twist = torque_size(base, shaft) / drive.value(f"{shaft}.stiffness")
    tasks = [added(base, {f"{shaft}.half_gap": share * twist}, ()).task for share in SHARES]
    heard = _heard(base, [tasks[i] for i in LISTENED], masks)
    if load_share(drive) > LIGHT and heard is None:
        return []
    base = heard or base
    found = _followed([_begun(base, task, scale, 1.0) for task in tasks for scale in SCALES], base, masks)
    for _ in range(VALLEYS):
        best = found[0].value if found else np.inf
        if best > base.value - GAINED:
            break
        further = _followed([_begun(found[0], found[0].fitted, *there) for there in CLOSE], base, masks)
        found = sorted((*found, *further), key=lambda m: m.value)
        if found[0].value > best - BETTER:
            break
    return found


def _heard(base: Model, tasks: Iterable[Task], masks: Masks) -> Model | None:
    """The base under the noise of a gap that is likelier than the base before it has been fitted at all, if one is.

    A base without the gap may take a sensor of the shaft's torque for exact: every fit of a gap then begins wrong.
    """
    if len(base.noise.scale) < 2:
        return None
    trials = []
    for task in tasks:
        crude = _begun(base, task, 1.0, 1.0)
        noise = first_noise(crude.problem, crude.point, masks)
        trials.append((judge(crude.problem, crude.point, noise, masks), len(trials), noise))
    value, _, noise = min(trials)
    return replace(base, noise=noise) if value < base.value - GAINED else None


def confirmed(outcome: Outcome) -> Outcome:
    """The outcome with ends of fits from close by, if it has a gap before a light load.

    Where none agrees with it there are no intervals: each would be that of one valley among many. A better one
    takes its place, and must be agreed with by another.
    """
    drive = outcome.task.drive
    if outcome.fit is None or len(drive.bodies) != 2 or load_share(drive) > LIGHT or (
            f"{drive.shafts[0]}.half_gap" not in outcome.task.free):
        return outcome
    problem, end, masks = outcome.problem, outcome.fit, everything(outcome.problem)
    value = judge(problem, end.point, end.noise, masks)
    model = Model("base", outcome.task.at_point(end.point), problem, end.point, end.noise, value)
    ends = _followed([_begun(model, model.fitted, *there) for there in CLOSE if there != (1.0, 1.0)], model, masks,
                     RESTED)
    if ends and ends[0].value < value - CONFIRMED:
        model, *ends = ends
        end = settle(problem, fit_innovations(problem, model.point, model.noise, arrived=True))
        value = judge(problem, end.point, end.noise, masks)
        model = replace(model, point=end.point, noise=end.noise, value=value)
        outcome = replace(outcome, solution=end.solution, fit=end)
    starts = [{"way": "close by", "reached": dict(zip(outcome.task.free, map(float, m.point.values), strict=True)),
               "minus_log_likelihood_above_best": m.value - value,
               "apart": apart(problem, end.solution, replace(end.solution, point=m.point))} for m in (model, *ends)]
    return replace(outcome, starts=tuple(starts))


def _begun(model: Model, task: Task, scale: float, wider: float) -> Model:
    """Where a fit begins: load and shaft scaled as one, all inertia as the motor feels it what it was."""
    drive = task.drive
    first, last, shaft = drive.bodies[0], drive.bodies[-1], drive.shafts[0]
    values = {n: scale * drive.value(n) for n in (f"{last}.inertia", f"{shaft}.stiffness", f"{shaft}.damping")}
    moved = (scale - 1.0) * drive.value(f"{last}.inertia") / drive.turns()[-1] ** 2
    values |= {f"{first}.inertia": drive.value(f"{first}.inertia") - moved,
               f"{shaft}.half_gap": wider * drive.value(f"{shaft}.half_gap")}
    task = task.at({n: v for n, v in values.items() if n in task.free})
    problem = problem_of(task.drive, task.free, task.roles, model.problem.traces)
    point = Point(carried(model, task, problem).values, model.point.starts)
    return begun(model.code, task, problem, point, model.noise)


def _followed(some: Iterable[Model], base: Model, masks: Masks, most: int = ROUNDS) -> list[Model]:
    """A few steps under a noise on the load too, the likeliest ends then fitted without it; the likeliest first."""
    loose = replace(base.noise, others=base.fitted.drive.turns()[-1] * base.noise.ratio)

    def likeliest(fitted: Callable[[Model], Model], models: Iterable[Model]) -> list[Model]:
        found = []
        for model in models:
            with suppress(*BROKEN):
                found.append(fitted(model))
        return sorted((m for m in found if np.isfinite(m.value)), key=lambda m: m.value)

    ends = likeliest(lambda m: few_steps(replace(m, noise=loose), masks, STEPS), some)[:FOLLOWED]
    return likeliest(lambda m: fit(replace(m, noise=base.noise), masks, most=most), ends)
