"""A model run over a record: free runs with fitted start states, and a Kalman pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.check.validation.fit_confidence_region import likeliest_drive_in_region, likeliest_noise_in_interval
from drivetool.drive import Assembly, Drive, Layout
from drivetool.drive.simulation import Filtered, Trace
from drivetool.errors import BadOption
from drivetool.finding import Finding
from drivetool.identify.estimate import Covariance
from drivetool.identify.fit import attainable_fits, segment_states, smoothed_starts
from drivetool.identify.noise import Noise, filtered, fit_ratio, minus_log_likelihood, with_disturbance_state
from drivetool.identify.problem import Point, Problem, solve
from drivetool.identify.setup import (
    KnownStart,
    Roles,
    Task,
    contradicted_start_findings,
    first_states,
    has_gap,
    known_states,
    measured_states,
    problem_of,
    roles_of,
    run_length,
    traces_of,
)
from drivetool.logs import Experiment
from drivetool.quantity import owner_of, quantity_of

# Gauss-Newton steps of the parameters, each with the noise re-estimated. A choice: the second one refines.
MAX_REGION_STEPS = 2
FREE_RUN_DRAWS = 20  # runs with other torque noise. A choice: their lowest fit is about the 5 % quantile
MIN_ATTAINABLE_FIT = 95.0  # [%] a true model with less does not follow its own motion
FREE_RUN_LENGTH = 1.0  # s across a gap, if a true model follows that far, and not a whole stretch
MIN_SEGMENT_SAMPLES = 20  # samples of a segment: far more than the start states that are fitted to them


@dataclass(frozen=True)
class Replay:
    """A model run over a record; arrays of all stretches in a row.

    drive        of the model; segment: length [s] of the free runs, 0: whole stretches
    roles        of inputs and outputs; the start states were fitted to the first output
    index        (n,) samples of the record; ends: where each stretch ends in it
    inputs       (n, nu); measured, simulated, predicted: (n, ny), NaN where unmeasured
    from_measured  (n, ny) simulated from the start state measured by the first samples
    innovations  (n, ny) normalised errors of the one-step predictions
    noise        of the model, else of the passes, and sigma, the std of the first sensor
    known        whether the noise came with the model
    pieces       traces of the free runs with the start states, and the problem they belong to
    """

    drive: Drive
    segment: float
    roles: Roles
    index: np.ndarray
    ends: tuple[int, ...]
    inputs: np.ndarray
    measured: np.ndarray
    simulated: np.ndarray
    from_measured: np.ndarray
    predicted: np.ndarray
    innovations: np.ndarray
    noise: Noise
    sigma: float
    known: bool
    problem: Problem
    starts: tuple[np.ndarray, ...]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Roles of the outputs."""
        return self.roles.outputs

    def stretches(self, values: np.ndarray) -> list[np.ndarray]:
        """(n, ...) values cut into uninterrupted stretches."""
        return np.split(values, self.ends[:-1])


def replay(experiment: Experiment, drive: Drive, noise: Mapping[str, float], segment: float,
           start: KnownStart | None = None, known: Covariance | None = None) -> Replay:
    """Run a model over a record.

    experiment  motor torque and any sensors; start states are fitted to the first one only,
                the motor's speed or else angle, so that the others stay unseen
    drive       all inertias and stiffnesses must have a value
    noise       of the parameter file: sensor_std.<role>, torque_std, torque_correlation_time, torque_slow_share;
                where they are missing the ratio is estimated on the record
    segment     length of the free runs [s]; 0: whole stretches, across a gap as far as a true model follows
    start       what is known of the state in which the record begins
    known       covariance of the parameters by their fit: the likeliest values and noise in its confidence region
                are tested; None: the model is taken as exact. Free runs are those of the drive as it is
    raises      BadParameters: a value is missing; BadOption: segments too short, an invalid start state;
                BadRecording: no torque or no sensor
    """
    drive.require(drive.missing(), "a simulation")
    if 0.0 < segment < MIN_SEGMENT_SAMPLES * experiment.step:
        raise BadOption(
            f"segments of at least {MIN_SEGMENT_SAMPLES * experiment.step:g} s, {MIN_SEGMENT_SAMPLES} samples",
            f"{segment:g} s", "Give --segment more, or 0 for one free run.")
    every = roles_of([experiment], drive)
    first = Roles(every.inputs, every.outputs[:1])
    known_start = known_states(start or KnownStart(), drive, (), every)
    task = Task(drive, (), first, (experiment,), known_start)
    segment = segment or _followed_length(task, noise, known)
    pieces, problem = traces_of([experiment], every, segment, known_start), task.problem(segment)
    starts = start_states(task, problem)
    model = problem_of(drive, (), every, pieces)
    runs, offsets = _joined_free_runs(model, every, _with_motor_angle(drive, every, first, pieces, starts))
    measured_runs, measured_offsets = _joined_free_runs(model, every, measured_states(drive, every, pieces))
    whole = traces_of([experiment], every)
    ends = np.cumsum([t.size for t in whole])
    passes, model_noise = _kalman_passes(
        task, every, [replace(t, outputs=t.outputs - o.mean(axis=0)) for t, o in zip(
            whole, np.split(offsets, ends[:-1]), strict=True)], noise, known)
    innovations = np.concatenate([p.innovations for p in passes])
    z = innovations / np.sqrt(np.concatenate([p.variance for p in passes]))
    measured = np.concatenate([t.outputs for t in whole])
    return Replay(
        drive, segment, every, np.concatenate([np.arange(a, b) for a, b in experiment.segments if b - a >= 10]),
        tuple(ends.tolist()), np.concatenate([t.inputs for t in whole]), measured,
        runs + offsets, measured_runs + measured_offsets,
        measured - innovations, z, model_noise, float(np.sqrt(np.nanmean(z[:, 0] ** 2))),
        _noise_of_file(first, noise, problem) is not None, problem, starts)


