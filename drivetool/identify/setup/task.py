"""A fit to recordings: the task, and its outcome."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drivetool.drive import Drive
from drivetool.drive.simulation import Trace
from drivetool.identify.noise import Fit
from drivetool.identify.problem import Point, Problem, Solution
from drivetool.identify.setup.setup import Roles, linear_problem_of, problem_of, traces_of, with_trial_values
from drivetool.logs import Experiment
from drivetool.quantity import quantity_of

# [s] across a gap: start errors grow a hundredfold in a second, and not yet within this time.
FREE_RUN_LENGTH_ACROSS_GAP = 0.2
MIN_RUN_SAMPLES = 20  # samples of a run: twice the least of a stretch


@dataclass(frozen=True)
class Task:
    """A drive to be fitted to recordings.

    start  known states in which the recordings begin, by number, see `traces_of`
    """

    drive: Drive
    free: tuple[str, ...]
    roles: Roles
    experiments: tuple[Experiment, ...]
    start: Mapping[int, Mapping[str, float]] = field(default_factory=dict)

    def problem(self, segment: float = 0.0, free: Sequence[str] | None = None) -> Problem:
        """The least-squares problem, with traces cut to `segment` seconds if above zero."""
        free = self.free if free is None else tuple(free)
        return problem_of(self.drive, free, self.roles, self.traces(segment))

    def linear_problem(self, segment: float = 0.0) -> Problem:
        """The same without gaps and Coulomb friction, for observers, at the same points."""
        return linear_problem_of(self.drive, self.free, self.roles, self.traces(segment))

    def traces(self, segment: float = 0.0) -> tuple[Trace, ...]:
        """The stretches of the recordings, cut to `segment` seconds if above zero."""
        return traces_of(self.experiments, self.roles, segment, self.start)

    def at(self, values: Mapping[str, float]) -> Task:
        """The task with other values of the drive."""
        return replace(self, drive=with_trial_values(self.drive, list(values), np.array(list(values.values()))))

    def at_point(self, point: Point) -> Task:
        """The task at fitted values."""
        return self.at(dict(zip(self.free, point.values, strict=True)))

    def with_free(self, names: Collection[str]) -> Task:
        """The task with these parameters of its drive free, and no others."""
        return replace(self, free=tuple(n for n in self.drive.quantities if n in names))

    def with_held(self, names: Collection[str]) -> Task:
        """The task with these of its free parameters held."""
        return replace(self, free=tuple(n for n in self.free if n not in names))


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

    @classmethod
    def of_fit(cls, task: Task, problem: Problem, fit: Fit, starts: Sequence[dict] = ()) -> Outcome:
        """The outcome of an innovations fit."""
        return cls(task, problem, fit.solution, fit, tuple(starts), fit.converged)

    @property
    def fitted(self) -> Task:
        """The task at the fitted values."""
        return self.task.at_point(self.solution.point)

    @property
    def drive(self) -> Drive:
        """The drive with the fitted values."""
        return self.fitted.drive

    @property
    def sensor_std(self) -> float:
        """Standard deviation of the first sensor's noise."""
        return float(np.sqrt(self.problem.variance(self.solution.cost)))


def has_gap(task: Task) -> bool:
    """Whether a gap acts or is to be fitted."""
    return any(quantity_of(n) == "half_gap" and (n in task.free or (task.drive.value(n) or 0.0) > 0.0)
               for n in task.drive.quantities)


def run_length(task: Task, length: float) -> float:
    """Length [s] of the free runs of a recording: as given, shorter across a gap, more at a low sampling rate."""
    return max(min(length, FREE_RUN_LENGTH_ACROSS_GAP) if has_gap(task) else length,
               MIN_RUN_SAMPLES * max(e.step for e in task.experiments))
