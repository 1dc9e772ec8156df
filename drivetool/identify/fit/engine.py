"""Fitting a drive: what greybox and backlash share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from drivetool.drive.simulation import Filtered, Trace
from drivetool.errors import BadOption
from drivetool.identify.fit.friction_split import with_initial_shares
from drivetool.identify.noise import (
    Fit,
    Noise,
    filtered,
    fit_correlated_noise,
    fit_innovations,
    fit_ratio,
    minus_log_likelihood_at,
    refit_with_tight_tolerance,
    unit_noise_ratio,
    with_global_noise_search,
)
from drivetool.identify.problem import Point, Problem, Solution, solve, take_steps
from drivetool.identify.setup import Options, Outcome, Task, first_point, first_states, has_gap, with_known_states
from drivetool.identify.starts import (
    PARALLEL_STARTS,
    Descent,
    attempt_or_none,
    choose_gap_sides,
    continue_in_process_noise,
    free_values,
    frozen_observers,
    log_likelihood_distance,
    multi_start_search,
    resonance_starts,
    restart_from_partial_records,
    scaled_to_totals,
    without_failed,
)
from drivetool.progress import counted
from drivetool.quantity import quantity_of

DEFAULT_SEGMENT = 2.0  # s; longer free runs across a gap end in wrong optima
# Rounds after which only the best two of several starts continue. A choice: by then they have an order
SCREENING_ROUNDS = 3
# Log likelihood behind the best so far up to which a fit continues. A choice: later rounds gain less than this.
MAX_DEFICIT_TO_CONTINUE = 50.0
# Observer, and its torque noise factor, by which the fit of friction parts continues from the fit of their sums. A
# choice: the linear observer at the natural noise, since only the shares still have to move.
PARTS_OBSERVER = ("linear", 1.0)
MAX_CORRELATION_CHI2 = 50.7954897  # 99.99 % quantile of chi-square with 19 degrees of freedom, the lags 2 to 20
# Log likelihood that two more noise parameters must gain. A choice: far above chance (1 on average), since coloured
# noise also imitates a model error.
MIN_COLOUR_GAIN = 10.0


def fit_task(task: Task, options: Options, starts: Sequence[Mapping[str, float]],
             whole: Task | None = None) -> Outcome:
    """Fit by the criterion of the options, from every start; the best one counts.

    whole  the task with sums in place of some parts, in which an innovations fit across a gap searches its starts
    """
    if not task.free:
        raise BadOption("at least one free parameter", "all held", "Release one with --free NAME.")
    if options.criterion == "simulation":
        return by_simulation(task, segment_of(options), starts, options.seed, options.starts)
    return by_innovations(task, starts, options.seed, options.starts, whole=whole)


def segment_of(options: Options) -> float:
    """Length [s] of the segments of a simulation-error fit."""
    return DEFAULT_SEGMENT if options.segment is None else options.segment


def by_innovations(task: Task, starts: Sequence[Mapping[str, float]], seed: int = 1,
                   max_starts: int | None = None, search: Callable = multi_start_search,
                   whole: Task | None = None) -> Outcome:
    """Innovations fit; across a gap by multi-start, until two starts agree.

    max_starts  across a gap; None: as many as needed
    search      multi-start search across a gap
    whole       the task with sums in place of some parts, in which the starts are found and the fits start
    """
    problem = task.problem()
    if not is_multimodal(task):
        return _from_every_start(task, problem, starts)
    linear = task.linear_problem()

    def descend(start: Task, way: str, noise_factor: float, lowest: float) -> tuple[float, Fit, Task]:
        if start.free != task.free:
            start, way, noise_factor = (
                with_initial_shares(_continued_from_sums(start, way, noise_factor), task), *PARTS_OBSERVER)
        fit = by_noise_continuation(start, problem, linear if way == "linear" else None, noise_factor,
                                    SCREENING_ROUNDS)
        if not fit.converged and fit.value < lowest + MAX_DEFICIT_TO_CONTINUE:
            fit = fit_innovations(problem, fit.point, fit.noise, near_optimum=True)
        return fit.value, fit, task.at_point(fit.point)

    def gap(one: Fit, other: Fit) -> float:
        return log_likelihood_distance(problem, one.solution, other.solution)

    found = search(whole or task, starts, seed, descend, gap, max_starts)
    best = min((d.end for d in found), key=lambda f: f.value)
    if not best.converged:
        further = fit_innovations(problem, best.point, best.noise, near_optimum=True)
        best = min(best, further, key=lambda f: f.value)
    if len(found) > PARALLEL_STARTS:  # the first did not agree: the likelihood has many local optima
        found = [*found, *restart_from_partial_records(task, best, refit)]
        best = min([best, *(d.end for d in found)], key=lambda f: f.value)
    best = refit_with_tight_tolerance(problem, best)
    tried = [{**_start_record(task, {"way": f"{d.way} observer", **{f"start {k}": v for k, v in d.start.items()}},
                      d.end, best), "apart": gap(best, d.end)} for d in found]
    return Outcome.of_fit(task, problem, best, tried)


def _continued_from_sums(start: Task, way: str, noise_factor: float) -> Task:
    """The task at the end of a continuation in process noise."""
    problem = start.problem()
    point = Point(free_values(start), first_states(start.drive, start.roles, problem.traces, start.free))
    return start.at_point(continue_in_process_noise(
        problem, start.linear_problem() if way == "linear" else None, point, noise_factor)[0])


def by_noise_continuation(start: Task, problem: Problem, linear: Problem | None, noise_factor: float,
                          max_rounds: int) -> Fit:
    """An initial fit by continuation in process noise."""
    point = Point(free_values(start), first_states(start.drive, start.roles, problem.traces, start.free))
    point, ratio = continue_in_process_noise(problem, linear, point, noise_factor)
    noise = fit_ratio(problem, point, Noise(ratio, None, problem.scale), quick=True)
    return fit_innovations(problem, point, noise, near_optimum=True, max_rounds=max_rounds)


def refit(task: Task, noise: Noise, wanted: float = np.inf) -> Outcome:
    """Innovations fit from the values and the noise of an earlier fit: one start is enough.

    wanted  -log likelihood to be reached, see `fit_innovations`
    """
    if not is_multimodal(task):
        return by_innovations(task, [{}])
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    point = choose_gap_sides(problem, point, frozen_observers(problem, task.linear_problem(), point, noise))
    fit = refit_with_tight_tolerance(problem, fit_innovations(problem, point, replace(noise, memory=None,
                                                                                      slow=None), near_optimum=True,
                                                              wanted=wanted))
    return Outcome.of_fit(task, problem, fit, [_start_record(task, {"way": "again"}, fit, fit)])


def is_multimodal(task: Task) -> bool:
    """Whether inertias or stiffnesses are free across a gap: then the likelihood has many local optima."""
    return has_gap(task) and has_free_inertias_or_stiffnesses(task)


def has_free_inertias_or_stiffnesses(task: Task) -> bool:
    """Whether inertias or stiffnesses of more than one body are free."""
    return len(task.drive.bodies) > 1 and any(quantity_of(n) in ("inertia", "stiffness") for n in task.free)


def _start_record(task: Task, entry: dict, fit: Fit, best: Fit) -> dict:
    """A start with the optimum it reached."""
    return {**entry, "minus_log_likelihood_above_best": float(max(fit.value - best.value, 0.0)),
            "reached": {n: float(v) for n, v in zip(task.free, fit.point.values, strict=True)}}


def _from_every_start(task: Task, problem: Problem, starts: Sequence[Mapping[str, float]]) -> Outcome:
    """From every start; with a gap also through the gains of the linear drive."""
    several = len(starts) > 1
    most = SCREENING_ROUNDS if several else 12

    def direct(values: Mapping[str, float]) -> list[tuple[str, Fit | None]]:
        start = task.at(values)
        point = first_point(start.drive, problem, task.roles)
        return [(way, attempt_or_none(lambda way=way: fit_innovations(
            problem, point, linear=None if way == "direct" else start.linear_problem(), max_rounds=most)))
            # Two for a nonlinear drive, which has several local optima.
            for way in (("direct", "constant gain") if has_gap(start) else ("direct",))]

    found: list[tuple[dict, Fit | None]] = []

    def add(way: str, start_values: Mapping[str, float], make: Callable[[], Fit]) -> None:
        found.append(({"way": way, **start_values}, attempt_or_none(make)))

    with ThreadPoolExecutor(PARALLEL_STARTS) as pool:
        initial_fits = list(counted("starts", pool.map(direct, starts), len(starts)))
    for values, fits_of_start in zip(starts, initial_fits, strict=True):
        start, start_values = task.at(values), {k: float(v) for k, v in values.items()}
        found += [({"way": way, **start_values}, fit) for way, fit in fits_of_start]
        if has_free_inertias_or_stiffnesses(task) and fits_of_start[-1][1] is not None:
            rough = first_point(scaled_to_totals(start).drive, problem, task.roles)
            for place, noise in resonance_starts(problem, rough, fits_of_start[-1][1]):
                add("along the stiffness", start_values, lambda p=place, n=noise: fit_innovations(
                    problem, p, n, near_optimum=True, max_rounds=most))
            best = min((fit for _, fit in found if fit is not None), key=lambda f: f.value)
            if looks_coloured(filtered(problem, best.point, best.noise, keep=False)):
                # The errors are correlated: the drive lacks something, or this is a local optimum, which a slow
                # continuation avoids.
                add("cooled", start_values, lambda s=start: by_noise_continuation(s, problem, None, 10.0, most))
                add("simulated", start_values, lambda s=start: _through_simulation(s, problem, most))
    finished = [(entry, fit) for entry, fit in found if fit is not None]
    fits = without_failed([fit for _, fit in found])
    best = refit_with_tight_tolerance(problem, _best_of_two_continued(problem, fits) if several
                                      else min(fits, key=lambda f: f.value))
    return Outcome.of_fit(task, problem, best, [_start_record(task, entry, fit, best) for entry, fit in finished])


def _through_simulation(start: Task, problem: Problem, most: int) -> Fit:
    """A fit from the least simulation error: that criterion cannot explain a wrong drive by torque noise."""
    place = by_simulation(start, DEFAULT_SEGMENT, [{}])
    drive = start.at_point(place.solution.point).drive
    return fit_innovations(problem, first_point(drive, problem, start.roles), near_optimum=True, max_rounds=most)


def _best_of_two_continued(problem: Problem, fits: Sequence[Fit]) -> Fit:
    """The best fit after the best two continued to the end; the others are dropped."""
    ends = [fit if fit.converged else fit_innovations(problem, fit.point, fit.noise)
            for fit in sorted(fits, key=lambda f: f.value)[:2]]
    return min(ends, key=lambda f: f.value)


def fit_noise_only(task: Task) -> Outcome:
    """The outcome of a fit in which only the noise and the start states are free."""
    problem = task.problem(free=())
    fit = fit_innovations(problem, first_point(task.drive, problem, task.roles))
    return Outcome.of_fit(task, problem, fit)


def with_coloured_noise(outcome: Outcome) -> Outcome:
    """Refit with correlated torque noise, where the innovations are correlated.

    To be done last: a slow disturbance also imitates the residual of a wrong structure.
    """
    problem, fit = outcome.problem, outcome.fit
    if fit is None or not looks_coloured(fit.passes):
        return outcome
    noise = fit_correlated_noise(problem, fit.point, fit.noise,
                                 lambda n: minus_log_likelihood_at(problem, fit.point, n))
    trial = with_global_noise_search(problem, fit_innovations(problem, fit.point, noise))
    if trial.value > fit.value - MIN_COLOUR_GAIN:
        return outcome
    return replace(outcome, solution=trial.solution, fit=trial, converged=trial.converged)


def looks_coloured(passes: Sequence[Filtered]) -> bool:
    """Whether normalised innovations of any output correlate at lags 2 to 20 (1e-4 level)."""
    return any(_correlation_chi2([f.innovations[:, m] / np.sqrt(f.variance[:, m])
                                  for f in passes]) > MAX_CORRELATION_CHI2
               for m in range(passes[0].innovations.shape[1]))


def _correlation_chi2(series: Sequence[np.ndarray]) -> float:
    """Sum of the squared correlations over standard deviation; NaN where nothing was measured."""
    count, products = 0, np.zeros(21)
    for z in series:
        known = np.isfinite(z)
        if not known.any():
            continue
        z = np.where(known, z - z[known].mean(), 0.0)
        count += int(known.sum())
        products += [z[: max(len(z) - k, 0)] @ z[k:] for k in range(21)]
    return float(count * np.sum((products[2:] / products[0]) ** 2)) if products[0] > 0.0 else 0.0


def by_simulation(task: Task, segment: float, starts: Sequence[Mapping[str, float]], seed: int = 1,
                  max_starts: int | None = None, near_optimum: bool = False, lag: int = 0,
                  constant_torques: bool = False) -> Outcome:
    """Simulation-error fit on segments with free start states; across a gap until two starts agree.

    segment  length [s]; 0: one free run per record
    max_starts  across a gap; None: as many as needed
    near     the task's values are those of an earlier fit: one start is enough
    lag      samples over which the errors are differenced, see Problem
    own      whether each segment has a constant torque of its own
    """
    problem = replace(task.problem(segment), lag=lag)
    if constant_torques:
        problem = problem.with_constant_torque()
    linear = task.linear_problem(segment)
    hard = is_multimodal(task) and not near_optimum

    def descend(start: Task, way: str, noise_factor: float, _lowest: float) -> tuple[float, Solution, Task]:
        point = Point(free_values(start), segment_states(start, problem.traces, noise_factor))
        point, _ = continue_in_process_noise(problem, linear if way == "linear" else None, point, noise_factor)
        return ended(solve(problem, point, relative=1e-7, max_iterations=30))

    def directly(start: Task) -> tuple[float, Solution, Task]:
        states = segment_states(start, problem.traces)
        point = Point(free_values(start), tuple(np.append(s, 0.0) for s in states) if constant_torques else states)
        first = solve(problem, point, relative=1e-5, hold=problem.later, keeps_worse=has_gap(task))
        return ended(solve(problem, first.point, relative=1e-7 if near_optimum else 1e-10,
                           max_iterations=30 if near_optimum else 100,
                           keeps_worse=has_gap(task)))

    def ended(solution: Solution) -> tuple[float, Solution, Task]:
        return 0.5 * problem.count * np.log(max(solution.cost, 1e-300)), solution, task.at_point(solution.point)

    if hard:
        found = multi_start_search(task, starts, seed, descend, lambda one,
                                   other: log_likelihood_distance(problem, one, other), max_starts)
    else:
        found = [Descent(values, "direct", *directly(task.at(values))[:2]) for values in starts]
    best = min((d.end for d in found), key=lambda s: s.cost)
    if hard:
        best = solve(problem, best.point, relative=1e-10, max_iterations=100)
    tried = tuple({"way": d.way, **{f"start {k}": float(v) for k, v in d.start.items()},
                   "cost_over_best": float(d.end.cost / best.cost) if best.cost > 0.0 else 1.0,
                   "apart": log_likelihood_distance(problem, best, d.end),
                   "reached": dict(zip(task.free, d.end.point.values.tolist(), strict=True))} for d in found)
    return Outcome(task, problem, best, None, tried, best.converged)


def segment_states(task: Task, traces: Sequence[Trace],
                   noise_factor: float | None = None) -> tuple[np.ndarray, ...]:
    """Start states of segments from a Kalman pass over the whole record.

    noise_factor  torque noise on every body, over that which moves the output by its sensor noise; None: on the
                  motor alone, estimated from the record
    """
    whole = task.problem()
    point = first_point(task.drive, whole, task.roles)
    if len(whole.traces) == len(traces):
        return point.starts
    if noise_factor is None:
        noise = fit_ratio(whole, point, Noise(1.0, None, whole.scale))
    else:
        ratio = noise_factor * unit_noise_ratio(whole, point)
        noise = Noise(ratio, None, whole.scale, ratio)
    found = []
    for trace, passed in zip(whole.traces, filtered(whole, point, noise), strict=True):
        done = 0
        while done < trace.size:
            piece = traces[len(found)]
            found.append(with_known_states(whole.states, piece, passed.states[done].copy()))
            done += piece.size
    return tuple(found)


def free_run(task: Task, traces: Sequence[Trace] | None = None, noise: Noise | None = None,
             further: Sequence[np.ndarray] = ()) -> tuple[Problem, Point, list[np.ndarray]]:
    """Free runs of the unchanged drive, only the start states fitted: (problem, point, outputs).

    noise    by which a first guess of the start states is smoothed, white; None: estimated
    further  per trace a further start state to try; empty: none
    """
    problem = task.problem(free=())
    if traces is not None:
        problem = replace(problem, traces=tuple(traces))
    point = first_point(task.drive, problem, task.roles)
    if noise is None or noise.memory is not None:
        noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale), quick=True)
    starts = smoothed_starts(problem, point, noise)
    # Trace by trace: one that is hard to start must not damp the steps of the others.
    found = []
    for i, trace in enumerate(problem.traces):
        alone = replace(problem, traces=(trace,))
        tries = [take_steps(alone, Point(point.values, (s[i],)), None, 5)
                 for s in (point.starts, starts, further) if s]
        approached, _ = min(tries, key=lambda pair: pair[1])
        found.append(solve(alone, approached, max_iterations=40).point.starts[0])
    point = Point(point.values, tuple(found))
    plants = problem.plants(point.values, False)
    return problem, point, [plant.outputs(t, s) for plant, t, s in zip(
        plants, problem.traces, point.starts, strict=True)]


def smoothed_starts(problem: Problem, point: Point, noise: Noise) -> tuple[np.ndarray, ...]:
    """Start states by the innovations fit of the start states alone; the point's where its filter diverges."""
    with np.errstate(over="ignore", invalid="ignore"):
        gains = [f.gains for f in filtered(problem, point, noise)]
    if not all(np.isfinite(g.gain).all() and np.isfinite(g.weight).all() for g in gains):
        return point.starts
    try:
        return solve(problem, point, gains, max_iterations=10).point.starts
    except np.linalg.LinAlgError:
        return point.starts
