"""Friction and inertia of a drive that runs down without torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.optimize import nnls

from drivetool.drive import AT, Drive, one_body, shared
from drivetool.drive.effects import EFFECT as INDUCTION, mean_torque
from drivetool.errors import BadOption, NotEnoughData
from drivetool.identify.acceleration import Rigid, held_value, in_the_drive, rigid_of
from drivetool.identify.coast_down.laws import UNLIKELY, Further, begun, further_law
from drivetool.identify.coast_down.report import (
    TELLS,
    Spread,
    between_runs,
    exhibits,
    figures,
    findings,
    no_load_speed,
    outcome,
    ratio_covariance,
    ratio_lines,
    untold,
)
from drivetool.identify.coast_down.run_down_fit import NOTHING, Fitted, Prior, Run, fit, run_of
from drivetool.identify.coast_down.stages import Joint, in_stages
from drivetool.identify.coast_down.stretches import Stretch, stretches_of
from drivetool.identify.estimate import Z95, Covariance, Estimate, Parameter
from drivetool.identify.setup import Options, fed_by_voltages
from drivetool.logs import Experiment, sources

INERTIA = "motor.inertia"
FRICTION = ("motor.viscous", "motor.coulomb", "motor.idle_torque")
CONSTANTS = 3.0  # time constants of the rotor's flux, after which 5 % of it is left
ADDED = "a known added inertia"
PARTS = 40  # of a run-down, whose mean speeds give start values


@dataclass(frozen=True)
class Scale:
    """What makes torques of accelerations: nothing, or what a person reads in `by`."""

    by: tuple[str, ...]

    @property
    def known(self) -> bool:
        """Whether anything does."""
        return bool(self.by)


def coast_down(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """Ratios of friction to inertia from running down without torque; friction and inertia where a scale is known.

    J dw/dt = T - T0 - B w - Tc sgn(w), with the further laws of options.free, is simulated and compared with
    counts, an angle or a speed by least squares. Without a torque everything may be multiplied by one factor:
    then only ratios have intervals. The factor is fixed by a stretch under torque, by a known added inertia, and
    by a friction or an inertia that is held or comes with an interval from a parameter file.

    experiments  motor_angle or motor_speed; motor_torque where it was logged, else the drive is taken to run down
                 from its highest speed on. Of an induction motor the voltages of its supply will do
    drive        start values; what is held
    options      flux_decay: time after switching off that is left out [s]; None: as a known motor's flux asks for
    returns      Estimate of inertia, viscous and Coulomb friction, in both directions of the idle torque
    raises       NotEnoughData: nothing runs down without torque, or an added inertia changes nothing;
                 BadRecording: too few counts, or a counter starts again; BadOption
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
    both = len({_sign(r) for r in runs}) == 2
    prior = _prior(own, options.known, held, {v: k for k, v in names.items()}).of(
        (INERTIA, *(FRICTION if both else FRICTION[:2])))
    scale = _scale(own, stretches, held, prior, options.free)
    start = _started(own, runs, stretches, scale, held)
    free = [n for n in (INERTIA, *FRICTION) if n not in held and (n != FRICTION[2] or both)
            and (n != INERTIA or scale.known)]
    free += [n for n in options.free if n not in free and n != "all"]
    fitted, spread = _fitted(start, free, runs, stretches, prior)
    _check_scale(start, fitted, scale)
    ended = start.with_values(fitted.found)
    judged, further = _judged(ended, runs, prior, fitted, spread.first)
    lines = _lines(own, ended, free, fitted, scale, held, both)
    told = [i for i, n in enumerate(free) if any(p.name == n and p.std is not None for p in lines)]
    kept = {p.name: p.value for p in lines if np.isfinite(p.value)}
    result = Estimate(
        step="steady", drive=own.with_values(kept), parameters=lines,
        outcome=outcome(stretches, experiments, scale.by), fit=figures(fitted, stretches),
        covariance=_covariance(free, told, fitted),
        details={"scale": list(scale.by), "spans": _listed(stretches, experiments), "sensor": _sensor(fitted)} | (
            {} if scale.known else {"ratio_covariance": ratio_covariance(ended, free, fitted)}),
        findings=tuple(findings(fitted, judged, stretches, experiments, scale.by, spread, further)),
        data=sources(experiments), exhibits=exhibits(experiments, stretches, fitted, ended),
        ratios=(*ratio_lines(ended, free, fitted), *no_load_speed(ended, free, fitted, runs)))
    if options.stages:
        joint = Joint(experiments, stretches, runs, tuple(begun(start, free)), ended, fitted, prior,
                      own.values if scale.known else {})
        return in_stages(result, joint, options.stages)
    if rigid is None:
        return result
    if scale.known:
        return in_the_drive(result, drive, rigid)
    lines = tuple(replace(p, name=names[p.name], unit=drive.unit(names[p.name])) for p in lines)
    return replace(result, drive=drive, parameters=lines)


