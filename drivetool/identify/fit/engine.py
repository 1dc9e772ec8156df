"""Fitting a drive: what greybox and backlash share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from drivetool.drive.simulation import Filtered, Trace
from drivetool.errors import BadOption
from drivetool.identify.fit.parts import shared_out
from drivetool.identify.noise import (
    Fit,
    Noise,
    filtered,
    fit_innovations,
    fit_ratio,
    minus_log_likelihood,
    natural_ratio,
    remembering,
    settle,
    sought_everywhere,
)
from drivetool.identify.problem import Point, Problem, Solution, approach, solve
from drivetool.identify.setup import Options, Outcome, Task, first_point, first_states, has_gap, with_known
from drivetool.identify.starts import (
    AT_ONCE,
    Descent,
    apart,
    attempted,
    balanced,
    by_portions,
    cooled,
    observers,
    resonances,
    searched,
    sides,
    that_held,
    values_of,
)
from drivetool.progress import counted

__all__ = ["Outcome", "Task", "again", "by_innovations", "by_simulation", "coloured", "fit_task", "free_run",
           "frozen", "looks_coloured", "segment_of", "segment_states"]

SEGMENT = 2.0  # s; longer free runs across a gap end in wrong optima
SCREEN = 3  # rounds after which only the best two of several starts go on
HOPEFUL = 50.0  # log likelihood behind the best so far up to which a descent goes on
PARTS_BY = ("linear", 1.0)  # observer, and how hot, by which parts go on from where their sums led
RARE = 50.7954897  # what a chi-square of 19 degrees exceeds once in ten thousand times
COLOUR_GAIN = 10.0  # log likelihood that two more noise parameters must bring


def fit_task(task: Task, options: Options, starts: Sequence[Mapping[str, float]],
             whole: Task | None = None) -> Outcome:
    """Fit by the criterion of the options, from every start; the best one counts.

    whole  the task with sums in place of some parts, in which an innovations fit across a gap finds its way in
    """
    if not task.free:
        raise BadOption("at least one free parameter", "all held", "Release one with --free NAME.")
    if options.criterion == "simulation":
        return by_simulation(task, segment_of(options), starts, options.seed, options.starts)
    return by_innovations(task, starts, options.seed, options.starts, whole=whole)


def segment_of(options: Options) -> float:
    """Length [s] of the segments of a simulation-error fit."""
    return SEGMENT if options.segment is None else options.segment


def by_innovations(task: Task, starts: Sequence[Mapping[str, float]], seed: int = 1,
                   most: int | None = None, search: Callable = searched, whole: Task | None = None) -> Outcome:
    """Innovations fit; across a gap from several starts, until two agree.

    most    starts across a gap; None: as many as it takes
    search  how the starts across a gap are found and descended from
    whole   the task with sums in place of some parts, in which the starts are found and the descents begin
    """
    problem = task.problem()
    if not is_hard(task):
        return _simply(task, problem, starts)
    linear = task.linear_problem()

    def descend(start: Task, way: str, hot: float, lowest: float) -> tuple[float, Fit, Task]:
        if start.free != task.free:
            start, way, hot = shared_out(_cooled_whole(start, way, hot), task), *PARTS_BY
        fit = by_cooling(start, problem, linear if way == "linear" else None, hot, SCREEN)
        if not fit.converged and fit.value < lowest + HOPEFUL:
            fit = fit_innovations(problem, fit.point, fit.noise, arrived=True)
        return fit.value, fit, task.at_point(fit.point)

    def gap(one: Fit, other: Fit) -> float:
        return apart(problem, one.solution, other.solution)

    found = search(whole or task, starts, seed, descend, gap, most)
    best = min((d.end for d in found), key=lambda f: f.value)
    if not best.converged:
        further = fit_innovations(problem, best.point, best.noise, arrived=True)
        best = min(best, further, key=lambda f: f.value)
    if len(found) > AT_ONCE:  # the first did not agree: the likelihood is rough
        found = [*found, *by_portions(task, best, again)]
        best = min([best, *(d.end for d in found)], key=lambda f: f.value)
    best = settle(problem, best)
    tried = [{**_told(task, {"way": f"{d.way} observer", **{f"start {k}": v for k, v in d.start.items()}},
                      d.end, best), "apart": gap(best, d.end)} for d in found]
    return Outcome(task, problem, best.solution, best, tuple(tried), best.converged)


def _cooled_whole(start: Task, way: str, hot: float) -> Task:
    """Where a task comes to through observers that listen less and less to the torque."""
    problem = start.problem()
    point = Point(values_of(start), first_states(start.drive, start.roles, problem.traces, start.free))
    return start.at_point(cooled(problem, start.linear_problem() if way == "linear" else None, point, hot)[0])


def by_cooling(start: Task, problem: Problem, linear: Problem | None, hot: float, most: int) -> Fit:
    """A first fit, through observers that listen less and less to the torque."""
    point = Point(values_of(start), first_states(start.drive, start.roles, problem.traces, start.free))
    point, ratio = cooled(problem, linear, point, hot)
    noise = fit_ratio(problem, point, Noise(ratio, None, problem.scale), quick=True)
    return fit_innovations(problem, point, noise, arrived=True, most=most)


def again(task: Task, noise: Noise, wanted: float = np.inf) -> Outcome:
    """Innovations fit from the values and the noise of an earlier fit: one start will do.

    wanted  -log likelihood to be reached, see `fit_innovations`
    """
    if not is_hard(task):
        return by_innovations(task, [{}])
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    point = sides(problem, point, observers(problem, task.linear_problem(), point, noise))
    fit = settle(problem, fit_innovations(problem, point, replace(noise, memory=None, slow=None), arrived=True,
                                          wanted=wanted))
    return Outcome(task, problem, fit.solution, fit, (_told(task, {"way": "again"}, fit, fit),), fit.converged)


def is_hard(task: Task) -> bool:
    """Whether shape parameters are free across a gap: then the likelihood has many peaks."""
    return has_gap(task) and has_shape(task)


def has_shape(task: Task) -> bool:
    """Whether inertias or stiffnesses of more than one body are free."""
    return len(task.drive.bodies) > 1 and any(n.endswith((".inertia", ".stiffness")) for n in task.free)


def _told(task: Task, entry: dict, fit: Fit, best: Fit) -> dict:
    """A start with where it led."""
    return {**entry, "minus_log_likelihood_above_best": float(max(fit.value - best.value, 0.0)),
            "reached": {n: float(v) for n, v in zip(task.free, fit.point.values, strict=True)}}


def _simply(task: Task, problem: Problem, starts: Sequence[Mapping[str, float]]) -> Outcome:
    """From every start; with a gap also through the gains of the linear drive."""
    several = len(starts) > 1
    most = SCREEN if several else 12

    def direct(values: Mapping[str, float]) -> list[tuple[str, Fit | None]]:
        start = task.at(values)
        point = first_point(start.drive, problem, task.roles)
        return [(way, attempted(lambda way=way: fit_innovations(
            problem, point, linear=None if way == "direct" else start.linear_problem(), most=most)))
            for way in _ways(start)]

    found: list[tuple[dict, Fit | None]] = []

    def add(way: str, told: Mapping[str, float], make: Callable[[], Fit]) -> None:
        found.append(({"way": way, **told}, attempted(make)))

    with ThreadPoolExecutor(AT_ONCE) as pool:
        begun = list(counted("starts", pool.map(direct, starts), len(starts)))
    for values, led in zip(starts, begun, strict=True):
        start, told = task.at(values), {k: float(v) for k, v in values.items()}
        found += [({"way": way, **told}, fit) for way, fit in led]
        if has_shape(task) and led[-1][1] is not None:
            rough = first_point(balanced(start).drive, problem, task.roles)
            for place, noise in resonances(problem, rough, led[-1][1]):
                add("along the stiffness", told, lambda p=place, n=noise: fit_innovations(
                    problem, p, n, arrived=True, most=most))
            best = min((fit for _, fit in found if fit is not None), key=lambda f: f.value)
            if looks_coloured(filtered(problem, best.point, best.noise, keep=False)):
                # What is left repeats: the drive lacks something, or the fit went astray, as slow cooling does not.
                add("cooled", told, lambda s=start: by_cooling(s, problem, None, 10.0, most))
                add("simulated", told, lambda s=start: _through_simulation(s, problem, most))
    held = [(entry, fit) for entry, fit in found if fit is not None]
    fits = that_held([fit for _, fit in found])
    best = settle(problem, _polished(problem, fits) if several else min(fits, key=lambda f: f.value))
    tried = tuple(_told(task, entry, fit, best) for entry, fit in held)
    return Outcome(task, problem, best.solution, best, tried, best.converged)


def _through_simulation(start: Task, problem: Problem, most: int) -> Fit:
    """A fit from where the simulation error is least: no noise of the torque can make a wrong drive pass there."""
    place = by_simulation(start, SEGMENT, [{}])
    drive = start.at_point(place.solution.point).drive
    return fit_innovations(problem, first_point(drive, problem, start.roles), arrived=True, most=most)


def _polished(problem: Problem, fits: Sequence[Fit]) -> Fit:
    """The best fit after the best two went on to the end; the others are not worth it."""
    ends = []
    for fit in sorted(fits, key=lambda f: f.value)[:2]:
        ends.append(fit if fit.converged else fit_innovations(problem, fit.point, fit.noise))
    return min(ends, key=lambda f: f.value)


def _ways(task: Task) -> tuple[str, ...]:
    """A nonlinear drive has several optima: two ways in."""
    return ("direct", "constant gain") if has_gap(task) else ("direct",)


def frozen(task: Task) -> Outcome:
    """The outcome of a fit in which only the noise and the start states are free."""
    problem = task.problem(free=())
    fit = fit_innovations(problem, Point(np.empty(0), first_states(task.drive, task.roles, problem.traces)))
    return Outcome(task, problem, fit.solution, fit, (), fit.converged)


def coloured(outcome: Outcome) -> Outcome:
    """Refit with a torque disturbance that remembers, where the innovations ask for it.

    To be done last: a slow disturbance also imitates what a wrong structure leaves over.
    """
    problem, fit = outcome.problem, outcome.fit
    if fit is None or not looks_coloured(fit.passes):
        return outcome
    noise = remembering(problem, fit.point, fit.noise,
                        lambda n: minus_log_likelihood(filtered(problem, fit.point, n, keep=False)))
    trial = sought_everywhere(problem, fit_innovations(problem, fit.point, noise))
    if trial.value > fit.value - COLOUR_GAIN:
        return outcome
    return replace(outcome, solution=trial.solution, fit=trial, converged=trial.converged)


def looks_coloured(passes: Sequence[Filtered]) -> bool:
    """Whether normalised innovations of any output correlate at lags 2 to 20 (1e-4 level)."""
    return any(_correlation([f.innovations[:, m] / np.sqrt(f.variance[:, m]) for f in passes]) > RARE
               for m in range(passes[0].innovations.shape[1]))


def _correlation(series: Sequence[np.ndarray]) -> float:
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
                  most: int | None = None, near: bool = False, lag: int = 0, own: bool = False) -> Outcome:
    """Simulation-error fit on segments with free start states; across a gap until two starts agree.

    segment  length [s]; 0: one free run per record
    most     starts across a gap; None: as many as it takes
    near     the task's values are those of an earlier fit: one start will do
    lag      samples over which the errors are differenced, see Problem
    own      whether each segment has a torque of its own that stays as it is
    """
    problem = replace(task.problem(segment), lag=lag)
    if own:
        problem = problem.with_constant_torque()
    linear = task.linear_problem(segment)
    hard = is_hard(task) and not near

    def descend(start: Task, way: str, hot: float, _lowest: float) -> tuple[float, Solution, Task]:
        point = Point(values_of(start), segment_states(start, problem.traces, hot))
        point, _ = cooled(problem, linear if way == "linear" else None, point, hot)
        return ended(solve(problem, point, relative=1e-7, most=30))

    def directly(start: Task) -> tuple[float, Solution, Task]:
        states = segment_states(start, problem.traces)
        point = Point(values_of(start), tuple(np.append(s, 0.0) for s in states) if own else states)
        first = solve(problem, point, relative=1e-5, hold=problem.later, apart=has_gap(task))
        return ended(solve(problem, first.point, relative=1e-7 if near else 1e-10, most=30 if near else 100,
                           apart=has_gap(task)))

    def ended(solution: Solution) -> tuple[float, Solution, Task]:
        return 0.5 * problem.count * np.log(max(solution.cost, 1e-300)), solution, task.at_point(solution.point)

    if hard:
        found = searched(task, starts, seed, descend, lambda one, other: apart(problem, one, other), most)
    else:
        found = [Descent(values, "direct", *directly(task.at(values))[:2]) for values in starts]
    best = min((d.end for d in found), key=lambda s: s.cost)
    if hard:
        best = solve(problem, best.point, relative=1e-10, most=100)
    tried = tuple({"way": d.way, **{f"start {k}": float(v) for k, v in d.start.items()},
                   "cost_over_best": float(d.end.cost / best.cost) if best.cost > 0.0 else 1.0,
                   "apart": apart(problem, best, d.end),
                   "reached": dict(zip(task.free, d.end.point.values.tolist(), strict=True))} for d in found)
    return Outcome(task, problem, best, None, tried, best.converged)


def segment_states(task: Task, traces: Sequence[Trace], hot: float | None = None) -> tuple[np.ndarray, ...]:
    """Start states of segments from a Kalman pass over the whole record.

    hot  torque noise on every body, over that which moves the output by its sensor noise; None:
         of the motor alone, as the record has it
    """
    whole = task.problem()
    point = first_point(task.drive, whole, task.roles)
    if len(whole.traces) == len(traces):
        return point.starts
    if hot is None:
        noise = fit_ratio(whole, point, Noise(1.0, None, whole.scale))
    else:
        ratio = hot * natural_ratio(whole, point)
        noise = Noise(ratio, None, whole.scale, ratio)
    found = []
    for trace, passed in zip(whole.traces, filtered(whole, point, noise), strict=True):
        done = 0
        while done < trace.size:
            piece = traces[len(found)]
            found.append(with_known(whole.states, piece, passed.states[done].copy()))
            done += piece.size
    return tuple(found)


def free_run(task: Task, traces: Sequence[Trace] | None = None, noise: Noise | None = None,
             further: Sequence[np.ndarray] = ()) -> tuple[Problem, Point, list[np.ndarray]]:
    """Free runs of the drive as it is, only the start states fitted: (problem, point, outputs).

    noise    by which a first guess of the start states is smoothed, white; None: estimated
    further  per trace a start state that is tried, too; none: there is none
    """
    problem = task.problem(free=())
    if traces is not None:
        problem = replace(problem, traces=tuple(traces))
    point = Point(np.empty(0), first_states(task.drive, task.roles, problem.traces))
    if noise is None or noise.memory is not None:
        noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale), quick=True)
    starts = smoothed_starts(problem, point, noise)
    # Trace by trace: one that is hard to start must not damp the steps of the others.
    found = []
    for i, trace in enumerate(problem.traces):
        alone = replace(problem, traces=(trace,))
        tries = [approach(alone, Point(point.values, (s[i],)), None, 5)
                 for s in (point.starts, starts, further) if s]
        begun, _ = min(tries, key=lambda pair: pair[1])
        found.append(solve(alone, begun, most=40).point.starts[0])
    point = Point(point.values, tuple(found))
    plants = problem.plants(point.values, False)
    return problem, point, [plant.outputs(t, s) for plant, t, s in zip(
        plants, problem.traces, point.starts, strict=True)]


def smoothed_starts(problem: Problem, point: Point, noise: Noise) -> tuple[np.ndarray, ...]:
    """Start states by the innovations fit of the start states alone; the point's where its filter runs away."""
    with np.errstate(over="ignore", invalid="ignore"):
        gains = [f.gains for f in filtered(problem, point, noise)]
    if not all(np.isfinite(g.gain).all() and np.isfinite(g.weight).all() for g in gains):
        return point.starts
    try:
        return solve(problem, point, gains, most=10).point.starts
    except np.linalg.LinAlgError:
        return point.starts
