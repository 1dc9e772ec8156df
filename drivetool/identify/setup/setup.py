"""From experiments and a drive to a least-squares problem with a first guess."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from drivetool.drive import Assembly, Drive, Layout
from drivetool.drive.effects import induction, load_step, transmission_loss
from drivetool.drive.simulation import Plant, Trace, plant_of
from drivetool.errors import BadOption, BadRecording, NotEnoughData
from drivetool.identify.problem import Point, Problem
from drivetool.identify.setup.by_record import as_recorded
from drivetool.identify.setup.supply import fed_by_voltages
from drivetool.logs import INPUTS, Experiment, quantity
from drivetool.quantity import name_of, owner_of, quantity_of, record_of

UNNAMED_RECORDINGS = -1  # instead of a recording's number: those that are not named
# Times its dead time, left out at the start of a stretch; a choice, since a fit may enlarge the dead time.
DEAD_TIME_MARGIN = 1.5
MIN_FINITE_SHARE = 0.5  # share of the third differences that must be finite; a choice: with fewer, gaps are skipped
# Of the fastest motion, and share of the record, from which a motor turns both ways; a choice.
MIN_REVERSAL_SHARE = 0.02
# Samples between two angles for a speed, a choice: over one sample an encoder's quantisation exceeds it.
ANGLE_DIFFERENCE_SAMPLES = 8
DAMPINGS = ("damping", "gap_damping", "load_damping")  # of shafts
LOSSES = transmission_loss.EFFECT.present
SWITCHING = ("half_gap", "coulomb", *LOSSES)  # parameters of contacts and sticking


@dataclass(frozen=True)
class Roles:
    """Input roles of the model, and output roles that it is compared with."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


def roles_of(experiments: Sequence[Experiment], drive: Drive) -> Roles:
    """The roles that every recording has and the drive knows.

    raises  BadRecording: no motor torque, or no sensor
    """
    if not experiments:
        raise NotEnoughData("at least one recording", "none", "Name a log file.")
    common = set.intersection(*(set(e.signals) for e in experiments))
    for e in experiments:
        if "motor_torque" not in e.signals:
            raise BadRecording(
                "role motor_torque for the drive's input", f"none in {e.name}",
                "Name its channel in the channel map; where the drive coasts down without torque, use steady "
                "--method coast-down.", sorted(e.signals))
        e.signed("motor_torque", "the drive's input")
        if e.input_units:
            raise BadRecording(f"one unit of torque for all roles of {e.name}", ", ".join(
                f"{role} in {e.unit(role)}" for role in e.signals if role.endswith("torque")),
                "Convert the inputs to torques first, with as_torques and motor.torque_constant.")
    inputs = tuple(r for r in INPUTS if r in common and quantity(r) == "torque"
                   and (r != "motor2_torque" or "motor2" in drive.bodies))
    if fed_by_voltages(drive):
        inputs += tuple(r for r in induction.VOLTAGES if r in common)
    outputs = [chosen for choices in sensors_of(drive) for chosen in [c for c in choices if c in common][:1]]
    if not outputs:
        raise BadRecording(
            "a motor speed or motor angle", "no such channel common to all recordings",
            "Name its channel in the channel map.", sorted(common))
    return Roles(inputs, tuple(outputs))


def both_outputs(experiments: Sequence[Experiment], drive: Drive) -> Roles | None:
    """The roles of a fit to speed and shaft torque; None: not two bodies, or no sensor of both."""
    roles = roles_of(experiments, drive)
    torques = [r for r in roles.outputs if r.endswith("_torque")]
    if len(drive.bodies) != 2 or not torques:
        return None
    at_motor = [r for r in roles.outputs if r in ("motor_speed", "motor_angle")]
    return Roles(roles.inputs, (at_motor[0], torques[0])) if at_motor else None


