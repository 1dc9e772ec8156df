"""Free runs as a test of fits: the error of each drive within a second, taken as a speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivetool.identify.estimate import fit_percent
from drivetool.identify.fit import free_run
from drivetool.identify.motion import SIGN_SIGNIFICANCE, Motions, Smoothing
from drivetool.identify.noise import Noise, filtered
from drivetool.identify.problem import Point, solve
from drivetool.identify.setup import Task, first_point, has_gap, run_length, white_std

FREE_RUN_LENGTH = 1.0  # s at least: errors of friction over half a second show, and the start state is forgotten
# Error of straight lines over the std of the speed, from which runs are long enough. A choice: where less is left,
# the constant torque of each run explains the motion by itself, whatever the drive.
MIN_STRAIGHT_LINE_SHARE = 0.1
# Means of a run, at least: fewer only give its constant and slope, which are fitted to each run.
MIN_MEANS_PER_RUN = 4


@dataclass(frozen=True)
class FreeRunTest:
    """The test by free runs, the same for all candidates.

    smoothings  of the first sensor, sampling interval -> Smoothing: errors above its cut-off are noise
    noise       of a fit, by which the runs' first start states are filtered
    length      of a run [s], where a comparison does not ask for longer ones
    """

    smoothings: Mapping[float, Smoothing]
    noise: Noise
    length: float = FREE_RUN_LENGTH

    def with_bent_runs(self, task: Task, seen: Motions) -> FreeRunTest:
        """The same with runs so long that straight lines leave a tenth of the speed's std; at most the record.

        A servo that follows triangles of speed is straight lines over a second. Across a gap runs stay short.
        """
        wanted = MIN_STRAIGHT_LINE_SHARE * float(np.nanstd(seen.all("speed")))
        longest, length = max(t.size * t.step for t in task.traces()), self.length
        while not has_gap(task) and length < longest and self.straight_line_error(task, length) < wanted:
            length = min(2.0 * length, longest)
        return replace(self, length=length)

    def error(self, task: Task, length: float | None = None) -> float:
        """Root mean square error of the free runs as a speed, of the first output.

        Each run has an idle torque of its own: a constant over a run is noise to every candidate alike.
        """
        whole = task.problem(free=())
        point = first_point(task.drive, whole, task.roles)
        states = [f.states for f in filtered(whole, point, replace(self.noise, memory=None, slow=None))]
        problem = task.problem(run_length(task, length or self.length), ()).with_constant_torque()
        starts, k, done = [], 0, 0
        is_angle = task.roles.outputs[0].endswith("angle")
        for trace in problem.traces:
            while done >= len(states[k]):
                k, done = k + 1, 0
            starts.append(np.append(states[k][done], 0.0))
            done += trace.size
        if is_angle:
            problem = replace(problem, lag=min(self.window(t.size, t.step) for t in problem.traces))
        # Run by run: one whose start state is hard to fit must not damp the steps of the others.
        starts = [solve(replace(problem, traces=(trace,)), Point(np.empty(0), (start,)), max_iterations=8,
                        relative=1e-4).point.starts[0] for trace, start in zip(problem.traces, starts, strict=True)]
        plants = problem.plants(np.empty(0), False)
        runs = [plant.outputs(trace, start)[:, 0]
                for plant, trace, start in zip(plants, problem.traces, starts, strict=True)]
        if not all(np.isfinite(run).all() for run in runs):
            return np.inf
        errors = [self._as_speed(run - trace.outputs[:, 0], trace.step, is_angle)
                  for run, trace in zip(runs, problem.traces, strict=True)]
        with np.errstate(over="ignore"):  # a wrong drive may diverge
            return float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))

    def fit_percent(self, task: Task) -> float:
        """100 (1 - error over that of a constant) of free runs over whole stretches, both as a speed."""
        problem, _, runs = free_run(task, noise=self.noise)
        is_angle = task.roles.outputs[0].endswith("angle")
        measured = [self._as_speed(t.outputs[:, 0], t.step, is_angle) for t in problem.traces]
        simulated = [self._as_speed(r[:, 0], t.step, is_angle) for r, t in zip(runs, problem.traces, strict=True)]
        return fit_percent(np.concatenate(measured), np.concatenate(simulated))

    def straight_line_error(self, task: Task, length: float | None = None) -> float:
        """Error of runs with no torque but a constant one: straight lines of the speed; zero if that is noise."""
        traces = task.traces(run_length(task, length or self.length))
        is_angle = task.roles.outputs[0].endswith("angle")
        errors, wide = [], [self.window(t.size, t.step) for t in traces]
        for trace in traces:
            y, place = trace.outputs[:, 0], np.linspace(-1.0, 1.0, trace.size)
            known, line = np.isfinite(y), np.vander(place, 3 if is_angle else 2)
            share = np.linalg.lstsq(line[known], y[known], rcond=None)[0]
            errors.append(self._as_speed(y - line @ share, trace.step, is_angle))
        found = float(np.sqrt(np.nanmean(np.concatenate(errors) ** 2)))
        white = white_std([t.outputs[:, 0] for t in traces])
        shortest = min(w * t.step for w, t in zip(wide, traces, strict=True))
        least = white * (np.sqrt(2.0) / shortest if is_angle else 1.0 / np.sqrt(min(wide)))
        return found if found > SIGN_SIGNIFICANCE * least else 0.0

    def window(self, size: int, step: float) -> int:
        """Samples over which the errors of a run of that size are averaged: a longer mean would hide them all."""
        return min(self.smoothings[step].window, max(size // MIN_MEANS_PER_RUN, 1))

    def _as_speed(self, values: np.ndarray, step: float, is_angle: bool) -> np.ndarray:
        wide = self.window(len(values), step)
        if is_angle:
            return (values[wide:] - values[:-wide]) / (wide * step)
        return np.convolve(values, np.ones(wide) / wide, "valid")
