"""Grey box: the physical parameters of the drive, polished on a record.

By default by the innovations fit, whose intervals hold under torque noise; the simulation-error
fit is always made too, and both are judged by how they simulate data held out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from drivetool.drive import TOTALS, Drive, shared
from drivetool.errors import BadOption, DriveToolError, Finding
from drivetool.identify.channels import doubted_channels, feedback_in, torque_timing, without_outliers
from drivetool.identify.estimate import Estimate, fit_percent
from drivetool.identify.fit import (
    again,
    apart,
    by_innovations,
    by_simulation,
    coloured,
    fit_apart,
    free_run,
    opened_gaps,
    segment_of,
)
from drivetool.identify.greybox.clamped import beyond_clamps, with_first_values
from drivetool.identify.identifiability import (
    all_uncrossed,
    contradicted_holds,
    from_below,
    told_by,
    worth_of_shafts,
)
from drivetool.identify.laws import can_be_asked, explained, lack_of, without_shaft
from drivetool.identify.outcome import compose, unsettled
from drivetool.identify.setup import (
    Options,
    Outcome,
    Roles,
    Task,
    at_rates,
    check_scale,
    has_gap,
    known_states,
    led_in,
    reverses,
    roles_of,
    shared_by_some,
)
from drivetool.identify.shaft_torque import as_in_file, friction_told, with_frictions
from drivetool.logs import Experiment
from drivetool.logs.samples import measured

ALL = "all"  # after --free: whatever a grey-box fit frees
HOLDOUT = 0.3  # share of each record on which the two criteria are compared
SHOWS = 6.0  # log likelihood by which a dry friction of another size must be better to be freed unasked


def greybox(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """Physical parameters of a drive from records of torque and motion.

    experiments  motor_torque and a sensor: motor_speed, else motor_angle; also load_speed or
                 load_angle and shaft_torque where they were logged. Fitted together
    drive        start values; all inertias and stiffnesses must have one
    options      hold, free, criterion, segment, start
    returns      Estimate: inertias, stiffness, damping, friction, and what is freed
    raises       BadParameters: a start value is missing; NotEnoughData: too short a record
    source       Tallfors 2005, sec. 5.5; Ljung 1999 for the innovations form
    """
    drive = with_first_values(drive, experiments)
    drive.require(drive.missing(), "the start of a grey-box fit")
    experiments = [led_in(measured(e), drive, options.free) for e in at_rates("greybox", experiments, options)]
    roles = roles_of(experiments, drive)
    if options.criterion == "inverse":
        return _by_inverse(experiments, drive, options, roles)
    drive = with_frictions(drive, roles, options)
    asked, options = options, expanded(options, drive, experiments)
    free = shared_by_some(chosen(drive, default_free(drive, experiments), options), drive, experiments)
    check_scale(drive, free, roles, options.hold)
    if options.criterion == "frequency":
        from drivetool.identify.frequency import greybox_by_frequency

        return greybox_by_frequency(experiments, drive, free, options)
    task = Task(drive, free, roles, tuple(experiments), known_states(options.start, drive, free, roles))
    outcome, left = without_outliers(fit_apart(task, options, asked, [{}]))
    white, least = all_uncrossed(dry_friction(friction_told(outcome, drive, options, asked), asked))
    chosen_fit = explained(white, options, bool(least))
    explanation, outcome = chosen_fit.explanation, chosen_fit.outcome
    figures, findings = ({}, list(explanation.findings)) if explanation else both_criteria(outcome, options)
    model_lacks = explanation.lacks if explanation else bool(findings)
    worthless = explanation is not None and explanation.worthless
    settled = explanation is not None and not worthless
    found = explanation.own.drive if settled else outcome.drive
    findings = [*left, *doubted_channels(task, found, settled), *findings]
    figures["noise_parameters"] = 0 if outcome.fit is None else outcome.fit.noise.parameters
    estimate = compose("greybox", drive, outcome, findings, {}, figures, options.known, explanation)
    estimate = as_in_file(estimate, outcome, options, free, explanation)
    if chosen_fit.alone:
        estimate = replace(estimate, explanation=chosen_fit.alone)
    estimate = replace(estimate, findings=(*torque_timing(white), *estimate.findings))
    astray = unsettled(outcome)
    lacking = estimate.repeats or model_lacks or astray
    if lacking:
        contradicted = contradicted_holds(task, white, options, asked)
        estimate = replace(estimate, findings=(*contradicted, *estimate.findings))
    if outcome.drive.shafts and not has_gap(outcome.task) and lacking and not can_be_asked(*chosen_fit.rivals[:2]):
        opened = opened_gaps(outcome.task.at_point(outcome.solution.point), "this drive has none")
        estimate = replace(estimate, findings=(*estimate.findings, *opened))
    for name, low in least.items():
        estimate = from_below(estimate, name, low)
    estimate = replace(estimate, findings=(*estimate.findings, *torque_is_the_answer(astray or worthless, task)))
    estimate = told_by(estimate, worth_of_shafts(white))
    return without_shaft(estimate, lack_of(*chosen_fit.rivals), drive.shafts[0]) if drive.shafts else estimate


def _by_inverse(experiments: Sequence[Experiment], drive: Drive, options: Options, roles: Roles) -> Estimate:
    """The fit of the torque that the motion asks for."""
    from drivetool.identify.inverse import greybox_by_inverse

    # The motion is known, so that a motor's friction is told from the others'.
    drive = apart(drive)
    free = chosen(drive, default_free(drive, experiments), expanded(options, drive, experiments))
    free = shared_by_some(free, drive, experiments)
    if not bends_behind(drive, free):
        # One constant torque shows, wherever it acts: the motor's stands for all, unless others are asked for.
        behind = {f"{b}.idle_torque" for b in drive.bodies[1:]} - set(options.free)
        free = tuple(n for n in free if n not in behind)
    return greybox_by_inverse(experiments, drive, free, roles, options)


def bends_behind(drive: Drive, free: Sequence[str]) -> bool:
    """Whether dry friction or a gap behind the first body tells a torque there from one on that."""
    return any(shared(n).endswith((".coulomb", ".half_gap")) and not n.startswith(f"{drive.bodies[0]}.")
               and (n in free or (drive.value(n) or 0.0) > 0.0) for n in drive.quantities)


def default_free(drive: Drive, experiments: Sequence[Experiment]) -> tuple[str, ...]:
    """Inertias, shafts, friction sums, and Coulomb friction where the motion reverses.

    Of a body that is clamped in every recording nothing shows. Beyond a clamp a shaft's damping has the viscous
    friction in it, and its twist a constant torque.
    """
    # A body that is known to carry a mass: that is what is asked for, its own inertia is the small part.
    names = [f"{b}.{'carried_mass' if drive.value(f'{b}.carried_mass') else 'inertia'}" for b in drive.bodies]
    for shaft in drive.shafts:
        names += [f"{shaft}.stiffness", f"{shaft}.damping"]
    hidden = beyond_clamps(drive, experiments)
    for total, suffix in () if hidden else TOTALS.items():
        parts = [f"{b}.{suffix}" for b in drive.bodies]
        names += [total] if total in drive.values and len(parts) > 1 else parts
    names = [n for n in names if n.partition(".")[0] not in hidden]
    coulomb = [f"{b}.coulomb" for b in drive.bodies if (drive.value(f"{b}.coulomb") or 0.0) > 0.0]
    if reverses(experiments):
        names += coulomb or [f"{drive.bodies[0]}.coulomb"]
    return tuple(names)


def expanded(options: Options, drive: Drive, experiments: Sequence[Experiment]) -> Options:
    """The options with `--free all` spelled out: everything a grey-box fit frees."""
    if ALL not in options.free:
        return options
    free = [n for n in options.free if n != ALL]
    free += [n for n in default_free(drive, experiments) if n not in options.hold]
    return replace(options, free=tuple(dict.fromkeys(free)))


def chosen(drive: Drive, default: Sequence[str], options: Options) -> tuple[str, ...]:
    """The free parameters after --hold and --free, in the drive's order."""
    both = set(options.hold) & set(options.free)
    if both:
        raise BadOption("a parameter held or free", f"{', '.join(sorted(both))} as both", "Drop one of the two.")
    names = (set(default) | set(options.free)) - set(options.hold)
    for name in names:
        if choice := drive.quantity(name).choice:
            raise BadOption("numbers after --free", f"{name}, which is {' or '.join(f'{v:g}' for v in choice)}",
                            "Give its value with --set, or with --record.")
    return tuple(n for n in drive.quantities if n in names)


