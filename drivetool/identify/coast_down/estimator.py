"""Friction and inertia of a drive that coasts down without torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy

from drivetool.drive import Drive, one_body
from drivetool.drive.effects import EFFECT as INDUCTION, mean_torque
from drivetool.errors import BadOption, NotEnoughData
from drivetool.identify.acceleration import RigidDrive, as_drive_parameters, held_value, rigid_of
from drivetool.identify.coast_down.coast_down_fit import NO_PRIOR, CoastDownFit, Prior, Run, fit, run_of
from drivetool.identify.coast_down.laws import MISFIT_SIGNIFICANCE, AdditionalFrictionLaw, further_law, start_drives
from drivetool.identify.coast_down.report import (
    INERTIA,
    MAX_STD_TO_VALUE,
    CoastDownScatter,
    coast_down_findings,
    coast_down_plots,
    fit_figures,
    no_load_speed,
    outcome_text,
    ratio_covariance,
    ratio_lines,
    scatter_between_runs,
    unidentified,
)
from drivetool.identify.coast_down.stages import JointFit, fit_in_stages
from drivetool.identify.coast_down.stretches import Stretch, stretches_of
from drivetool.identify.estimate import (
    Covariance,
    Estimate,
    Parameter,
    Verdict,
    estimate_from_fit,
    held_line,
    line_of,
    masked,
)
from drivetool.identify.setup import Options, fed_by_voltages
from drivetool.logs import Experiment
from drivetool.quantity import name_of, quantity_of, record_of

FRICTION = ("motor.viscous", "motor.coulomb", "motor.idle_torque")
FLUX_TIME_CONSTANTS = 3.0  # time constants of the rotor's flux, after which 5 % of it is left: exp(-3)
UNEXPLAINED_TEXT = "no tested friction law explains the residual"
ADDED_INERTIA_TEXT = "a known added inertia"
# Of a coast-down, whose mean speeds give start values. A choice: they average counts and keep the shape.
MEAN_SPEED_PARTS = 40


def coast_down(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """Ratios of friction to inertia from coasting down without torque; friction and inertia with a known scale.

    J dw/dt = T - T0 - B w - Tc sgn(w), with the further laws of options.free, is simulated and compared with
    counts, an angle or a speed by least squares. Without a torque everything may be multiplied by one factor:
    then only ratios have intervals. A stretch under torque, a known added inertia, or a friction or an inertia that
    is held or has an interval in a parameter file fixes the factor.

    experiments  motor_angle or motor_speed; motor_torque where it was logged, else the drive is assumed to coast
                 down from its highest speed on. For an induction motor the voltages of its supply suffice
    drive        start values; values that are held
    options      flux_decay: time after switching off that is left out [s]; None: from the flux of a known motor
    returns      Estimate of inertia, viscous and Coulomb friction, in both directions of the idle torque
    raises       NotEnoughData: no coast-down, or an added inertia changes nothing; BadRecording: counts; BadOption
    source       "Mechanical Parameter Estimation of an Induction Motor for a Digital Twin Using Coast-Down Data"
    """
    stretches = stretches_of(experiments, flux_decay(drive) if options.flux_decay is None else options.flux_decay)
    runs = [run_of(experiments[s.recording], s) for s in stretches]
    several = len(drive.bodies) > 1
    rigid = rigid_of(drive, replace(options, free=())) if several else None
    names = dict(rigid.names) if rigid else {n: n for n in (INERTIA, *FRICTION)}
    if several:
        _refuse_for_several(options)
    held = {n for n, whole in names.items() if whole in options.hold}
    own = _one_body(drive, rigid, held) if rigid else drive
    both = len({_direction(r) for r in runs}) == 2
    fitted_by = {v: k for k, v in names.items() if k not in held and (k != FRICTION[2] or both)}
    prior = _prior(own, options.known, fitted_by)
    scale = _scales(own, stretches, held, prior, options.free)
    start = _with_start_values(own, runs, stretches, scale, held)
    free = [n for n in (INERTIA, *FRICTION)
            if n not in held and (n != FRICTION[2] or both) and (n != INERTIA or scale)]
    free += [n for n in options.free if n not in free and n != "all"]
    fitted, spread = _fit_with_scatter(start, free, runs, stretches, prior)
    _check_scale(start, fitted, scale)
    ended = start.with_values(fitted.found)
    tested, further = _law_test(ended, runs, prior, fitted, spread.first)
    lines = _parameter_lines(own, ended, free, fitted, scale, held, both)
    unexplained = max(tested.misfit, further.misfit if further else 0.0) < MISFIT_SIGNIFICANCE
    values = {p.name: p.value for p in lines if np.isfinite(p.value)}
    result = estimate_from_fit(
        "steady", experiments, own.with_values(values), lines, Covariance(fitted.names, fitted.covariance),
        outcome=outcome_text(stretches, experiments, scale), fit=fit_figures(fitted, stretches),
        details={"scale": list(scale), "spans": _stretch_details(stretches, experiments),
                 "sensor": _sensor_details(fitted)} | (
            {} if scale or unexplained else {"ratio_covariance": ratio_covariance(ended, free, fitted)}),
        findings=coast_down_findings(fitted, tested, stretches, experiments, scale, spread, further, held),
        exhibits=coast_down_plots(experiments, stretches, fitted, ended),
        ratios=[p.without_interval(UNEXPLAINED_TEXT) if unexplained else p for p in (
            *ratio_lines(ended, free, fitted), *no_load_speed(ended, free, fitted, runs))],
        checks=[lambda e: Verdict(lines=masked(e, UNEXPLAINED_TEXT, None) if unexplained else ())])
    if options.stages:
        joint = JointFit(experiments, stretches, runs, tuple(start_drives(start, free)), ended, fitted, prior,
                      own.values if scale else {})
        return fit_in_stages(result, joint, options.stages)
    if rigid is None or scale:
        return result if rigid is None else as_drive_parameters(result, drive, rigid)
    lines = tuple(p.replace(name=names[p.name], unit=drive.unit(names[p.name])) for p in result.parameters)
    return replace(result, drive=drive, parameters=lines)


def _refuse_for_several(options: Options) -> None:
    """Refuse options that only a drive of one body has."""
    if options.free or options.stages:
        raise BadOption("no --free and no --stages for a coast-down of several bodies",
                        f"--free {options.free[0]}" if options.free else "--stages",
                        "They coast down as one: give --drive one-body.")


def _fit_with_scatter(start: Drive, free: Sequence[str], runs: Sequence[Run], stretches: Sequence[Stretch],
            prior: Prior) -> tuple[CoastDownFit, CoastDownScatter]:
    """The likeliest fit of all starts, with the scatter between coast-downs in its covariance, and that scatter."""
    fitted = min((fit(each, free, runs, prior) for each in start_drives(start, free)), key=lambda f: f.deviance)
    spread = scatter_between_runs(start, free, runs, stretches, fitted)
    if spread.changes:  # the residuals of the joint fit contain the differences
        fitted = replace(fitted, covariance=fitted.white + spread.added)
    return fitted, spread


def flux_decay(drive: Drive) -> float:
    """Time after switching off until 5 % of the rotor's flux is left [s]; 0 where no motor is known."""
    if not fed_by_voltages(drive):
        return 0.0
    side = 0.5 * drive.value("motor.leakage_inductance") + drive.value("motor.magnetizing_inductance")
    return FLUX_TIME_CONSTANTS * side / drive.value("motor.rotor_resistance")