def _refuse_for_several(options: Options) -> None:
    """Refuse what only a drive of one body can be asked."""
    if options.free or options.stages:
        raise BadOption("no --free and no --stages for a coast-down of several bodies",
                        f"--free {options.free[0]}" if options.free else "--stages",
                        "They run down as one: say --drive one-body.")


def _fitted(start: Drive, free: Sequence[str], runs: Sequence[Run], stretches: Sequence[Stretch],
            prior: Prior) -> tuple[Fitted, Spread]:
    """The likeliest fit of all starts, its covariance with how run-downs differ, and how they do."""
    fitted = min((fit(each, free, runs, prior) for each in begun(start, free)), key=lambda f: f.unlikely)
    spread = between_runs(start, free, runs, stretches, fitted)
    if spread.changes:  # the residuals of all together have the differences in them
        fitted = replace(fitted, covariance=fitted.white + spread.added)
    return fitted, spread


def flux_decay(drive: Drive) -> float:
    """Time after switching off until 5 % of the rotor's flux is left [s]; 0 where no motor is known."""
    if not fed_by_voltages(drive):
        return 0.0
    side = 0.5 * drive.value("motor.leakage_inductance") + drive.value("motor.magnetizing_inductance")
    return CONSTANTS * side / drive.value("motor.rotor_resistance")


def _covariance(free: Sequence[str], told: Sequence[int], fitted: Fitted) -> Covariance | None:
    """Of the parameters that have intervals."""
    return Covariance(tuple(free[i] for i in told), fitted.covariance[np.ix_(told, told)]) if told else None


def _one_body(drive: Drive, rigid: Rigid, held: set[str]) -> Drive:
    """The whole drive as one body, with what is known of it."""
    known = {n: drive.values[whole] for n, whole in rigid.names.items() if n != INERTIA and whole in drive.values}
    return one_body(drive.torque_unit, drive.motion_unit).with_values(
        known | {n: held_value(n, drive, rigid) for n in held})


def _prior(drive: Drive, known: Covariance | None, held: set[str], own: Mapping[str, str]) -> Prior:
    """What parameter files tell of inertia and friction, by the names of one body."""
    at = [i for i, n in enumerate(known.names) if own.get(n) in (INERTIA, *FRICTION)] if known else []
    at = [i for i in at if own[known.names[i]] not in held and drive.values.get(own[known.names[i]]) is not None]
    if not at:
        return NOTHING
    names = tuple(own[known.names[i]] for i in at)
    return Prior(names, np.array([drive.values[n] for n in names]), known.matrix[np.ix_(at, at)])


def _scale(drive: Drive, stretches: Sequence[Stretch], held: set[str], prior: Prior, free: Sequence[str]) -> Scale:
    """What fixes the factor between accelerations and torques; no added inertia that is fitted itself."""
    by = [_driven_by(drive)] if any(not s.off for s in stretches) else []
    added = [v for n, v in drive.values.items() if shared(n).endswith(".added_inertia") and AT in n
             and n not in free]
    by += [ADDED] if any(added) else []
    by += [f"{n} as held" for n in sorted(held) if drive.value(n)]
    return Scale((*by, *(f"{n} by its file" for n in prior.names)))