def _followed_length(task: Task, noise: Mapping[str, float], known: Covariance | None) -> float:
    """Length [s] of the free runs of a true model that its noise and its uncertainty allow; 0: whole stretches.

    A little noise decides when a gap closes, from where on a free run leaves the record. Without a gap it does not.
    """
    if not has_gap(task):
        return 0.0
    whole = task.problem()
    found, sigma = _noise_of_file(task.roles, noise, whole), noise.get(f"sensor_std.{task.roles.outputs[0]}", 0.0)
    if found is None:
        point = Point(np.empty(0), first_states(task.drive, task.roles, whole.traces))
        found = fit_ratio(whole, point, Noise(1.0, None, whole.scale))
        sigma = float(np.sqrt(np.nanmean(np.concatenate(
            [f.innovations[:, 0] ** 2 / f.variance[:, 0] for f in filtered(whole, point, found, keep=False)]))))
    for length in (0.0, FREE_RUN_LENGTH):
        traces = task.traces(length)
        fits = attainable_fits(task.drive, task.roles, traces, segment_states(task, traces), found, sigma, 1,
                               FREE_RUN_DRAWS, known)
        if np.median(fits) > MIN_ATTAINABLE_FIT:
            return length
    return run_length(task, np.inf)


def start_state_findings(drive: Drive, run: Replay) -> list[Finding]:
    """Known start states of the free runs that the record contradicts."""
    roles = Roles(run.roles.inputs, run.roles.outputs[:1])
    return contradicted_start_findings(drive, roles, run.problem, Point(np.empty(0), run.starts), run.noise,
                                       run.sigma**2)


def start_states(task: Task, problem: Problem) -> tuple[np.ndarray, ...]:
    """Start states of free runs that simulate each trace best, from several guesses.

    Trace by trace: they are independent, and with backlash one that fails must not stop the others.
    """
    steady = first_states(task.drive, task.roles, problem.traces)
    tracked = segment_states(task, problem.traces)
    found = []
    for trace, *guesses in zip(problem.traces, steady, tracked, strict=True):
        one = replace(problem, traces=(trace,))
        points = [Point(np.empty(0), (guess,)) for guess in guesses[np.array_equal(*guesses):]]
        noise = fit_ratio(one, points[-1], Noise(1.0, None, one.scale))
        points.append(Point(np.empty(0), smoothed_starts(one, points[-1], noise)))
        best = min((solve(one, point, max_iterations=40) for point in points), key=lambda s: s.cost)
        found.append(best.point.starts[0])
    return tuple(found)