def dry_friction(outcome: Outcome, options: Options) -> Outcome:
    """Free the Coulomb friction that was given, where the record contradicts its value.

    A drive that only stops, or hardly turns back, may show it too; one that never stops does not.
    """
    drive = outcome.task.drive
    names = {n for n in (f"{b}.coulomb" for b in drive.bodies) if (drive.value(n) or 0.0) > 0.0}
    names -= {*outcome.task.free, *options.hold}
    if not names or outcome.fit is None:
        return outcome
    free = tuple(n for n in drive.quantities if n in {*outcome.task.free, *names})
    trial = again(replace(outcome.task, drive=outcome.drive, free=free), outcome.fit.noise)
    return trial if trial.fit is not None and trial.fit.value < outcome.fit.value - SHOWS else outcome


def both_criteria(outcome: Outcome, options: Options) -> tuple[dict[str, float], list[Finding]]:
    """Simulated fit of both criteria on the held-out end of the records, and what it means.

    Each criterion is fitted to the first part of every record and simulated over the rest.
    """
    task = outcome.task.at_point(outcome.solution.point)
    train = [e.between(0.0, (1.0 - HOLDOUT) * e.size * e.step) for e in task.experiments]
    rest = [e.between((1.0 - HOLDOUT) * e.size * e.step, e.size * e.step) for e in task.experiments]

    def judged(fitted: Callable[[Task], Outcome]) -> float:
        """Fit of free runs over what was not fitted to."""
        point = fitted(replace(task, experiments=tuple(train))).solution.point
        problem, _, runs = free_run(replace(task.at_point(point), experiments=tuple(rest), start={}))
        y = np.concatenate([t.outputs[:, 0] for t in problem.traces])
        return fit_percent(y, np.concatenate([r[:, 0] for r in runs]))

    ways = {"innovations": lambda t: coloured(
                by_innovations(t, [{}]) if outcome.fit is None else again(t, outcome.fit.noise)),
            "simulation": lambda t: by_simulation(t, segment_of(options), [{}], near=True)}
    try:
        with ThreadPoolExecutor(len(ways)) as pool:
            found = list(pool.map(judged, ways.values()))
    except DriveToolError:
        return {}, []
    figures = {f"held_out_simulation_fit_percent_by_{name}": value for name, value in zip(ways, found, strict=True)}
    a, b = found
    # Clearly better: a tenth of what the innovations fit leaves unexplained, and two points.
    if b > a + max(2.0, 0.1 * (100.0 - a)):
        return figures, [Finding(
            "warning", "model-error",
            f"Fitted to simulate, the drive explains {b:.1f} % of the held-out motion; fitted to predict one "
            f"step, {a:.1f} %. The model lacks something physical, which the noise model hides.",
            figures, "Run diagnose; the intervals are conditional on the structure.")]
    return figures, []


def torque_is_the_answer(failed: bool, task: Task) -> list[Finding]:
    """A motion that no torque explains, and a torque that answers it: then the torque is the question.

    failed  whether the fit that simulates the motion did not settle, or explains nothing
    """
    if not failed or not feedback_in(task.experiments, task.roles.outputs[0]).there:
        return []
    return [Finding(
        "note", "torque-is-the-answer",
        "The torque answers the motion, and a fit that simulates the motion failed. Where the motion is imposed or "
        "well known, the torque is the better question.", {}, "Try --criterion inverse.")]
