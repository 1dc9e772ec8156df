"""Grey box: the physical parameters of the drive, fitted to a record.

By default by the innovations fit, whose intervals hold under torque noise. The simulation-error fit is always made
too, and both are assessed by the free-run error on held-out data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from drivetool.drive import TOTALS, Drive
from drivetool.errors import BadOption, DriveToolError
from drivetool.finding import Finding
from drivetool.identify.channels import feedback_in, suspect_channel_findings, torque_timing, without_outliers
from drivetool.identify.estimate import Estimate, Verdict, fit_percent
from drivetool.identify.fit import (
    by_innovations,
    by_simulation,
    fit_with_friction_split,
    free_run,
    opened_gap_findings,
    refit,
    segment_of,
    with_coloured_noise,
    with_friction_parts,
)
from drivetool.identify.greybox.clamped import (
    unidentified_by_clamps,
    with_start_inertia_of_record,
    with_start_values_from_clamped,
)
from drivetool.identify.identifiability import (
    contradicted_held_values,
    insignificant_shafts,
    shaft_gain,
    uncrossed_gaps,
    without_upper_limit,
)
from drivetool.identify.laws import can_be_tested, default_fit, find_missing_structure, missing_structure
from drivetool.identify.outcome import compose, not_converged
from drivetool.identify.setup import (
    HELD_OUT_SHARE,
    Options,
    Outcome,
    Roles,
    Task,
    after_transient,
    at_rates,
    check_torque_scale,
    has_gap,
    known_states,
    reverses,
    roles_of,
    shared_free_names,
    starts_or_stops,
)
from drivetool.identify.shaft_torque import friction_of_file, with_frictions, with_identified_friction
from drivetool.logs import Experiment
from drivetool.logs.samples import without_unmeasured
from drivetool.quantity import name_of, names_of, owner_of, quantity_of

ALL = "all"  # after --free: all that a grey-box fit frees
# Log likelihood that freeing a given dry friction must gain without a request. A choice: chance gives it once in
# two thousand fits (chi-square of one degree of freedom, 12).
MIN_DRY_FRICTION_GAIN = 6.0


def greybox(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """Physical parameters of a drive from records of torque and motion.

    experiments  motor_torque and a sensor: motor_speed, else motor_angle; also load_speed or
                 load_angle and shaft_torque where they were logged. Fitted together
    drive        start values; all inertias and stiffnesses must have one, but for the inertia of a single body
    options      hold, free, criterion, segment, start
    returns      Estimate: inertias, stiffness, damping, friction, and what is freed
    raises       BadParameters: a start value is missing; NotEnoughData: too short a record
    source       Tallfors 2005, sec. 5.5; Ljung 1999 for the innovations form
    """
    drive = with_start_inertia_of_record(with_start_values_from_clamped(drive, experiments), experiments)
    drive.require(drive.missing(), "the start of a grey-box fit")
    experiments = [after_transient(without_unmeasured(e), drive, options.free)
                   for e in at_rates("greybox", experiments, options)]
    roles = roles_of(experiments, drive)
    if options.criterion == "inverse":
        return _by_inverse(experiments, drive, options, roles)
    drive = with_friction_that_holds(with_frictions(drive, roles, options), experiments, options)
    requested, options = options, with_all_expanded(options, drive, experiments)
    default = default_free(drive, experiments, options.hold)
    free = shared_free_names(free_parameters(drive, default, options), drive, experiments)
    check_torque_scale(drive, free, roles, options.hold)
    if options.criterion == "frequency":
        from drivetool.identify.frequency import greybox_by_frequency

        return greybox_by_frequency(experiments, drive, free, options)
    task = Task(drive, free, roles, tuple(experiments), known_states(options.start, drive, free, roles))
    outcome, outlier_findings = without_outliers(fit_with_friction_split(task, options, requested, [{}]))
    white, lower_limits = uncrossed_gaps(with_dry_friction_freed(
        with_identified_friction(outcome, drive, options, requested), requested))
    chosen_fit = default_fit(white, options, bool(lower_limits))
    explanation, outcome = chosen_fit.explanation, chosen_fit.outcome
    figures, findings = ({}, list(explanation.findings)) if explanation else both_criteria(outcome, options)
    lacks_law = explanation.lacks_law if explanation else bool(findings)
    worthless = explanation is not None and explanation.torque_explains_nothing
    explained_well = explanation is not None and not worthless
    found = explanation.own.drive if explained_well else outcome.drive
    findings = [*torque_timing(white), *outlier_findings, *suspect_channel_findings(task, found, explained_well),
                *findings]
    figures["noise_parameters"] = 0 if outcome.fit is None else outcome.fit.noise.parameters
    failed = not_converged(outcome)
    untested = (drive.shafts and not has_gap(outcome.task) and not can_be_tested(*chosen_fit.rivals[:2]))

    def model_lacks(estimate: Estimate) -> Verdict:
        """What the model may lack: a held value that is wrong, or a gap for which no fit was tried."""
        if not (estimate.repeats or failed or lacks_law):
            return Verdict()
        return Verdict((*contradicted_held_values(task, white, options, requested),
                        *(opened_gap_findings(outcome.fitted, "the fitted model has none") if untested else ())))

    return compose("greybox", drive, outcome, options, findings, {}, figures, explanation, alone=chosen_fit.alone,
                   checks=(
        lambda e: friction_of_file(e, outcome, options, free, explanation),
        model_lacks,
        *(partial(without_upper_limit, name=name, low=low) for name, low in lower_limits.items()),
        lambda _: Verdict(torque_in_feedback(failed or worthless, task)),
        lambda e: insignificant_shafts(e, shaft_gain(white)),
        lambda e: missing_structure(e, find_missing_structure(*chosen_fit.rivals) if drive.shafts else None)))


def _by_inverse(experiments: Sequence[Experiment], drive: Drive, options: Options, roles: Roles) -> Estimate:
    """The fit of the torque that the motion requires."""
    from drivetool.identify.inverse import greybox_by_inverse

    # The motion is known, so that the motor's friction is separately identifiable.
    drive = with_friction_parts(drive)
    default = default_free(drive, experiments, options.hold)
    free = free_parameters(drive, default, with_all_expanded(options, drive, experiments))
    free = shared_free_names(free, drive, experiments)
    if not nonlinear_behind_motor(drive, free):
        # Only one constant torque is identifiable, wherever it acts: the motor's, unless others are requested.
        behind = {name_of(b, "idle_torque") for b in drive.bodies[1:]} - set(options.free)
        free = tuple(n for n in free if n not in behind)
    return greybox_by_inverse(experiments, drive, free, roles, options)


def nonlinear_behind_motor(drive: Drive, free: Sequence[str]) -> bool:
    """Whether dry friction or a gap behind the first body distinguishes a torque there from one on that body."""
    return any(quantity_of(n) in ("coulomb", "half_gap") and owner_of(n) != drive.bodies[0]
               and (n in free or (drive.value(n) or 0.0) > 0.0) for n in drive.quantities)


def default_free(drive: Drive, experiments: Sequence[Experiment], hold: Sequence[str] = ()) -> tuple[str, ...]:
    """Inertias, shafts, friction sums, and Coulomb friction where the motion reverses.

    Where a drive turns one way, and starts or stops, Coulomb friction stands for the constant torques, unless it is
    to be held.

    A body that is clamped in every recording is not identifiable. Before a clamp a shaft's damping includes the
    viscous friction, and its twist a constant torque.
    """
    # A body that carries a mass: the mass is of interest, its own inertia is the small part.
    names = [name_of(b, 'carried_mass' if drive.value(name_of(b, 'carried_mass')) else 'inertia')
             for b in drive.bodies]
    for shaft in drive.shafts:
        names += [name_of(shaft, "stiffness"), name_of(shaft, "damping")]
    hidden = unidentified_by_clamps(drive, experiments)
    for total, suffix in () if hidden else TOTALS.items():
        parts = names_of(drive.bodies, suffix)
        names += [total] if total in drive.values and len(parts) > 1 else parts
    names = [n for n in names if owner_of(n) not in hidden]
    coulomb = [name_of(b, "coulomb") for b in drive.bodies if (drive.value(name_of(b, "coulomb")) or 0.0) > 0.0]
    coulomb = coulomb or [name_of(drive.bodies[0], "coulomb")]
    if reverses(experiments):
        return (*names, *coulomb)
    if starts_or_stops(experiments) and not set(coulomb) & set(hold):
        # Only their sum acts on the motion, and only Coulomb friction holds the drive at standstill.
        return (*(n for n in names if quantity_of(n) != "idle_torque"), *coulomb)
    return tuple(names)


def with_friction_that_holds(drive: Drive, experiments: Sequence[Experiment], options: Options) -> Drive:
    """The drive with given idle torques as Coulomb friction, where it turns one way, and starts or stops.

    A step at steady speeds cannot tell them apart, and names their sum an idle torque; that would move a drive that
    stands.
    """
    if reverses(experiments) or not starts_or_stops(experiments):
        return drive
    moved = {}
    for name in [*names_of(drive.bodies, "idle_torque"), "total.idle_torque"]:
        coulomb = name_of(drive.bodies[0] if name in TOTALS else owner_of(name), "coulomb")
        if drive.values.get(name) and not {name, coulomb} & {*options.hold, *options.free}:
            moved |= {name: 0.0, coulomb: moved.get(coulomb, drive.value(coulomb) or 0.0) + abs(drive.values[name])}
    return drive.with_values(moved)


def with_all_expanded(options: Options, drive: Drive, experiments: Sequence[Experiment]) -> Options:
    """The options with `--free all` expanded: everything a grey-box fit frees."""
    if ALL not in options.free:
        return options
    free = [n for n in options.free if n != ALL]
    free += [n for n in default_free(drive, experiments, options.hold) if n not in options.hold]
    return replace(options, free=tuple(dict.fromkeys(free)))


def free_parameters(drive: Drive, default: Sequence[str], options: Options) -> tuple[str, ...]:
    """The free parameters after --hold and --free, in the drive's order."""
    names = (set(default) | set(options.free)) - set(options.hold)
    for name in names:
        if choice := drive.quantity(name).choice:
            raise BadOption("numbers after --free", f"{name}, which is {' or '.join(f'{v:g}' for v in choice)}",
                            "Give its value with --set, or with --record.")
    return tuple(n for n in drive.quantities if n in names)


