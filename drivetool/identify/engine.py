"""Fitting a drive: what greybox and backlash share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive.chain import Drive
from drivetool.drive.simulate import Filtered, Trace
from drivetool.errors import BadOption
from drivetool.identify.innovations import Fit, fit_innovations, settle
from drivetool.identify.least_squares import Solution, solve
from drivetool.identify.noise import Noise, filtered, fit_ratio, minus_log_likelihood
from drivetool.identify.options import Options
from drivetool.identify.problem import Point, Problem
from drivetool.identify.setup import Roles, first_point, first_states, problem_of, replaced, traces_of
from drivetool.logs.experiment import Experiment

SEGMENT = 2.0  # s; longer free runs across a gap end in wrong optima
SCREEN = 3  # rounds after which only the best two of several starts go on
COLOUR_GAIN = 10.0  # log likelihood that two more noise parameters must bring


@dataclass(frozen=True)
class Task:
    """A drive to be fitted to recordings."""

    drive: Drive
    free: tuple[str, ...]
    roles: Roles
    experiments: tuple[Experiment, ...]

    def problem(self, segment: float = 0.0, free: Sequence[str] | None = None) -> Problem:
        """The least-squares problem, with traces cut to `segment` seconds if above zero."""
        free = self.free if free is None else tuple(free)
        return problem_of(self.drive, free, self.roles, traces_of(self.experiments, self.roles, segment))

    def at(self, values: Mapping[str, float]) -> Task:
        """The task with other values of the drive."""
        return replace(self, drive=replaced(self.drive, list(values), np.array(list(values.values()))))

    def at_point(self, point: Point) -> Task:
        """The task at fitted values."""
        return self.at(dict(zip(self.free, point.values, strict=True)))


@dataclass(frozen=True)
class Outcome:
    """A fit by one criterion: problem and point, residual noise, and how the starts agreed.

    fit     by innovations, None for a simulation-error fit
    starts  one mapping per start: values, -log likelihood or cost, whether it reached the best
    """

    task: Task
    problem: Problem
    solution: Solution
    fit: Fit | None
    starts: tuple[dict, ...]
    converged: bool

    @property
    def drive(self) -> Drive:
        """The drive with the fitted values."""
        return self.task.at_point(self.solution.point).drive


def fit_task(task: Task, options: Options, starts: Sequence[Mapping[str, float]]) -> Outcome:
    """Fit by the criterion of the options, from every start; the best one counts."""
    if not task.free:
        raise BadOption("at least one free parameter", "all held", "Release one with --free NAME.")
    if options.criterion == "simulation":
        return by_simulation(task, SEGMENT if options.segment is None else options.segment, starts)
    return by_innovations(task, starts)


def by_innovations(task: Task, starts: Sequence[Mapping[str, float]]) -> Outcome:
    """Innovations fit; with a gap or friction also through the gains of the linear drive."""
    problem = task.problem()
    fits: list[Fit] = []
    tried = []
    several = len(starts) > 1
    for values in starts:
        start = task.at(values)
        point = first_point(start.drive, problem, task.roles)
        for way in _ways(start):
            linear = None if way == "direct" else problem_of(
                _linear(start.drive), (), task.roles, problem.traces)
            fits.append(fit_innovations(problem, point, linear=_same_values(linear, problem),
                                        most=SCREEN if several else 12))
            tried.append({"way": way, **{k: float(v) for k, v in values.items()}})
    best = settle(problem, _polished(problem, fits) if several else min(fits, key=lambda f: f.value))
    for entry, fit in zip(tried, fits, strict=True):
        entry["minus_log_likelihood_above_best"] = float(max(fit.value - best.value, 0.0))
        entry["reached"] = {n: float(v) for n, v in zip(task.free, fit.point.values, strict=True)}
    return Outcome(task, problem, best.solution, best, tuple(tried), best.converged)


def _polished(problem: Problem, fits: Sequence[Fit]) -> Fit:
    """The best fit after the best two went on to the end; the others are not worth it."""
    ends = []
    for fit in sorted(fits, key=lambda f: f.value)[:2]:
        ends.append(fit if fit.converged else fit_innovations(problem, fit.point, fit.noise))
    return min(ends, key=lambda f: f.value)


def _ways(task: Task) -> tuple[str, ...]:
    """A nonlinear drive has several optima: two ways in."""
    acts = [n for n in task.drive.quantities if n.endswith((".half_gap", ".coulomb"))
            and (n in task.free or (task.drive.value(n) or 0.0) > 0.0)]
    return ("direct", "constant gain") if any(n.endswith("half_gap") for n in acts) else ("direct",)


def _linear(drive: Drive) -> Drive:
    flat = {n: 0.0 for n in drive.quantities if n.endswith((".half_gap", ".coulomb"))}
    return replace(drive, values={**drive.values, **flat})


def _same_values(linear: Problem | None, problem: Problem) -> Problem | None:
    """The linear problem accepts the nonlinear one's point: it ignores its values."""
    if linear is None:
        return None
    build = linear.build
    return replace(linear, build=lambda values, trace, gradient, memory: build(
        np.empty(0), trace, gradient, memory))


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
    h = problem.traces[0].step
    trials = []
    for time in (20.0 * h, 500.0 * h):
        noise = Noise(fit.noise.ratio, float(np.exp(-h / time)), fit.noise.scale)
        trials.append(fit_ratio(problem, fit.point, noise))
    noise = min(trials, key=lambda n: minus_log_likelihood(filtered(problem, fit.point, n, keep=False)))
    trial = fit_innovations(problem, fit.point, noise)
    if trial.value > fit.value - COLOUR_GAIN:
        return outcome
    return replace(outcome, solution=trial.solution, fit=trial, converged=trial.converged)