def _driven_by(drive: Drive) -> str:
    return "a stretch under supply" if fed_by_voltages(drive) else "a stretch under torque"


def _judged(ended: Drive, runs: Sequence[Run], prior: Prior, fitted: Fitted,
            first: tuple[Run, Fitted] | None) -> tuple[Fitted, Further | None]:
    """(fit by which friction is judged, the law that it lacks); of the first run-down alone where they differ.

    What does not fit under a torque may be the torque's: the run-downs alone tell of the friction.
    """
    if first is not None:
        run, fitted = first
        ended, runs, prior = ended.with_values(fitted.found), [run], NOTHING
    elif fitted.misfit < UNLIKELY and any(r.inputs.any() for r in runs):
        runs, prior = [r for r in runs if not r.inputs.any()], NOTHING
        fitted = fit(ended, [n for n in fitted.names if n != INERTIA], runs, prior)
        ended = ended.with_values(fitted.found)
    return fitted, further_law(ended, fitted.names, runs, prior, fitted) if fitted.misfit < UNLIKELY else None


def _check_scale(drive: Drive, fitted: Fitted, scale: Scale) -> None:
    """Refuse an added inertia, alone as the scale, that changes nothing: the drive's own would be beyond bounds."""
    if INERTIA not in fitted.names or scale.by != (ADDED,):
        return
    value = fitted.found[INERTIA]
    if not fitted.std(INERTIA) < TELLS * value:
        names = [n.partition(AT)[2] for n, v in drive.values.items() if v and f".added_inertia{AT}" in n]
        raise NotEnoughData(
            "a run-down that the added inertia slows", f"{', '.join(names)}, as fast as without it but for chance",
            "Check that it was on and that --record names its recording; record again with one about as large as "
            "the drive's own.")


def _started(drive: Drive, runs: Sequence[Run], stretches: Sequence[Stretch], scale: Scale,
             held: set[str]) -> Drive:
    """Start values: ratios from mean speeds of the run-downs, and an inertia where there is a scale."""
    rates = _ratios([r for r, s in zip(runs, stretches, strict=True) if s.off])
    inertia = 1.0
    if scale.known:
        inertia = drive.value(INERTIA) or _first_inertia(runs, stretches, rates, drive)
    found = {INERTIA: inertia, FRICTION[0]: inertia * rates[0], FRICTION[1]: inertia * rates[1], FRICTION[2]: 0.0}
    if scale.known:
        found |= {n: drive.value(n) or 0.0 for n in held}
    return drive.with_values(found)


def _ratios(runs: Sequence[Run]) -> np.ndarray:
    """(2,) viscous and Coulomb friction over the inertia, not negative."""
    rows, rates = [], []
    for run in runs:
        speed, rate = _slopes(run)
        rows.append(np.column_stack([np.abs(speed), np.ones(len(speed))]))
        rates.append(-np.sign(speed) * rate)
    found = nnls(np.concatenate(rows), np.concatenate(rates))[0]
    return np.maximum(found, 1e-3 * np.abs(np.concatenate(rates)).max() / np.concatenate(rows).max(axis=0))