def _one_body(drive: Drive, rigid: RigidDrive, held: set[str]) -> Drive:
    """The whole drive as one body, with its known values."""
    known = {n: drive.values[whole] for n, whole in rigid.names.items() if n != INERTIA and whole in drive.values}
    return one_body(drive.torque_unit, drive.motion_unit).with_values(
        known | {n: held_value(n, drive, rigid) for n in held})


def _prior(drive: Drive, known: Covariance | None, own: Mapping[str, str]) -> Prior:
    """The prior of inertia and friction from parameter files; own: their names there -> those of one body."""
    found = known and known.part(n for n in known.names if n in own and drive.values.get(own[n]) is not None)
    if found is None:
        return NO_PRIOR
    names = tuple(own[n] for n in found.names)
    return Prior(names, np.array([drive.values[n] for n in names]), found.matrix)


def _scales(drive: Drive, stretches: Sequence[Stretch], held: set[str], prior: Prior,
            free: Sequence[str]) -> tuple[str, ...]:
    """What gives the scale between accelerations and torques, in words; none: it is not known.

    An added inertia that is fitted itself gives none.
    """
    torque = "a stretch under supply" if fed_by_voltages(drive) else "a stretch under torque"
    by = [torque] if any(not s.off for s in stretches) else []
    added = [v for n, v in drive.values.items() if quantity_of(n) == "added_inertia" and record_of(n)
             and n not in free]
    by += [ADDED_INERTIA_TEXT] if any(added) else []
    by += [f"{n} as held" for n in sorted(held) if drive.value(n)]
    return (*by, *(f"{n} by its file" for n in prior.names))