def looks_coloured(passes: Sequence[Filtered]) -> bool:
    """Whether normalised innovations correlate at lags 2 to 20 (1e-4 level)."""
    from scipy.stats import chi2

    total = 0.0
    count = 0
    products = np.zeros(21)
    for f in passes:
        z = f.innovations[:, 0] / np.sqrt(f.variance[:, 0])
        z = np.where(np.isfinite(z), z - np.nanmean(z), 0.0)
        count += len(z)
        products += [z[: len(z) - k] @ z[k:] for k in range(21)]
    if products[0] <= 0.0:
        return False
    total = count * np.sum((products[2:] / products[0]) ** 2)
    return bool(total > chi2.isf(1e-4, 19))


def by_simulation(task: Task, segment: float, starts: Sequence[Mapping[str, float]]) -> Outcome:
    """Simulation-error fit on segments with free start states.

    segment  length [s]; 0: one free run per record
    """
    problem = task.problem(segment)
    solutions, tried = [], []
    for values in starts:
        start = task.at(values)
        states = segment_states(start, problem.traces)
        point = replace(first_point(start.drive, problem, task.roles), starts=states)
        first = solve(problem, point, relative=1e-5, hold=problem.later)
        solutions.append(solve(problem, first.point, relative=1e-10, most=100))
        tried.append({k: float(v) for k, v in values.items()})
    best = min(solutions, key=lambda s: s.cost)
    for entry, solution in zip(tried, solutions, strict=True):
        entry["cost_over_best"] = float(solution.cost / best.cost) if best.cost > 0.0 else 1.0
    return Outcome(task, problem, best, None, tuple(tried), best.converged)


def segment_states(task: Task, traces: Sequence[Trace]) -> tuple[np.ndarray, ...]:
    """Start states of segments from a Kalman pass over each segment's own record."""
    whole = task.problem(free=())
    if len(whole.traces) == len(traces):
        return first_states(task.drive, task.roles, traces)
    point = Point(np.empty(0), first_states(task.drive, task.roles, whole.traces))
    noise = fit_ratio(whole, point, Noise(1.0, None, whole.scale))
    found = []
    for trace, passed in zip(whole.traces, filtered(whole, point, noise), strict=True):
        done = 0
        while done < trace.size:
            piece = traces[len(found)]
            found.append(passed.states[done].copy())
            done += piece.size
    return tuple(found)


def free_run(task: Task, traces: Sequence[Trace] | None = None,
             ) -> tuple[Problem, Point, list[np.ndarray]]:
    """Free runs of the drive as it is, only the start states fitted: (problem, point, outputs)."""
    problem = task.problem(free=())
    if traces is not None:
        problem = replace(problem, traces=tuple(traces))
    point = Point(np.empty(0), first_states(task.drive, task.roles, problem.traces))
    noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale))
    starts = smoothed_starts(problem, point, noise)
    # Trace by trace: one that is hard to start must not damp the steps of the others.
    found = []
    for i, trace in enumerate(problem.traces):
        alone = replace(problem, traces=(trace,))
        tries = [solve(alone, Point(point.values, (s[i],)), most=40) for s in (point.starts, starts)]
        found.append(min(tries, key=lambda s: s.cost).point.starts[0])
    point = Point(point.values, tuple(found))
    plants = problem.plants(point.values, False)
    return problem, point, [plant.outputs(t, s) for plant, t, s in zip(
        plants, problem.traces, point.starts, strict=True)]


def smoothed_starts(problem: Problem, point: Point, noise: Noise) -> tuple[np.ndarray, ...]:
    """Start states by the innovations fit of the start states alone."""
    gains = [f.gains for f in filtered(problem, point, noise)]
    return solve(problem, point, gains, most=10).point.starts
