"""Friction sums and their parts in a fit: given separately, identifiable separately, or only jointly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from drivetool.drive import TOTALS, Drive
from drivetool.errors import BadOption
from drivetool.identify.fit.engine import by_simulation, fit_task, is_multimodal, refit, segment_of
from drivetool.identify.fit.friction_split import parts_identifiable, tasks_with_parts
from drivetool.identify.noise import Noise, filtered_normal_equations, fit_ratio
from drivetool.identify.setup import Options, Outcome, Task, first_point
from drivetool.identify.starts import scaled_to_totals
from drivetool.quantity import names_of, quantity_of, record_of, shared


def with_totals(drive: Drive, free: Sequence[str], hold: Sequence[str] = ()) -> Drive:
    """Sums of friction instead of their parts, unless a part was named; the parts of a sum that are to be free.

    free, hold  parameters requested as free, and those to be held
    raises      BadOption: a sum is to be free beside its parts
    """
    if len(drive.bodies) == 1:
        return drive
    requested = {*free, *hold, *(shared(n) for n in drive.values if record_of(n))}
    for total, suffix in TOTALS.items():
        parts = names_of(drive.bodies, suffix)
        freed = [p for p in parts if p in free]
        if freed and total in free:
            raise BadOption(f"either {total} or its parts after --free", f"{total} and {', '.join(freed)}",
                            "Free the sum alone, or the parts alone.")
        if total not in drive.values and not any(p in requested for p in parts):
            drive = drive.with_values({total: drive.referred_to_motor(suffix)})
        elif total in drive.values and freed:
            drive = drive.with_values(drive.parts(total, drive.values[total]))
    return drive


def with_friction_parts(drive: Drive) -> Drive:
    """The parts of friction instead of their sums."""
    for total in TOTALS:
        if total in drive.values:
            drive = drive.with_values(drive.parts(total, drive.values[total]))
    return drive


def fit_with_friction_split(task: Task, options: Options, requested: Options,
                            starts: Sequence[Mapping[str, float]]) -> Outcome:
    """Fit a task; where a gap makes that hard, with those friction parts free that are identifiable at the start.

    A sum split by rule is a wrong model across a gap: hardly two starts reach the same optimum.

    requested  options as requested, `all` not expanded
    """
    finer = with_identifiable_parts(task, requested)
    outcome = fit_task(finer, options, starts, task)
    if finer is task or _parts_still_identifiable(task, outcome):
        return outcome
    return fit_task(task, options, starts)


def with_identifiable_parts(task: Task, options: Options) -> Task:
    """The task with those parts of its sums free that are identifiable at the start values already."""
    if not is_multimodal(task) or options.criterion not in ("auto", "innovations"):
        return task
    prepared = scaled_to_totals(task)
    for total in _unrequested_sums(task, options):
        for finer, parts in tasks_with_parts(prepared, total):
            problem = finer.problem()
            point = first_point(finer.drive, problem, finer.roles)
            noise = fit_ratio(problem, point, Noise(1.0, None, problem.scale), quick=True)
            whole = prepared.drive.values[total]
            if parts_identifiable(finer, problem, point, filtered_normal_equations(problem, point, noise), parts,
                                  whole):
                prepared = finer
                break
    return task if prepared.free == task.free else prepared


def _unrequested_sums(task: Task, options: Options) -> list[str]:
    """The sums that are free without a request."""
    return [t for t in TOTALS if t in task.free and t not in options.free and t not in options.hold]


def _parts_still_identifiable(task: Task, outcome: Outcome) -> bool:
    """Whether the parts that were free in place of a task's sums are identifiable at the estimate."""
    drive, problem, solution = outcome.drive, outcome.problem, outcome.solution
    for total, suffix in TOTALS.items():
        parts = [n for n in outcome.task.free if quantity_of(n) == suffix and n not in TOTALS]
        if total in task.free and total not in outcome.task.free and not parts_identifiable(
                outcome.task, problem, solution.point, solution.normal, parts, drive.referred_to_motor(suffix)):
            return False
    return True


def split_totals(outcome: Outcome, options: Options) -> Outcome:
    """Free the parts of a friction sum where they are separately identifiable.

    With a gap, a reversing drive, or a load sensor, friction on the motor and on the load act
    differently, and a sum split by rule would be a wrong model.
    """
    for total in _unrequested_sums(outcome.task, options):
        whole = outcome.drive.values[total]
        for task, parts in tasks_with_parts(replace(outcome.task, drive=outcome.drive), total):
            if _parts_identifiable_now(task, outcome, parts, whole):
                trial = (refit(task, outcome.fit.noise) if outcome.fit is not None
                         else by_simulation(task, segment_of(options), [{}], near_optimum=True))
                if _fits_no_worse(trial, outcome):
                    outcome = trial
                break
    return outcome


def _parts_identifiable_now(task: Task, outcome: Outcome, parts: Sequence[str], whole: float) -> bool:
    """Whether the parts are identifiable at the present estimate."""
    problem = task.problem(_segment_of_outcome(outcome))
    point = replace(first_point(task.drive, problem, task.roles), starts=outcome.solution.point.starts)
    normal = (problem.normal(point) if outcome.fit is None
              else filtered_normal_equations(problem, point, outcome.fit.noise))
    return parts_identifiable(task, problem, point, normal, parts, whole)


def _segment_of_outcome(outcome: Outcome) -> float:
    if len(outcome.task.traces()) == len(outcome.problem.traces):
        return 0.0
    return outcome.problem.traces[0].size * outcome.problem.traces[0].step


def _fits_no_worse(trial: Outcome, outcome: Outcome) -> bool:
    """The parts never fit worse than their sum split by rule."""
    if trial.fit is not None and outcome.fit is not None:
        return trial.fit.value <= outcome.fit.value + 0.5
    return trial.solution.cost <= outcome.solution.cost * (1.0 + 1e-9)