def _law_test(ended: Drive, runs: Sequence[Run], prior: Prior, fitted: CoastDownFit,
            first: tuple[Run, CoastDownFit] | None) -> tuple[CoastDownFit, AdditionalFrictionLaw | None]:
    """(fit by which the friction law is tested, missing law); from the first coast-down alone where they differ.

    A misfit under torque may be an error of the torque: only coast-downs test the friction.
    """
    if first is not None:
        run, fitted = first
        ended, runs, prior = ended.with_values(fitted.found), [run], NO_PRIOR
    elif fitted.misfit < MISFIT_SIGNIFICANCE and any(r.inputs.any() for r in runs):
        runs, prior = [r for r in runs if not r.inputs.any()], NO_PRIOR
        fitted = fit(ended, [n for n in fitted.names if n != INERTIA], runs, prior)
        ended = ended.with_values(fitted.found)
    if fitted.misfit >= MISFIT_SIGNIFICANCE:
        return fitted, None
    # The likelihoods of laws are compared by the long-run variance of the noise, which white noise underestimates.
    weighted = [replace(run, reading=replace(run.reading, std=np.sqrt(v) * run.reading.std))
                for run, v in zip(runs, fitted.long_run_variances, strict=True)]
    base = fitted if all(r.count for r in fitted.readings) else fit(ended, fitted.names, weighted, prior)
    return fitted, further_law(ended.with_values(base.found), fitted.names, weighted, prior, base)


def _check_scale(drive: Drive, fitted: CoastDownFit, scale: Sequence[str]) -> None:
    """Refuse an added inertia as the only scale if it changes nothing: the drive's own would be unbounded."""
    if INERTIA not in fitted.names or scale != (ADDED_INERTIA_TEXT,):
        return
    value = fitted.found[INERTIA]
    if not fitted.std(INERTIA) < MAX_STD_TO_VALUE * value:
        names = [record_of(n) for n, v in drive.values.items() if v
                 and quantity_of(n) == "added_inertia" and record_of(n)]
        raise NotEnoughData(
            "a lower deceleration in the coast-down with the added inertia",
            f"{', '.join(names)}, with no significant change of the deceleration",
            "Check that the inertia was mounted and that --record names its recording; record again with one about "
            "as large as the drive's own.")


def _with_start_values(drive: Drive, runs: Sequence[Run], stretches: Sequence[Stretch], scale: Sequence[str],
             held: set[str]) -> Drive:
    """Start values: ratios from mean speeds of the coast-downs, and an inertia where there is a scale."""
    rates = _initial_ratios([r for r, s in zip(runs, stretches, strict=True) if s.off])
    inertia = (drive.value(INERTIA) or _first_inertia(runs, stretches, rates, drive)) if scale else 1.0
    found = {INERTIA: inertia, FRICTION[0]: inertia * rates[0], FRICTION[1]: inertia * rates[1], FRICTION[2]: 0.0}
    if scale:
        found |= {n: drive.value(n) or 0.0 for n in held}
    return drive.with_values(found)


def _initial_ratios(runs: Sequence[Run]) -> np.ndarray:
    """(2,) viscous and Coulomb friction over the inertia, not negative."""
    rows, rates = [], []
    for run in runs:
        speed, rate = _speeds_and_rates(run)
        rows.append(np.column_stack([np.abs(speed), np.ones(len(speed))]))
        rates.append(-np.sign(speed) * rate)
    found = scipy.optimize.nnls(np.concatenate(rows), np.concatenate(rates))[0]
    return np.maximum(found, 1e-3 * np.abs(np.concatenate(rates)).max() / np.concatenate(rows).max(axis=0))