def simulated(problem: Problem, starts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """(n, ny) free runs of the traces of a problem without free parameters."""
    plants = problem.plants(np.empty(0), False)
    return [plant.outputs(t, s) for plant, t, s in zip(plants, problem.traces, starts, strict=True)]


def _joined_free_runs(model: Problem, roles: Roles, starts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(outputs of free runs in a row, offsets to add to them), each (n, ny)."""
    runs = simulated(model, starts)
    offsets = [np.tile(_angle_offsets(roles, t, r), (t.size, 1)) for t, r in zip(model.traces, runs, strict=True)]
    return np.concatenate(runs), np.concatenate(offsets)


def resonances(drive: Drive, step: float) -> list[float]:
    """Resonances [Hz] of the drive with its backlash closed, up to half the sampling rate."""
    neutral = {n: drive.quantity(n).neutral for n in drive.values
            if owner_of(n) == "converter" or quantity_of(n) in ("half_gap", "coulomb", "drift_coulomb")}
    closed = replace(drive, values={**drive.values, **neutral})
    s = Assembly(closed, Layout((), ("motor_torque",), (), step, gradient=False)).system()
    poles = np.linalg.eigvals(s.rows[:, :s.nx, 0] / s.mass[:, :1])
    found = np.abs(poles[poles.imag > 1e-9 * np.abs(poles)]) / (2.0 * np.pi)
    return sorted(float(f) for f in found if f < 0.5 / step)


def _kalman_passes(task: Task, every: Roles, whole: Sequence[Trace],
            noise: Mapping[str, float], known: Covariance | None) -> tuple[list[Filtered], Noise]:
    """Kalman passes over whole stretches: the first output alone, the others together with it.

    A load sensor with a wrong scale must not distort the residual of the motor.
    """
    first = [replace(t, outputs=t.outputs[:, :1]) for t in whole]
    passes, model = _passes_of_likeliest(task, task.roles, first, noise, known)
    if len(every.outputs) == 1:
        return passes, model
    both, _ = _passes_of_likeliest(task, every, whole, noise, known)
    joined = [replace(b, innovations=np.hstack([a.innovations, b.innovations[:, 1:]]),
                      variance=np.hstack([a.variance, b.variance[:, 1:]]))
              for a, b in zip(passes, both, strict=True)]
    return joined, model


def _passes_of_likeliest(task: Task, roles: Roles, traces: Sequence[Trace], noise: Mapping[str, float],
           known: Covariance | None) -> tuple[list[Filtered], Noise]:
    """Kalman passes of the likeliest model in the confidence region of the fit, and the noise of its file."""
    problem = problem_of(task.drive, (), roles, traces)
    first, file_noise = (Point(np.empty(0), first_states(task.drive, roles, traces)),
                         _noise_of_file(roles, noise, problem))
    if file_noise is None:
        guess = fit_ratio(problem, first, Noise(1.0, None, problem.scale))
        first = replace(first, starts=smoothed_starts(problem, first, guess))
        tracked = _with_best_starts(problem, first, fit_ratio(problem, first, guess))
    else:
        tracked = _with_best_starts(problem, first, file_noise)
    if known is None:
        return filtered(tracked.problem, tracked.point, tracked.noise, keep=False), tracked.noise
    tracked = _with_best_starts(problem, tracked.point, tracked.noise, file_noise)
    for _ in range(MAX_REGION_STEPS):
        drive = likeliest_drive_in_region(task.drive, roles, traces, tracked.point, tracked.noise, known)
        if drive is None:
            break
        trial = _with_best_starts(problem_of(drive, (), roles, traces), tracked.point, tracked.noise, file_noise)
        if trial.value >= tracked.value:
            break
        tracked = trial
    return filtered(tracked.problem, tracked.point, tracked.noise, keep=False), file_noise or tracked.noise


@dataclass(frozen=True)
class _StartedModel:
    """A model over whole stretches: start states that predict best under its noise, and its -log likelihood."""

    problem: Problem
    point: Point
    noise: Noise
    value: float


def _with_best_starts(
        problem: Problem, point: Point, noise: Noise, file_noise: Noise | None = None) -> _StartedModel:
    """The model from start states near those of a point.

    noise       under which they are found
    file_noise  noise of the file, whose interval has the likeliest one; None: none
    """
    point = Point(point.values, tuple(s[:len(problem.free_start)] for s in point.starts))
    noise = noise if file_noise is None else likeliest_noise_in_interval(problem, point, file_noise)
    gains = [f.gains for f in filtered(problem, point, noise)]
    point = solve(problem.with_memory(noise.memory), with_disturbance_state(point, noise), gains,
                  max_iterations=10).point
    return _StartedModel(problem, point, noise, minus_log_likelihood(filtered(problem, point, noise, keep=False)))


def _noise_of_file(roles: Roles, noise: Mapping[str, float], problem: Problem) -> Noise | None:
    """The noise of a parameter file for these sensors; None if it has none."""
    sensor, torque = noise.get(f"sensor_std.{roles.outputs[0]}", 0.0), noise.get("torque_std")
    if torque is None or sensor <= 0.0:
        return None
    time, h = noise.get("torque_correlation_time", 0.0), problem.step
    stds = [noise.get(f"sensor_std.{role}", 0.0) for role in roles.outputs]
    scale = [std / sensor if std > 0.0 else guess for std, guess in zip(stds, problem.scale, strict=True)]
    return Noise(torque / sensor, float(np.exp(-h / time)) if time > 0.0 else None, np.array(scale),
                 slow=noise.get("torque_slow_share") if time > 0.0 else None)


def _with_motor_angle(drive: Drive, every: Roles, first: Roles, traces: Sequence[Trace],
                starts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Start states with the motor angle in its place where another sensor needs it."""
    found = []
    for full, start in zip(first_states(drive, every, traces), starts, strict=True):
        at = len(drive.bodies) + len(drive.shafts)
        found.append(start if len(full) == len(start) else np.insert(start, at, full[at]))
    return found


def _angle_offsets(roles: Roles, trace: Trace, run: np.ndarray) -> np.ndarray:
    """(ny,) by how much angles beyond the first output lie above the simulated ones.

    The zero of a second encoder is arbitrary and no property of the model.
    """
    offset = np.zeros(len(roles.outputs))
    for m, role in enumerate(roles.outputs[1:], 1):
        if role.endswith("angle") and np.isfinite(trace.outputs[:, m]).any():
            offset[m] = np.nanmean(trace.outputs[:, m] - run[:, m])
    return offset