def with_dry_friction_freed(outcome: Outcome, options: Options) -> Outcome:
    """Free the Coulomb friction that was given, where the record contradicts its value.

    A drive that only stops, or hardly turns back, may identify it too; one that never stops does not.
    """
    drive = outcome.task.drive
    names = {n for n in names_of(drive.bodies, "coulomb") if (drive.value(n) or 0.0) > 0.0}
    names -= {*outcome.task.free, *options.hold}
    if not names or outcome.fit is None:
        return outcome
    trial = refit(outcome.fitted.with_free({*outcome.task.free, *names}), outcome.fit.noise)
    return trial if trial.fit.value < outcome.fit.value - MIN_DRY_FRICTION_GAIN else outcome


def both_criteria(outcome: Outcome, options: Options) -> tuple[dict[str, float], list[Finding]]:
    """Simulated fit of both criteria on the held-out end of the records, and the finding.

    Each criterion is fitted to the first part of every record and simulated over the rest.
    """
    task = outcome.fitted
    train = [e.between(0.0, (1.0 - HELD_OUT_SHARE) * e.size * e.step) for e in task.experiments]
    rest = [e.between((1.0 - HELD_OUT_SHARE) * e.size * e.step, e.size * e.step) for e in task.experiments]

    def held_out_fit(fitted: Callable[[Task], Outcome]) -> float:
        """Fit of free runs over the held-out data."""
        point = fitted(replace(task, experiments=tuple(train))).solution.point
        problem, _, runs = free_run(replace(task.at_point(point), experiments=tuple(rest), start={}))
        y = np.concatenate([t.outputs[:, 0] for t in problem.traces])
        return fit_percent(y, np.concatenate([r[:, 0] for r in runs]))

    ways = {"innovations": lambda t: with_coloured_noise(
                by_innovations(t, [{}]) if outcome.fit is None else refit(t, outcome.fit.noise)),
            "simulation": lambda t: by_simulation(t, segment_of(options), [{}], near_optimum=True)}
    try:
        with ThreadPoolExecutor(len(ways)) as pool:
            found = list(pool.map(held_out_fit, ways.values()))
    except DriveToolError:
        return {}, []
    figures = {f"held_out_simulation_fit_percent_by_{name}": value for name, value in zip(ways, found, strict=True)}
    a, b = found
    # Clearly better: by a tenth of the residual of the innovations fit, and by two points.
    if b > a + max(2.0, 0.1 * (100.0 - a)):
        return figures, [Finding(
            "warning", "model-error",
            f"The fit by simulation explains {b:.1f} % of the held-out motion, the fit by one-step prediction "
            f"{a:.1f} %. The model lacks a physical effect, for which the noise model compensates.",
            figures, "Run diagnose; the intervals are conditional on the structure.")]
    return figures, []


def torque_in_feedback(failed: bool, task: Task) -> list[Finding]:
    """A note for a simulation that failed where the torque depends on the motion: inverse dynamics may succeed.

    failed  whether the fit that simulates the motion did not converge, or explains nothing
    """
    if not failed or not feedback_in(task.experiments, task.roles.outputs[0]).significant:
        return []
    return [Finding(
        "note", "torque-in-feedback",
        "The torque depends on the motion (feedback), and the simulation fit failed. Where the motion is imposed "
        "or well known, a fit of the torque (inverse dynamics) is better.", {}, "Try --criterion inverse.")]
