"""Friction from running at constant speeds, constant torques, or down: the first step of the identification."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import BadOption, NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.coast_down import Stretch, find_coast_downs
from drivetool.identify.estimate import Covariance, Estimate, Parameter, estimate_from_fit, held_line, in_order
from drivetool.identify.plateaus import (
    LINE_KEYS,
    FrictionLine,
    LineTask,
    SteadyInterval,
    SteadyPoints,
    coulomb_body_findings,
    find_intervals,
    fit_line,
    line_findings,
    line_parameter,
    make_points,
    mean_variances,
    point_list,
    refuse_scatter,
    steady_plots,
)
from drivetool.identify.setup import (
    Options,
    at_rates,
    refuse_free_torque_constants,
    refuse_other_free,
    refuse_transmission_loss,
)
from drivetool.logs import Experiment
from drivetool.quantity import name_of, names_of, owner_of, quantity_of

DRAG_ADVICE = "free the drag of one body that turns as fast as the motor."


def steady(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """Viscous friction, idle torque and Coulomb friction from steady intervals.

    The intervals are found by the statistic of Cao & Rhinehart (plateaus/state.py). Each gives a point:
    mean torque and mean speed, with a variance from batch means. A weighted line through the points,
    T = c w + T0 + Tc sgn(w), gives the friction of the whole drive; with a shaft torque in all the
    recordings of a two-mass drive, one line per body: Tm - Ts over wm and Ts over wl. A free drag, of a fan or a
    pump, adds c2 w |w|.
    Intervals of 95 % are Student's t; the noise is averaged from the batches and from the scatter about
    the line. If the points scatter more than the noise explains (at 1 %), the scatter alone counts.

    experiments  motor_torque and motor_speed or motor_angle; optional shaft_torque, load_speed
    drive        start values; names in options.hold keep theirs, a drag unless options.free has it
    returns      Estimate of motor.viscous, motor.idle_torque, motor.coulomb of a one-body drive; of
                 total.viscous, total.idle_torque, motor.coulomb with more bodies; of both bodies' own
                 with a shaft torque
    raises       NotEnoughData: no steady interval, only standstill, or torques that are on no line
    source       Tallfors 2005, sec. 5.4 and 6.4; Cao & Rhinehart 1995
    """
    for name in options.hold:
        drive.quantity(name)
    refuse_free_torque_constants(options.free)
    if options.method != "coast-down" or drive.shafts:  # that of one body simulates it
        refuse_transmission_loss(drive, options.free, "steady")
    _check_options(drive, options)
    if options.method == "acceleration":
        from drivetool.identify.acceleration import acceleration

        return acceleration(at_rates("steady", experiments, options), drive, options)
    experiments = at_rates("steady", experiments, options)
    if options.method == "coast-down" or not any(_has_torque(e) for e in experiments):
        return _coast_down(experiments, drive, options)
    coast_downs = find_coast_downs(experiments)
    intervals = [i for experiment in experiments for i in find_intervals(experiment)
                 if not any(_overlaps_coast_down(i, s, experiments[s.recording]) for s in coast_downs)]
    if not intervals:
        raise NotEnoughData(
            "intervals of constant speed and torque", f"none in {', '.join(e.name for e in experiments)}",
            "Record with the speed controller on, and hold each of several speeds until the torque settles. Where "
            "a drive accelerates at constant torque, and coasts, take --method acceleration; where it "
            "runs down without torque, --method coast-down.")
    tasks = _line_tasks(intervals, drive, options)
    refuse_other_free("steady", options.free, [*names_of(drive.bodies, "drag"), *(
        name for task in tasks for name in task.names.values() if name is not None)])
    results = []
    for task in tasks:
        points = make_points(intervals, task.torque, task.speed)
        if points is None:
            raise NotEnoughData("intervals at a speed other than zero", "only standstill",
                                "At standstill, static friction masks all other friction; run at several speeds.")
        results.append((task, points, fit_line(points, task.held, task.start, task.carried)))
        refuse_scatter(*results[-1][1:], task.what)
    return _steady_estimate(experiments, drive, options, intervals, results)


def _check_options(drive: Drive, options: Options) -> None:
    """Refuse options of no method of this step, and those of a coast-down where it was not requested."""
    start = options.start
    if start.rest or start.states or start.records or any(drive.value(name_of(b, "clamped")) for b in drive.bodies):
        raise BadOption("no start state and no clamp in steady", "one of them",
                        "Leave it out: the start of every stretch is fitted.")
    for option, requested in (("--flux-decay", options.flux_decay is not None), ("--stages", bool(options.stages))):
        if requested and options.method != "coast-down":
            raise BadOption(f"--method coast-down with {option}", f"--method {options.method}",
                            f"Add --method coast-down, or leave out {option}.")


def _overlaps_coast_down(interval: SteadyInterval, stretch: Stretch, experiment: Experiment) -> bool:
    """Whether an interval is part of a coast-down: a quantised speed may be constant for a while."""
    begin, end = (experiment.offset + k * experiment.step for k in (stretch.first, stretch.last))
    return interval.file == experiment.name and interval.start < end and interval.end > begin


def _coast_down(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """The estimate of a coast-down, with a finding where it was not requested."""
    from drivetool.identify.coast_down import coast_down

    found = coast_down(experiments, drive, options)
    if options.method == "coast-down":
        return found
    return replace(found, findings=(Finding(
        "note", "coast-down-assumed", "Taken as a coast-down: no torque other than zero is logged, and the "
        "speed decreases.", {}, "Use --method coast-down, or record constant speeds under torque."),
        *found.findings))


def _has_torque(experiment: Experiment) -> bool:
    """Whether a torque was logged that is not zero throughout."""
    return bool(np.nanmax(np.abs(experiment.signals.get("motor_torque", np.zeros(1))), initial=0.0) > 0.0)


def _line_tasks(intervals: Sequence[SteadyInterval], drive: Drive, options: Options) -> list[LineTask]:
    """The lines to fit, from what was measured and what is held."""
    split = len(drive.bodies) == 2 and all("shaft_torque" in i.signals for i in intervals)
    if not split:
        return [_line_task("motor_torque", "motor_speed", None, drive, options)]
    # At a steady speed the shaft turns with the motor, so the motor's speed will do for the load.
    ratio = drive.value(name_of(drive.shafts[0], "ratio"))
    load = "load_speed" if all("load_speed" in i.signals for i in intervals) else "motor_speed"
    if ratio != 1.0:
        raise BadOption("a direct shaft to use its torque", f"a ratio of {ratio:g}",
                        "Leave shaft_torque out of the channel map, or refer it to the motor and drop "
                        "the ratio.")
    return [_line_task("difference", "motor_speed", drive.bodies[0], drive, options),
            _line_task("shaft_torque", load, drive.bodies[1], drive, options)]


def _line_task(torque: str, speed: str, body: str | None, drive: Drive, options: Options) -> LineTask:
    """Names, held and start values of one line; body None: of all bodies together."""
    names, held, start, carried = {}, {}, {}, {}
    bodies = drive.bodies if body is None else (body,)
    hold = {*options.hold, *(n for n in names_of(bodies, "drag") if n not in options.free)}
    for key in LINE_KEYS:
        total = f"total.{key}"
        parts = names_of(bodies, key)
        free_parts = [part for part in parts if part not in hold]
        known = any(part in drive.values for part in parts)
        value = drive.values.get(total) if body is None and total in drive.values else \
            _referred_to_motor(drive, key, bodies) if known else None
        if (body is None and total in hold) or not free_parts:
            names[key], held[key] = None, value or 0.0
            continue
        carried[key] = _referred_to_motor(drive, key, [b for b in bodies if name_of(b, key) in hold])
        if key == "coulomb" or len(free_parts) == 1:
            names[key] = free_parts[0]
            owner = owner_of(free_parts[0])
            if drive.gear_ratios()[drive.bodies.index(owner)] != 1.0:
                raise BadOption(f"the friction of {drive.bodies[0]} free in a drive with a gear",
                                f"only {free_parts[0]} free",
                                "The line is referred to the motor; "
                                f"{DRAG_ADVICE if key == 'drag' else f'hold total.{key}, or none of its parts.'}")
        elif len(free_parts) == len(parts) and key != "drag":
            names[key] = total
        else:
            raise BadOption(f"{key.replace('_', ' ')} held for all bodies but one, or for none",
                            f"free for {', '.join(free_parts)}", "At a steady speed only the sum is identifiable; "
                            f"{DRAG_ADVICE if key == 'drag' else 'hold more of them, or none.'}")
        if value is not None:
            start[key] = value - carried[key]
    return LineTask(torque, speed, body, names, held, start, carried)


def _referred_to_motor(drive: Drive, key: str, bodies: Sequence[str]) -> float:
    """Sum of one part of the line over bodies, referred to the motor."""
    if key != "drag":
        return drive.referred_to_motor(key, bodies)
    ratios = zip(drive.bodies, drive.gear_ratios(), strict=True)
    return float(sum((drive.value(name_of(b, key)) or 0.0) / n**3 for b, n in ratios if b in bodies))


def _steady_estimate(experiments: Sequence[Experiment], drive: Drive, options: Options,
                     intervals: Sequence[SteadyInterval],
                     results: Sequence[tuple[LineTask, SteadyPoints, FrictionLine]]) -> Estimate:
    """Parameters, findings, pictures and the drive with its new values."""
    parameters: list[Parameter] = []
    findings: list[Finding] = []
    for task, points, line in results:
        parameters += [line_parameter(name, key, task, points, line, drive)
                       for key, name in task.names.items() if name is not None]
        findings += line_findings(task, points, line, drive, len(intervals))
    values = {p.name: p.value for p in parameters}
    task, points, _ = results[0]
    if task.body is None and task.names["coulomb"] is not None:
        # One body stands for all; the values of the others would count twice.
        values |= {name: 0.0 for name in names_of(drive.bodies, "coulomb")
                   if drive.values.get(name) and name not in (task.names["coulomb"], *options.hold)}
        findings += coulomb_body_findings(task, drive)
    findings += _magnitude_findings(experiments)
    parameters += [held_line(drive, name, "held by --hold") for name in drive.quantities
                   if name in options.hold and quantity_of(name) in LINE_KEYS]
    rmse = float(np.sqrt(np.mean([line.rmse**2 for *_, line in results])))
    levels = len(set(points.levels))
    where = "both directions" if len(set(np.sign(points.speed))) == 2 else "one direction"
    return estimate_from_fit(
        "steady", experiments, drive.with_values(values), in_order(parameters, drive), _joint_covariance(results),
        outcome=f"{len(points.speed)} steady intervals at {levels} speed{'s' if levels > 1 else ''} in "
                f"{where}, {rmse:.3g} {drive.torque_unit} rms residual.",
        fit={"simulation_fit_percent": None, "one_step_fit_percent": None, "rmse": rmse,
             "n": sum(len(i.signals["motor_torque"]) for i in points.intervals),
             "intervals": len(points.speed), "levels": levels,
             "chi2": sum(line.chi2 for *_, line in results),
             "chi2_dof": sum(line.dof for *_, line in results)},
        details={"points": [p for task, points, _ in results for p in point_list(task, points)]},
        findings=findings, exhibits=steady_plots(experiments, results, drive))


def _magnitude_findings(experiments: Sequence[Experiment]) -> list[Finding]:
    """The finding on a torque without its sign: friction and load may be exchanged."""
    names = [e.name for e in experiments if e.magnitudes]
    if not names:
        return []
    return [Finding(
        "warning", "torque-unsigned",
        f"The torque of {', '.join(names)} is a magnitude; it was given the sign of the motion. If the load "
        "torque exceeds the friction and drives the motor, load torque and friction are exchanged.",
        {"recordings": len(names)},
        "Log the torque with its sign if a load acts.")]


def _joint_covariance(results: Sequence[tuple[LineTask, SteadyPoints, FrictionLine]]) -> Covariance:
    """Covariance of everything that was fitted; two lines share the noise of the shaft torque."""
    names = tuple(str(task.names[key]) for task, _, line in results for key in line.free)
    matrix = results[0][2].covariance
    if len(results) == 2:
        (_, points_a, a), (_, points_b, b) = results
        shared = a.inflation * b.inflation * _shared_variance(points_a, points_b)
        cross = (a.weights * shared) @ b.weights.T
        matrix = np.block([[a.covariance, cross], [cross.T, b.covariance]])
    return Covariance(names, matrix)


def _shared_variance(a: SteadyPoints, b: SteadyPoints) -> np.ndarray:
    """(k,) covariance of the means of motor less shaft torque, and shaft torque, of the same intervals."""
    first = [i.signals["difference"] for i in a.intervals]
    second = [i.signals["shaft_torque"] for i in b.intervals]
    steps = [i.step for i in a.intervals]
    sum_variance = mean_variances([x + y for x, y in zip(first, second, strict=True)], steps)[0]
    difference_variance = mean_variances([x - y for x, y in zip(first, second, strict=True)], steps)[0]
    # It is estimated separately from the variances, and could come out larger than they allow.
    bound = 0.99 * np.sqrt(a.variance * b.variance)
    return np.clip((sum_variance - difference_variance) / 4, -bound, bound)