def sensors_of(drive: Drive) -> list[tuple[str, ...]]:
    """The roles that can measure each body and then each shaft of a drive, of which one is taken, the first best.

    Of a body its speed, or its angle where no speed was logged: an encoder's two readings are one measurement and
    must not count twice. Whatever the drive calls them, the first body may be `motor` and the last `load`.
    """
    names = [[body] for body in drive.bodies]
    names[0].append("motor")
    if drive.shafts:
        names[drive.bodies.index(drive.load)].append("load")
    shafts = [[shaft] for shaft in drive.shafts]
    if shafts:
        shafts[0].append("shaft")
    return [*(tuple(dict.fromkeys(f"{n}_{what}" for what in ("speed", "angle") for n in each)) for each in names),
            *(tuple(dict.fromkeys(f"{n}_torque" for n in each)) for each in shafts)]


def traces_of(experiments: Sequence[Experiment], roles: Roles, segment: float = 0.0,
              starts: Mapping[int, Mapping[str, float]] = MappingProxyType({})) -> tuple[Trace, ...]:
    """One trace per uninterrupted stretch, cut into pieces of `segment` seconds if above zero.

    starts  known state in which an experiment of that number begins, UNNAMED_RECORDINGS for the others; after a
            gap, a cut or another rate no state is known
    """
    found = []
    for e in experiments:
        known = starts.get(e.number, starts.get(UNNAMED_RECORDINGS, {}))
        for first, last in e.segments:
            # A stretch by itself: a pause of any length takes no memory.
            u, y = (np.column_stack([e.signals[r][first:last] for r in names])
                    for names in (roles.inputs, roles.outputs))
            # At most one a sample, whatever the time stamps say.
            pieces = max(1, min(round((last - first) * e.step / segment), last - first)) if segment > 0.0 else 1
            edges = np.linspace(first, last, pieces + 1).round().astype(int)
            found += [Trace(u[a - first:b - first], y[a - first:b - first], e.step, e.name,
                            e.offset + a * e.step, e.number, u[:a - first] if a > first else None,
                            known if e.begins and a == e.segments[0][0] else {})
                      for a, b in pairwise(edges) if b - a >= 10]
    if not found:
        raise NotEnoughData("a stretch of at least 10 samples", *(
            ("none", "Record longer.") if segment == 0.0 else
            (f"none: pieces of {segment:g} s, a sample every {min(e.step for e in experiments):g} s",
             "Check the time stamps and their unit, or give a longer --segment.")))
    return tuple(found)


def refuse_transmission_loss(drive: Drive, free: Sequence[str], step: str) -> None:
    """Raise BadOption where a transmission loses torque: for a step whose law of torque and motion lacks that."""
    losses = [n for n in drive.quantities if quantity_of(n) in LOSSES and (n in free or drive.values.get(n))]
    if losses:
        raise BadOption(f"no transmission loss in {step}: friction and inertia would include it", ", ".join(losses),
                        "Go on to greybox without --criterion, or set the loss to zero.")