def _slopes(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """(mean speeds, accelerations) between the parts of a run."""
    r = run.reading
    at = r.known
    ends = np.unique(at[np.linspace(0, len(at) - 1, min(PARTS, len(at) // 2) + 1).round().astype(int)])
    time = ends * r.step
    if r.role == "motor_angle":
        speed = np.diff(r.values[ends]) / np.diff(time)
        middle = 0.5 * (time[1:] + time[:-1])
    else:
        speed = np.array([np.nanmean(r.values[a:b]) for a, b in pairwise(ends)])
        middle = 0.5 * (time[1:] + time[:-1])
    moves = np.abs(speed) > 0.0
    speed, middle = speed[moves], middle[moves]
    return 0.5 * (speed[1:] + speed[:-1]), np.diff(speed) / np.diff(middle)


def _first_inertia(runs: Sequence[Run], stretches: Sequence[Stretch], rates: np.ndarray, drive: Drive) -> float:
    """From the mean torque where one acts and the rates at which friction brakes; else from known friction."""
    top, bottom = 0.0, 0.0
    for run, s in zip(runs, stretches, strict=True):
        if not s.off:
            speed, rate = _slopes(run)
            asked = float(np.mean(rate + rates[0] * speed + rates[1] * np.sign(speed)))
            top, bottom = top + _mean_torque(run, drive) * asked, bottom + asked**2
    if top > 0.0:
        return top / bottom
    for n, rate in zip(FRICTION, rates, strict=False):
        if drive.value(n):
            return drive.value(n) / rate
    added = [v for n, v in drive.values.items() if shared(n).endswith(".added_inertia")]
    return max(added, default=1.0) or 1.0


def _mean_torque(run: Run, drive: Drive) -> float:
    """The mean torque that acts in a run; of an induction motor by the speeds as they were measured."""
    if run.inputs.shape[1] == 1:
        return float(np.mean(run.inputs))
    speed, _ = _slopes(run)
    middle = np.linspace(0, len(run.inputs) - 1, len(speed))
    return mean_torque(drive, run.inputs[:, 1] + 1j * run.inputs[:, 2],
                       np.interp(np.arange(len(run.inputs)), middle, speed), run.reading.step)


def _sign(run: Run) -> float:
    values = run.reading.values[run.reading.known]
    return float(np.sign(values[-1] - values[0] if run.reading.role == "motor_angle" else np.mean(values)))


def _of_torque(drive: Drive, name: str) -> bool:
    """Whether a parameter is a torque over something, which a scale multiplies."""
    return "{T}" in drive.quantity(name).unit


def _lines(own: Drive, ended: Drive, free: Sequence[str], fitted: Fitted, scale: Scale, held: set[str],
           both: bool) -> tuple[Parameter, ...]:
    """Inertia and friction, with intervals where a scale is known; others where they need none."""
    lines = []
    for name in dict.fromkeys((INERTIA, *FRICTION, *free)):
        unit, begun = own.unit(name), own.values.get(name)
        if name in held:
            lines.append(Parameter(name, own.value(name), unit, begun, status="held", reason="held by --hold"))
        elif name not in free and name != INERTIA:
            lines.append(Parameter(name, own.value(name) or 0.0, unit, begun, status="not-identifiable",
                                   reason="one direction only: counted in the Coulomb friction"))
        elif not scale.known and (name == INERTIA or _of_torque(ended, name)):
            lines.append(Parameter(name, begun if begun is not None else np.nan, unit, begun,
                                   status="not-identifiable",
                                   reason="without a torque only the ratio of friction to inertia shows"))
        else:
            value, std = ended.values[name], fitted.std(name)
            low = ended.quantity(name).bounds[0]
            if untold(name, free, fitted):
                lines.append(Parameter(name, value, unit, begun, status="not-identifiable",
                                       reason="it hardly moves these run-downs"))
                continue
            lines.append(Parameter(name, value, unit, begun, std, (max(value - Z95 * std, low), value + Z95 * std)))
    return (*lines, *_electrical(own))


def _electrical(drive: Drive) -> list[Parameter]:
    """The values of an induction motor that were taken as known."""
    if not fed_by_voltages(drive):
        return []
    return [Parameter(n, drive.value(n), drive.unit(n), drive.values.get(n), status="held", reason="taken as known")
            for n in (f"{drive.bodies[0]}.{suffix}" for suffix in INDUCTION.quantities)]


def _sensor(fitted: Fitted) -> list[dict[str, float | str]]:
    """What is known of each sensor."""
    return [{"role": r.role, "count": r.count, "error_beyond_counts": r.error} if r.count else
            {"role": r.role, "std": float(np.nanmedian(r.std))} for r in fitted.readings]


def _listed(stretches: Sequence[Stretch], experiments: Sequence[Experiment]) -> list[dict[str, object]]:
    """The stretches as plain numbers."""
    return [{"file": e.name, "start": e.offset + s.first * e.step, "end": e.offset + s.last * e.step,
             "torque": "off" if s.off else "on"} for s in stretches for e in (experiments[s.recording],)]
