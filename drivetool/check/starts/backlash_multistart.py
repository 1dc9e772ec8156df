"""Multi-start fit of backlash before a light load: the load bounces, and the likelihood has many local optima.

Each impact decides the next one. A fit from a few half gaps ends in the nearest local optimum, hundreds of units of
log likelihood above the best. Torque noise on the load too widens the optima, because the filter corrects the load.
The base without the gap misjudges load inertia and shaft stiffness by a common factor. From the best optimum the
search continues with its neighbours, as long as one is better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np

from drivetool.check.fit import (
    FIT_ERRORS,
    Masks,
    Model,
    all_samples,
    fit,
    gauss_newton_iterations,
    initial_noise,
    masked_loss,
    on_task,
)
from drivetool.check.starts.base import is_present, start_with, torque_size
from drivetool.identify.identifiability import load_inertia_ratio
from drivetool.identify.noise import fit_innovations, refit_with_tight_tolerance
from drivetool.identify.setup import Outcome, Task
from drivetool.identify.starts import MAX_AGREEING_LOSS, log_likelihood_distance
from drivetool.quantity import name_of

# Load over motor inertia, estimated without the gap, below which the load is light: then each impact decides
# the next (docs/explanation/limits.md).
MAX_LIGHT_LOAD_RATIO = 0.5
# Of load and shaft over the base: steps of 1.2, because the base without the gap errs by up to 40 % (a choice).
LOAD_AND_SHAFT_SCALES = (0.7, 0.85, 1.0, 1.2, 1.44)
# Half gaps over the twist by the torque; a choice: steps of about 1.5 over the range in which impacts matter.
HALF_GAP_TO_TWIST = (0.06, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7)
# Of load and shaft, and of the gap, over the best: finer than the steps of the first grid.
NEIGHBOUR_SCALES = tuple(product((0.9, 1.0, 1.1), (0.85, 1.0, 1.17)))
# Indices of the half gaps at which the noise is re-estimated with several sensors. A choice: a small and a
# medium gap.
NOISE_TRIAL_INDICES = (1, 4)
FIRST_STEPS = 10  # a choice: Gauss-Newton steps under load noise, enough to rank the starts
GAP_FIT_ITERATIONS = 4  # a choice: of the fits that follow, enough to rank their ends
CONVERGED_FIT_ITERATIONS = 24  # iterations to convergence: across local optima a dozen may not suffice
MAX_FOLLOWED_ENDS = 6  # a choice: ends under load noise that are fitted without it; each costs a fit
MIN_GAP_GAIN = 10.0  # log likelihood over the base. A choice: below, a gap is not worth a further search
MIN_OPTIMUM_GAIN = 1.0  # log likelihood. A choice: a smaller gain is convergence of the same optimum
MAX_OPTIMUM_SEARCHES = 6  # a choice: bounds the time of the search


def backlash_fits(base: Model, masks: Masks) -> list[Model]:
    """Fits of a gap from many starts, the likeliest first; none where a gap is present or a few starts suffice."""
    drive = base.fitted.drive
    if len(drive.bodies) != 2 or is_present(base, name_of(drive.shafts[0], "half_gap")):
        return []
    shaft = drive.shafts[0]
    twist = torque_size(base, shaft) / drive.value(name_of(shaft, "stiffness"))
    tasks = [start_with(base, {name_of(shaft, "half_gap"): share * twist}, ()).task for share in HALF_GAP_TO_TWIST]
    reestimated = _base_with_gap_noise(base, [tasks[i] for i in NOISE_TRIAL_INDICES], masks)
    if load_inertia_ratio(drive) > MAX_LIGHT_LOAD_RATIO and reestimated is None:
        return []
    base = reestimated or base
    found = _two_stage_fits(
        [_scaled_start(base, task, scale, 1.0) for task in tasks for scale in LOAD_AND_SHAFT_SCALES], base, masks)
    for _ in range(MAX_OPTIMUM_SEARCHES):
        best = found[0].value if found else np.inf
        if best > base.value - MIN_GAP_GAIN:
            break
        further = _two_stage_fits(
            [_scaled_start(found[0], found[0].fitted, *scales) for scales in NEIGHBOUR_SCALES], base, masks)
        found = sorted((*found, *further), key=lambda m: m.value)
        if found[0].value > best - MIN_OPTIMUM_GAIN:
            break
    return found


def _base_with_gap_noise(base: Model, tasks: Iterable[Task], masks: Masks) -> Model | None:
    """The base under the noise of an unfitted gap that is already likelier than the base, if there is one.

    A base without the gap may estimate the shaft torque sensor as exact: every fit of a gap then starts wrong.
    """
    if len(base.noise.scale) < 2:
        return None
    trials = []
    for task in tasks:
        trial = _scaled_start(base, task, 1.0, 1.0)
        noise = initial_noise(trial.problem, trial.point, masks)
        trials.append((masked_loss(trial.problem, trial.point, noise, masks), len(trials), noise))
    value, _, noise = min(trials)
    return replace(base, noise=noise) if value < base.value - MIN_GAP_GAIN else None


def with_neighbouring_fits(outcome: Outcome) -> Outcome:
    """The outcome with ends of fits from neighbouring starts, if it has a gap before a light load.

    Where none agrees with it there are no intervals: each would be that of one local optimum among many. A better
    end replaces it, and must be confirmed by another.
    """
    drive = outcome.task.drive
    if outcome.fit is None or len(drive.bodies) != 2 or load_inertia_ratio(drive) > MAX_LIGHT_LOAD_RATIO or (
            name_of(drive.shafts[0], "half_gap") not in outcome.task.free):
        return outcome
    problem, end, masks = outcome.problem, outcome.fit, all_samples(outcome.problem)
    value = masked_loss(problem, end.point, end.noise, masks)
    model = Model("base", outcome.task.at_point(end.point), problem, end.point, end.noise, value)
    ends = _two_stage_fits(
        [_scaled_start(model, model.fitted, *scales) for scales in NEIGHBOUR_SCALES if scales != (1.0, 1.0)],
        model, masks, CONVERGED_FIT_ITERATIONS)
    if ends and ends[0].value < value - MAX_AGREEING_LOSS:
        model, *ends = ends
        end = refit_with_tight_tolerance(problem,
                                         fit_innovations(problem, model.point, model.noise, near_optimum=True))
        value = masked_loss(problem, end.point, end.noise, masks)
        model = replace(model, point=end.point, noise=end.noise, value=value)
        outcome = replace(outcome, solution=end.solution, fit=end)
    starts = [{"way": "close by", "reached": dict(zip(outcome.task.free, map(float, m.point.values), strict=True)),
               "minus_log_likelihood_above_best": m.value - value,
               "apart": log_likelihood_distance(problem, end.solution, replace(end.solution, point=m.point))}
              for m in (model, *ends)]
    return replace(outcome, starts=tuple(starts))


def _scaled_start(model: Model, task: Task, scale: float, gap_scale: float) -> Model:
    """The start of a fit: load and shaft scaled by one factor, total inertia referred to the motor unchanged."""
    drive = task.drive
    first, last, shaft = drive.bodies[0], drive.bodies[-1], drive.shafts[0]
    values = {n: scale * drive.value(n)
              for n in (name_of(last, "inertia"), name_of(shaft, "stiffness"), name_of(shaft, "damping"))}
    moved = (scale - 1.0) * drive.value(name_of(last, "inertia")) / drive.gear_ratios()[-1] ** 2
    values |= {name_of(first, "inertia"): drive.value(name_of(first, "inertia")) - moved,
               name_of(shaft, "half_gap"): gap_scale * drive.value(name_of(shaft, "half_gap"))}
    return on_task(model, task.at({n: v for n, v in values.items() if n in task.free}))


def _two_stage_fits(starts: Iterable[Model], base: Model, masks: Masks,
                    max_iterations: int = GAP_FIT_ITERATIONS) -> list[Model]:
    """A few steps under torque noise on the load too, the best ends then fitted without it; the likeliest first."""
    with_load_noise = replace(base.noise, others=base.fitted.drive.gear_ratios()[-1] * base.noise.ratio)

    def likeliest(fitted: Callable[[Model], Model], models: Iterable[Model]) -> list[Model]:
        found = []
        for model in models:
            with suppress(*FIT_ERRORS):
                found.append(fitted(model))
        return sorted((m for m in found if np.isfinite(m.value)), key=lambda m: m.value)

    ends = likeliest(
        lambda m: gauss_newton_iterations(replace(m, noise=with_load_noise), masks, FIRST_STEPS),
        starts)[:MAX_FOLLOWED_ENDS]
    return likeliest(lambda m: fit(replace(m, noise=base.noise), masks, max_iterations=max_iterations), ends)
