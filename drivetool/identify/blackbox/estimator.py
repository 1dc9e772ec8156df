"""Black box: start values of inertias, stiffness and damping from a gap-free record.

The thesis fits a discrete transfer function and converts it. Here the continuous-time one is fitted
itself, by the innovations fit of every other step: it needs no conversion from discrete time, works on
a short noisy record, and holds in closed loop, where output error and ARX do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivetool.drive import Drive
from drivetool.drive.simulation import Trace
from drivetool.errors import BadOption, BadRecording, NotEnoughData
from drivetool.identify.blackbox.blackbox_result import PhysicalModel, estimate_of, with_fixed_parameters
from drivetool.identify.blackbox.blackbox_start import StartRegression, mean_speed, start_points
from drivetool.identify.blackbox.shaft_torque_fit import with_shaft_torque
from drivetool.identify.blackbox.transfer import ONE_BODY, VISCOUS, TransferForm, form_of
from drivetool.identify.channels import torque_timing
from drivetool.identify.estimate import Estimate
from drivetool.identify.fit import with_coloured_noise
from drivetool.identify.greybox import ALL
from drivetool.identify.noise import fit_innovations, refit_with_tight_tolerance
from drivetool.identify.problem import MIN_SPARE_SAMPLES, Point, Problem, solve
from drivetool.identify.setup import (
    Options,
    Outcome,
    Roles,
    Task,
    at_rates,
    both_outputs,
    refuse_other_free,
    refuse_transmission_loss,
    roles_of,
    traces_of,
)
from drivetool.identify.starts import attempt_or_none, without_failed
from drivetool.logs import Experiment
from drivetool.logs.samples import without_unmeasured
from drivetool.quantity import name_of, names_of

# Of the grid's best points. A choice: the likelihood has local optima, and each start costs a fit.
DEFAULT_STARTS = 3


def blackbox(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """Inertias, stiffness and damping by a transfer function and its closed-form conversion.

    experiments  motor_torque and motor_speed, or motor_angle, while the gap stays closed: torque steps
                 upward from a constant speed. Fitted together
    drive        one or two bodies; the friction it knows (from steady) is kept
    options      hold, free (the viscous friction), criterion, segment, starts, known
    returns      Estimate of inertias, shaft.stiffness, shaft.damping; of viscous friction and idle
                 torque where the drive has none. details: poles, coefficients, the conversion error
    raises       BadOption: three bodies, or nothing that can be freed; NotEnoughData: too short a
                 record, or a torque that never changes
    source       Tallfors 2005, sec. 5.3 and 6.3
    """
    if options.structure is not None:
        from drivetool.identify.polynomial import polynomial_blackbox

        return polynomial_blackbox(experiments, drive, options)
    if options.criterion == "frequency":
        raise BadOption("a polynomial structure for a fit in the frequency domain", "none", "Add --structure oe.")
    form, white = transfer_function(experiments, drive, options)
    gain = np.inf
    with np.errstate(over="ignore", invalid="ignore"):
        if form.order > 1:
            stiff = replace(form, names=ONE_BODY + form.names[6:])
            gain = minus_log_likelihood_of(_fit(white.task, stiff, options)) - minus_log_likelihood_of(white)
        outcome = with_coloured_noise(white)
        timing = torque_timing(white)
    estimate = estimate_of(PhysicalModel(form, drive, options), outcome, gain)
    if (roles := both_outputs(white.task.experiments, drive)) is not None:
        estimate = with_shaft_torque(estimate, white.task.experiments, drive, roles, options)
    return replace(estimate, findings=(*timing, *estimate.findings))


def transfer_function(
        experiments: Sequence[Experiment], drive: Drive, options: Options) -> tuple[TransferForm, Outcome]:
    """The transfer function of a drive of one or two bodies, and its fit in white noise; see blackbox."""
    _check_options(drive, options)
    experiments = at_rates("blackbox", experiments, options)
    task = Task(drive, (), _roles(experiments, drive), tuple(without_unmeasured(e) for e in experiments))
    form = _form(task, options)
    _check_samples(task, form)
    # A distant trial may make a frozen observer unstable: its cost overflows and it is rejected.
    with np.errstate(over="ignore", invalid="ignore"):
        return form, _fit(task, form, options)


def minus_log_likelihood_of(outcome: Outcome) -> float:
    """-log likelihood, whatever the criterion."""
    if outcome.fit is not None:
        return outcome.fit.value
    return 0.5 * outcome.problem.count * float(np.log(outcome.solution.cost))


def _check_options(drive: Drive, options: Options) -> None:
    """Refuse more than two bodies, a transmission loss, and options that a black box does not have."""
    if len(drive.bodies) > 2:
        raise BadOption(
            "a drive of one or two bodies for the black box", f"{drive.name} with {len(drive.bodies)}",
            "Its conversion exists for two masses only: use --structure oe, or give start values with --set and go "
            "on to greybox.")
    friction = "total.viscous" if drive.shafts else name_of(drive.bodies[0], "viscous")
    refuse_other_free("blackbox", options.free, (friction, ALL),
                      "The black box fits its own coefficients, and nothing else; free it in greybox.")
    drive.require(options.hold, "holding them (--hold)")
    refuse_transmission_loss(drive, (), "blackbox")


def _roles(experiments: Sequence[Experiment], drive: Drive) -> Roles:
    """Torques, and the one sensor at the motor."""
    roles = roles_of(experiments, drive)
    at_motor = [r for r in roles.outputs if r in ("motor_speed", "motor_angle")]
    if not at_motor:
        raise BadRecording("a motor speed or motor angle", f"only {', '.join(roles.outputs)}",
                           "Name its channel in the channel map.")
    return Roles(roles.inputs, (at_motor[0],))


def _form(task: Task, options: Options) -> TransferForm:
    """The model; its viscous friction is fitted unless it is known.

    Held at zero, as in the thesis, it would put the total inertia off by more than its interval.
    """
    drive = task.drive
    form = form_of(drive, task.roles.inputs, task.roles.outputs[0] == "motor_angle")
    names = ["total.viscous", *names_of(drive.bodies, "viscous")]
    freed = any(n in options.free for n in (*names, ALL))
    if freed or not any(n in drive.values or n in options.hold for n in names):
        return replace(form, names=(*form.names, VISCOUS))
    return form


def _check_samples(task: Task, form: TransferForm) -> None:
    """Refuse too few samples, and a record without motion."""
    traces = traces_of(task.experiments, task.roles)
    known = sum(int(np.isfinite(t.outputs).sum()) for t in traces)
    unknowns = len(form.names) + form.states * len(traces)
    if known < unknowns + MIN_SPARE_SAMPLES:
        raise NotEnoughData(f"at least {unknowns + MIN_SPARE_SAMPLES} samples for {unknowns} unknowns", f"{known}",
                            "Record longer.")
    if all(np.ptp(t.inputs[:, 0]) == 0.0 for t in traces):
        raise NotEnoughData("a motor torque that changes", "a constant one",
                            "Record torque steps upward from a constant speed.")
    if all(np.nanmax(t.outputs) == np.nanmin(t.outputs) for t in traces if np.isfinite(t.outputs).any()):
        role = task.roles.outputs[0].replace("_", " ")
        raise NotEnoughData(f"a {role} that changes", "a constant one",
                            "Check the channel, or whether the drive was blocked.")


def _fit(task: Task, form: TransferForm, options: Options) -> Outcome:
    """The model fitted from the best starts of the grid."""
    traces = traces_of(task.experiments, task.roles)
    if form.order == 1:
        found = [StartRegression(traces, form.angle).rigid()]
    else:
        found = start_points(traces, form.angle, max(1, options.starts or DEFAULT_STARTS))
    return _fit_from(task, form, options, [_without_known_friction(s.values, form, traces) for s in found])


def _without_known_friction(values: np.ndarray, form: TransferForm, traces: Sequence[Trace]) -> np.ndarray:
    """Start values without the friction, if that is known; the offset compensates for the difference."""
    if VISCOUS in form.names:
        return values
    change = np.zeros(len(values) - 1)
    change[-1] = (values[-1] - form.viscous) * mean_speed(traces, form.angle)
    return values[:-1] + change


def _fit_from(task: Task, form: TransferForm, options: Options, values: Sequence[np.ndarray]) -> Outcome:
    """The model fitted from several start values; the best fit is returned.

    A resonance far below the lowest frequency of the record is collinear with the rigid body, whose inertia may
    then have any size and sign. With a known friction it gives a pole at which the simulation may overflow: that
    start fails.
    """
    found = [attempt_or_none(lambda v=v: _fit_once(task, form, options, v)) for v in values]
    best = min(without_failed(found), key=minus_log_likelihood_of)
    tried = tuple({**dict(zip(form.names, map(float, v), strict=True)),
                   "minus_log_likelihood_above_best":
                       float(minus_log_likelihood_of(o) - minus_log_likelihood_of(best))}
                  for v, o in zip(values, found, strict=True) if o is not None)
    if best.fit is not None:
        fit = refit_with_tight_tolerance(best.problem, best.fit)
        best = replace(best, solution=fit.solution, fit=fit)
    return replace(best, starts=tried)


def _fit_once(task: Task, form: TransferForm, options: Options, values: np.ndarray) -> Outcome:
    """One fit, by the criterion of the options."""
    simulation = options.criterion == "simulation"
    problem = problem_of(task, form, values, (options.segment or 0.0) if simulation else 0.0)
    rest = tuple(form.rest(t) for t in problem.traces)
    states = solve(with_fixed_parameters(problem, values), Point(np.empty(0), rest), max_iterations=10).point.starts
    point = Point(values, states)
    if simulation:
        solution = solve(problem, point, relative=1e-10, max_iterations=100)
        return Outcome(task, problem, solution, None, (), solution.converged)
    # Simulation error first: from a residual with drift instead of noise, the noise estimate diverges.
    fit = fit_innovations(problem, solve(problem, point, relative=1e-4, max_iterations=20).point)
    return Outcome(task, problem, fit.solution, fit, (), fit.converged)


def problem_of(task: Task, form: TransferForm, values: np.ndarray, segment: float = 0.0) -> Problem:
    """The least-squares problem around start values, from which its sizes follow."""
    traces = traces_of(task.experiments, task.roles, segment)
    v = dict(zip(form.names, np.abs(values), strict=True))
    fast = np.sqrt(v.get("a1", 0.0))
    inertia = 1.0 / max(v["b"] if form.order == 1 else v["b0"] / v["a1"], 1e-12)
    longest = max(t.size * t.step for t in traces)
    first = v.get("b2", v.get("b"))
    sizes = {"b2": 0.1 * first, "b": 0.1 * first, "b1": fast * first, "b0": 0.1 * v.get("b0", 0.0),
             "a2": 0.2 * fast, "a1": 0.0, VISCOUS: inertia / longest,
             "offset": max(float(np.abs(t.inputs[:, 0]).max()) for t in traces)}
    # By noise an oscillation may appear to grow, but not so fast that the simulation overflows.
    lows = {"a2": -min(0.4 * fast, 20.0 / longest), "a1": 1e-6 * fast**2, VISCOUS: 0.0}
    highs = {"a1": (np.pi / min(t.step for t in traces)) ** 2}
    low, high, size = (np.array([known.get(n, other) for n in form.names])
                       for known, other in ((lows, -np.inf), (highs, np.inf), (sizes, 0.0)))
    return Problem(form.build, form.names, low, high, size, traces, np.arange(form.states), np.ones(1),
                   step=min(t.step for t in traces))
