"""Sums of friction and their parts in a fit: what is known apart, what is told apart, and what only together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from drivetool.drive import AT, TOTALS, Drive, shared
from drivetool.identify.fit.engine import again, by_simulation, fit_task, is_hard, segment_of
from drivetool.identify.fit.parts import parted, told_apart
from drivetool.identify.noise import Noise, fit_ratio, normal_under
from drivetool.identify.problem import Point
from drivetool.identify.setup import Options, Outcome, Task, first_point
from drivetool.identify.starts import balanced


def with_totals(drive: Drive, named: Sequence[str]) -> Drive:
    """Sums of friction instead of their parts, unless a part was named.

    named  what was asked for and what is to be held
    """
    if len(drive.bodies) == 1:
        return drive
    named = {*named, *(shared(n) for n in drive.values if AT in n)}
    for total, suffix in TOTALS.items():
        parts = [f"{b}.{suffix}" for b in drive.bodies]
        if total not in drive.values and not any(p in named for p in parts):
            drive = drive.with_values({total: drive.felt(suffix)})
    return drive


def apart(drive: Drive) -> Drive:
    """The parts of friction instead of their sums."""
    for total in TOTALS:
        if total in drive.values:
            drive = drive.with_values(drive.parts(total, drive.values[total]))
    return drive


def fit_apart(task: Task, options: Options, asked: Options, starts: Sequence[Mapping[str, float]]) -> Outcome:
    """Fit a task; where a gap makes that hard, with the friction in parts that the record tells at the start.

    A sum shared out by rule is a wrong model across a gap, in which hardly two ways in agree.

    asked  options as they were asked for, `all` not spelled out
    """
    finer = begun_apart(task, asked)
    outcome = fit_task(finer, options, starts, task)
    if finer is task or _still_apart(task, outcome):
        return outcome
    return fit_task(task, options, starts)


def begun_apart(task: Task, options: Options) -> Task:
    """The task with the parts of its sums free that the record tells at the start values already."""
    if not is_hard(task) or options.criterion not in ("auto", "innovations"):
        return task
    begun = balanced(task)
    for total in _divisible(task, options):
        for finer, parts in parted(begun, total):
            problem = finer.problem()
            point = first_point(finer.drive, problem, finer.roles)
            noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale), quick=True)
            whole = begun.drive.values[total]
            if told_apart(finer, problem, point, normal_under(problem, point, noise), parts, whole):
                begun = finer
                break
    return task if begun.free == task.free else begun


def _divisible(task: Task, options: Options) -> list[str]:
    """The sums that are free without having been asked for."""
    return [t for t in TOTALS if t in task.free and t not in options.free and t not in options.hold]


def _still_apart(task: Task, outcome: Outcome) -> bool:
    """Whether the record tells the parts at the end, which were free in place of the sums of a task."""
    drive, problem, solution = outcome.drive, outcome.problem, outcome.solution
    for total, suffix in TOTALS.items():
        parts = [n for n in outcome.task.free if n.endswith(f".{suffix}") and n not in TOTALS]
        if total in task.free and total not in outcome.task.free and not told_apart(
                outcome.task, problem, solution.point, solution.normal, parts, drive.felt(suffix)):
            return False
    return True


def split_totals(outcome: Outcome, options: Options) -> Outcome:
    """Free the parts of a friction sum where the record can tell them apart.

    With a gap, a reversing drive, or a load sensor, friction on the motor and on the load act
    differently, and a sum shared out by rule would be a wrong model.
    """
    for total in _divisible(outcome.task, options):
        whole = outcome.drive.values[total]
        for task, parts in parted(replace(outcome.task, drive=outcome.drive), total):
            if _told_apart(task, outcome, parts, whole):
                trial = (again(task, outcome.fit.noise) if outcome.fit is not None
                         else by_simulation(task, segment_of(options), [{}], near=True))
                if _better(trial, outcome):
                    outcome = trial
                break
    return outcome


def _told_apart(task: Task, outcome: Outcome, parts: Sequence[str], whole: float) -> bool:
    """Whether the record tells the parts, at the present estimate."""
    problem = task.problem(_segment_of(outcome))
    point = first_point(task.drive, problem, task.roles)
    point = Point(point.values, outcome.solution.point.starts)
    normal = (problem.normal(point) if outcome.fit is None
              else normal_under(problem, point, outcome.fit.noise))
    return told_apart(task, problem, point, normal, parts, whole)


def _segment_of(outcome: Outcome) -> float:
    whole = outcome.task.problem(free=())
    if len(whole.traces) == len(outcome.problem.traces):
        return 0.0
    return outcome.problem.traces[0].size * outcome.problem.traces[0].step


def _better(trial: Outcome, outcome: Outcome) -> bool:
    """The parts never fit worse than their sum shared out by rule."""
    if trial.fit is not None and outcome.fit is not None:
        return trial.fit.value <= outcome.fit.value + 0.5
    return trial.solution.cost <= outcome.solution.cost * (1.0 + 1e-9)