def after_transient(experiment: Experiment, drive: Drive, free: Sequence[str] = ()) -> Experiment:
    """The experiment without the sensor values at the start of each stretch, if the drive has a dead time.

    There it moves by unknown torques from before the record. At most a hundredth of a stretch is left out.
    """
    delay = drive.value("converter.dead_time") or 0.0
    if delay == 0.0 and "converter.dead_time" not in free:
        return experiment
    sensors = {r for r in experiment.signals if r not in INPUTS and not r.startswith("reference")}
    signals = {r: values.copy() if r in sensors else values for r, values in experiment.signals.items()}
    for first, last in experiment.segments:
        count = min(int(np.ceil(DEAD_TIME_MARGIN * delay / experiment.step)) + 2, (last - first) // 100)
        for role in sensors:
            signals[role][first:first + count] = np.nan
    return replace(experiment, signals=signals)


def reverses(experiments: Sequence[Experiment]) -> bool:
    """Whether the motor turns both ways for at least 2 % of a record each, or of all records together."""
    speeds = [speed for e in experiments if (speed := _motor_speed_in(e)) is not None]
    together = [np.concatenate(speeds)] if len(speeds) > 1 else []
    for speed in (*speeds, *together):
        size = MIN_REVERSAL_SHARE * np.nanmax(np.abs(speed))
        if np.nanmean(speed > size) > MIN_REVERSAL_SHARE and np.nanmean(speed < -size) > MIN_REVERSAL_SHARE:
            return True
    return False


def starts_or_stops(experiments: Sequence[Experiment]) -> bool:
    """Whether the motor's torque drives it, and it stands for at least 2 % of a record."""
    pairs = [(speed, e.signals["motor_torque"][:len(speed)]) for e in experiments
             if (speed := _motor_speed_in(e)) is not None and "motor_torque" in e.signals]
    stands = any(np.nanmean(np.abs(speed) < MIN_REVERSAL_SHARE * np.nanmax(np.abs(speed))) > MIN_REVERSAL_SHARE
                 for speed, _ in pairs)
    return stands and sum(float(np.nansum(speed * torque)) for speed, torque in pairs) > 0.0


def _motor_speed_in(experiment: Experiment) -> np.ndarray | None:
    """The speed of the motor, or the difference of its angle over 20 ms; None: neither was logged."""
    if "motor_speed" in experiment.signals:
        return experiment.signals["motor_speed"]
    if "motor_angle" not in experiment.signals:
        return None
    smooth, angle = max(1, round(0.02 / experiment.step)), experiment.signals["motor_angle"]
    return (angle[smooth:] - angle[:-smooth]) / (smooth * experiment.step)


def with_trial_values(drive: Drive, names: Sequence[str], values: np.ndarray) -> Drive:
    """The drive with some values replaced, bounds unchecked: for trial points."""
    return replace(drive, values={**drive.values, **dict(zip(names, map(float, values), strict=True))})


def problem_of(drive: Drive, free: Sequence[str], roles: Roles, traces: Sequence[Trace]) -> Problem:
    """The problem of fitting some parameters of a drive to traces.

    free     parameter names; the others keep their value
    returns  Problem whose start states are free but for those that a trace knows: the torque before the record is
             unknown. Where no angle is measured it counts from the first sample: with another zero, a torque that
             repeats with it has another phase

    Shaft damping moves later than the rest: at a start where the resonance lies a little off, the
    steepest descent damps it away, and the fit stays in that local optimum.
    """
    free = tuple(free)

    def build(values: np.ndarray, trace: Trace, gradient: bool, memory: float | None) -> Plant:
        trial, names = _as_recorded_in(with_trial_values(drive, free, values), free, trace)
        return plant_of(trial, Layout(names, roles.inputs, roles.outputs, trace.step, memory, gradient))

    traces = [_with_clamped_speeds(drive, trace) for trace in traces]
    quantities = [drive.quantity(n) for n in free]
    seen, sizes = any(role.endswith("angle") for role in roles.outputs), _rms_torque_and_speed(roles, traces)
    plain = Assembly(drive, Layout(free, roles.inputs, roles.outputs, traces[0].step, gradient=False))
    stds = sensor_stds(traces)
    return Problem(
        build, free, np.array([q.bounds[0] for q in quantities]), np.array([q.bounds[1] for q in quantities]),
        np.array([q.size(*sizes) for q in quantities]), tuple(traces), np.arange(plain.nx), stds / stds[0],
        later=np.array([owner_of(n) in drive.shafts and quantity_of(n) in DAMPINGS for n in free], bool),
        bodies=len(drive.bodies),
        by_record=load_step.has_record_steps(drive.values) or any(record_of(n) for n in drive.values),
        anchored=() if seen else tuple(i for i, name in enumerate(plain.states) if name == "angle"),
        states=tuple(plain.states), sensor_std=float(stds[0]), step=min(t.step for t in traces))


def _with_clamped_speeds(drive: Drive, trace: Trace) -> Trace:
    """The trace with known zero speeds of clamped bodies; an estimated start speed would stay constant."""
    drive = as_recorded(drive, (), trace.record)[0]
    still = {f"{b}.speed": 0.0 for b in drive.bodies if drive.value(name_of(b, "clamped"))}
    return replace(trace, start={**trace.start, **still}) if still else trace


def _rms_torque_and_speed(roles: Roles, traces: Sequence[Trace]) -> tuple[float, float]:
    """Root mean square torque and speed of the traces; one where that is zero, or was not measured."""
    torques = [i for i, role in enumerate(roles.inputs) if role in INPUTS]
    motion, y = [], [t.outputs[:, 0] for t in traces]
    if roles.outputs[0].endswith("speed"):
        motion = y
    elif roles.outputs[0].endswith("angle"):
        motion = [(each[ANGLE_DIFFERENCE_SAMPLES:] - each[:-ANGLE_DIFFERENCE_SAMPLES])
                  / (ANGLE_DIFFERENCE_SAMPLES * t.step) for each, t in zip(y, traces, strict=True)]
    return _rms([t.inputs[:, torques].ravel() for t in traces]), _rms(motion)


def _rms(parts: Sequence[np.ndarray]) -> float:
    values = np.concatenate([np.zeros(1), *parts])
    return float(np.sqrt(np.nanmean(values**2))) or 1.0


def _as_recorded_in(drive: Drive, free: Sequence[str], trace: Trace) -> tuple[Drive, tuple[str, ...]]:
    """The drive as it was while that stretch was recorded, and the names of its free parameters there."""
    if load_step.has_record_steps(drive.values):
        drive = replace(drive, values=load_step.values_in_record(drive.values, trace.record))
    return as_recorded(drive, free, trace.record)


def linear_problem_of(drive: Drive, free: Sequence[str], roles: Roles, traces: Sequence[Trace]) -> Problem:
    """The same problem without gaps, Coulomb friction and transmission loss, for the same points.

    The Coulomb friction of a body with bristles stays: they divide by it, and it does not stick.
    """
    free = tuple(free)
    flat = {n: 0.0 for n in drive.quantities if quantity_of(n) in SWITCHING
            and name_of(owner_of(n), "bristle_stiffness") not in drive.values}
    smooth = tuple(n for n in free if n not in flat)

    def build(values: np.ndarray, trace: Trace, gradient: bool, memory: float | None) -> Plant:
        trial, names = _as_recorded_in(with_trial_values(drive, free, values), smooth, trace)
        layout = Layout(names, roles.inputs, roles.outputs, trace.step, memory, gradient)
        return plant_of(replace(trial, values={**trial.values, **flat}), layout)

    return replace(problem_of(drive, free, roles, traces), build=build)


def sensor_stds(traces: Sequence[Trace]) -> np.ndarray:
    """(ny,) first guess of the sensors' std; of one that shows no noise, the largest of the others."""
    stds = np.array([white_std([t.outputs[:, m] for t in traces]) for m in range(traces[0].outputs.shape[1])])
    stds[stds <= 0.0] = max(stds.max(), 1e-12)
    return stds


def white_std(series: Sequence[np.ndarray]) -> float:
    """Standard deviation of the white noise in a signal, by stretches (n,) each; 0 where it is too short.

    Third differences remove smooth motion between samples. Where a sensor has a value at every fourth sample, for
    example, they are taken over the values that there are.
    """
    d = np.concatenate([np.diff(y, 3) for y in series])
    if len(d) and np.isfinite(d).mean() < MIN_FINITE_SHARE:
        d = np.concatenate([np.diff(y[np.isfinite(y)], 3) for y in series])
    d = d[np.isfinite(d)]
    return float(np.sqrt(np.mean(d**2) / 20.0)) if len(d) else 0.0


def first_states(drive: Drive, roles: Roles, traces: Sequence[Trace],
                 free: Sequence[str] = ()) -> tuple[np.ndarray, ...]:
    """Start states as if every trace began in steady motion; known states of a trace have their values.

    free  names of parameters that are fitted: an effect may need a state although its start value is zero
    """
    return tuple(_steady_start_state(drive, roles, t, free) for t in traces)


def measured_states(drive: Drive, roles: Roles, traces: Sequence[Trace]) -> tuple[np.ndarray, ...]:
    """Start states from the first samples: the same, with the speed of the first sample itself.

    Where a trace begins in an acceleration the mean speed of its first samples comes too late.
    """
    return tuple(_steady_start_state(drive, roles, t, (), 1) for t in traces)


def _steady_start_state(drive: Drive, roles: Roles, trace: Trace, free: Sequence[str],
                        order: int = 0) -> np.ndarray:
    drive, names = _as_recorded_in(drive, free, trace)
    plain = Assembly(drive, Layout(names, roles.inputs, roles.outputs, trace.step, gradient=False))
    x = np.zeros(plain.nx)
    n, known = len(drive.bodies), trace.start
    speeds = [known.get(plain.states[0], _motor_speed(roles, trace, order))]
    for name, (_, _, ratio) in zip(plain.states[1:n], plain.shafts, strict=True):
        speeds.append(known.get(name, speeds[-1] / ratio.v))
    x[:n] = speeds
    shaft_torque = 0.0  # torque that all bodies beyond a shaft require
    for k in range(n - 2, -1, -1):
        body = k + 1
        shaft_torque += plain.of_body(body, "viscous").v * speeds[body] + plain.of_body(body, "idle_torque").v
        shaft_torque += plain.of_body(body, "coulomb").v * np.sign(speeds[body])
        way = np.sign(shaft_torque * speeds[body])
        shaft_torque /= 1.0 - way * plain.of_body(body, LOSSES[0 if way > 0.0 else 1]).v
        stiffness, _, ratio = plain.shafts[k]
        gap = plain.gaps[k].v if k in plain.gaps else 0.0
        x[n + k] = shaft_torque / stiffness.v + gap * np.sign(shaft_torque)
        shaft_torque /= ratio.v
    with_known_states(plain.states, trace, x)
    _set_angles(plain, roles, trace, x)
    first = dict(zip(roles.inputs, trace.inputs[0].tolist(), strict=True))
    for effect, owner, names in plain.own_states:
        # A lag of lower order has fewer states than start values.
        for name, value in zip(names, effect.start(drive, owner, x[:n], first), strict=False):
            x[plain.states.index(name)] = trace.start.get(name, value)
    return x


def with_known_states(states: Sequence[str], trace: Trace, x: np.ndarray) -> np.ndarray:
    """The start state (nx,) of a trace, in place, with its known states."""
    for i, name in enumerate(states):
        x[i] = trace.start.get(name, x[i])
    return x


def _set_angles(plain: Assembly, roles: Roles, trace: Trace, x: np.ndarray) -> None:
    """Set the motor angle from the first encoder unless it is known, and the zeros of the others."""
    for m, role in enumerate(roles.outputs):
        known = trace.outputs[np.isfinite(trace.outputs[:, m]), m]
        if not role.endswith("angle") or not len(known):
            continue
        row, _ = plain.output(role)
        zero = f"{role}.zero"
        column = plain.states.index(zero if zero in plain.states else "angle")
        if plain.states[column] in trace.start:
            continue
        rest = sum(dual.v * x[j] for j, dual in row.items() if j != column)
        x[column] = (known[0] - rest) / row[column].v


def _motor_speed(roles: Roles, trace: Trace, order: int) -> float:
    """Speed of the first samples that were measured, from a speed or the slope of an angle.

    order  of the polynomial fitted to the speed: 0 its mean; 1 a straight line, at the first sample
    """
    first = int(np.argmax(np.isfinite(trace.outputs[:, 0])))
    head = trace.outputs[first:first + max(5, min(20, trace.size // 10)), 0]
    good = np.isfinite(head)
    if not good.any():
        return 0.0
    of_angle = not roles.outputs[0].endswith("speed")
    if order == 0 and not of_angle:
        return float(head[good].mean())
    if good.sum() <= 2 + order:
        return 0.0
    t = np.arange(len(head))[good] * trace.step
    return float(np.polyfit(t, head[good], order + of_angle)[-2 if of_angle else -1])


def first_point(drive: Drive, problem: Problem, roles: Roles) -> Point:
    """The point at the drive's own values."""
    values = np.array([_start_value(drive, n) for n in problem.names])
    return Point(values, first_states(drive, roles, problem.traces, problem.names))


def _start_value(drive: Drive, name: str) -> float:
    value = drive.value(name)
    if value is None or not np.isfinite(value):
        raise BadOption(f"a finite start value of {name}", str(value), f"Give one with --set {name}=VALUE.")
    return float(value)