def _speeds_and_rates(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """(mean speeds, accelerations) between the parts of a run."""
    r = run.reading
    at = r.known
    ends = np.unique(at[np.linspace(0, len(at) - 1, min(MEAN_SPEED_PARTS, len(at) // 2) + 1).round().astype(int)])
    time = ends * r.step
    middle = 0.5 * (time[1:] + time[:-1])
    if r.role == "motor_angle":
        speed = np.diff(r.values[ends]) / np.diff(time)
    else:
        speed = np.array([np.nanmean(r.values[a:b]) for a, b in pairwise(ends)])
    moves = np.abs(speed) > 0.0
    speed, middle = speed[moves], middle[moves]
    return 0.5 * (speed[1:] + speed[:-1]), np.diff(speed) / np.diff(middle)


def _first_inertia(runs: Sequence[Run], stretches: Sequence[Stretch], rates: np.ndarray, drive: Drive) -> float:
    """From the mean torque where one acts and the decelerations by friction; else from known friction."""
    top, bottom = 0.0, 0.0
    for run, s in zip(runs, stretches, strict=True):
        if not s.off:
            speed, rate = _speeds_and_rates(run)
            required = float(np.mean(rate + rates[0] * speed + rates[1] * np.sign(speed)))
            top, bottom = top + _mean_torque(run, drive) * required, bottom + required**2
    if top > 0.0:
        return top / bottom
    for n, rate in zip(FRICTION, rates, strict=False):
        if drive.value(n):
            return drive.value(n) / rate
    added = [v for n, v in drive.values.items() if quantity_of(n) == "added_inertia"]
    return max(added, default=1.0) or 1.0


def _mean_torque(run: Run, drive: Drive) -> float:
    """The mean torque that acts in a run; for an induction motor from the measured speeds."""
    if run.inputs.shape[1] == 1:
        return float(np.mean(run.inputs))
    speed, _ = _speeds_and_rates(run)
    middle = np.linspace(0, len(run.inputs) - 1, len(speed))
    return mean_torque(drive, run.inputs[:, 1] + 1j * run.inputs[:, 2],
                       np.interp(np.arange(len(run.inputs)), middle, speed), run.reading.step)


def _direction(run: Run) -> float:
    values = run.reading.values[run.reading.known]
    return float(np.sign(values[-1] - values[0] if run.reading.role == "motor_angle" else np.mean(values)))


def _parameter_lines(own: Drive, ended: Drive, free: Sequence[str], fitted: CoastDownFit,
                     scale: Sequence[str], held: set[str], both: bool) -> tuple[Parameter, ...]:
    """Inertia and friction, with intervals where a scale is known; parameters that need no scale always."""
    lines = []
    for name in dict.fromkeys((INERTIA, *FRICTION, *free)):
        reason = ""
        if name in held:
            line = held_line(own, name, "held by --hold")
        elif name not in free and name != INERTIA:
            line = line_of(own, name, own.value(name) or 0.0)
            reason = "one direction only: included in the Coulomb friction"
        elif not scale and (name == INERTIA or "{T}" in ended.quantity(name).unit):
            line = line_of(own, name, own.values.get(name, np.nan))
            reason = "without a torque only the ratio of friction to inertia is identifiable"
        elif unidentified(name, free, fitted):
            line = line_of(own, name, ended.values[name])
            reason = "it has no significant effect on these coast-downs"
        else:
            line = line_of(own, name, ended.values[name]).with_interval(
                fitted.std(name), (ended.quantity(name).bounds[0], np.inf))
        lines.append(line.without_interval(reason, "not-identifiable") if reason else line)
    return (*lines, *_electrical_parameters(own))


def _electrical_parameters(drive: Drive) -> list[Parameter]:
    """The values of an induction motor that were taken as known."""
    if not fed_by_voltages(drive):
        return []
    return [held_line(drive, n, "taken as known") for n in (
        name_of(drive.bodies[0], suffix) for suffix in INDUCTION.quantities)]


def _sensor_details(fitted: CoastDownFit) -> list[dict[str, float | str]]:
    """What is known of each sensor."""
    return [{"role": r.role, "count": r.count, "error_beyond_counts": r.error} if r.count else
            {"role": r.role, "std": float(np.nanmedian(r.std))} for r in fitted.readings]


def _stretch_details(stretches: Sequence[Stretch], experiments: Sequence[Experiment]) -> list[dict[str, object]]:
    """The stretches as plain numbers."""
    return [{"file": e.name, "start": e.offset + s.first * e.step, "end": e.offset + s.last * e.step,
             "torque": "off" if s.off else "on"} for s in stretches for e in (experiments[s.recording],)]
