"""Mass and friction from intervals of constant torque: the drive accelerates, or coasts, as one body.

Straight lines through the speed are wrong where friction is viscous: here J dw/dt = T - T0 - c w - Tc sgn(w) is
fitted, with the noise of torque and sensor. The known inertias are then subtracted from the fitted total.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import TOTALS, Drive, one_body
from drivetool.errors import BadOption, BadParameters
from drivetool.finding import Finding
from drivetool.identify.acceleration.road_slope import (
    RECORDINGS_DIFFER_SIGNIFICANCE,
    fit_with_mean_torque,
    road_slope_findings,
)
from drivetool.identify.acceleration.spans import (
    Span,
    block_averages_of_spans,
    first_values,
    p_of_common_line,
    spans_of,
    turns_both_ways,
)
from drivetool.identify.channels import suspect_unit_findings
from drivetool.identify.estimate import Z95, Covariance, Estimate, Parameter, PlotData, in_order
from drivetool.identify.greybox import greybox
from drivetool.identify.plateaus import one_direction_finding, record_plot
from drivetool.identify.setup import Options
from drivetool.logs import Experiment
from drivetool.quantity import name_of, names_of, owner_of, quantity_of

# Blocks of the longest span: the speed is a smooth curve, of which more have no more information.
MAX_SPAN_BLOCKS = 400
MIN_SPAN_BLOCKS = 60  # blocks of the longest span: a fit needs ten for a stretch, and its findings some dozens
DRAG = "motor.drag"
# Standard deviations of a significant drag: chance alone exceeds them once in 30 000 recordings.
DRAG_SIGNIFICANCE = 4.0


@dataclass(frozen=True)
class RigidDrive:
    """The drive as one body at its motor.

    names    of its parameters -> their names in the drive; target: the drive's parameter that takes the inertia
             less the rest
    factor   from an inertia at the motor to the target; rest: inertia of everything else at the motor
    variance of the rest, by the parameter files
    unknown  inertias of the rest without a given value
    """

    names: Mapping[str, str]
    target: str
    factor: float
    rest: float
    variance: float
    unknown: tuple[str, ...]


def acceleration(experiments: Sequence[Experiment], drive: Drive, options: Options) -> Estimate:
    """Mass or inertia, viscous friction and constant force from intervals of constant torque.

    experiments  motor_torque and motor_speed or motor_angle
    drive        known values of the rotating parts, the gear and the radius; start values are not needed
    options      hold of total.viscous, total.idle_torque and motor.coulomb
    returns      Estimate of the last body's carried_mass where the drive has a radius, else of its inertia, of
                 total.viscous and total.idle_torque, in both directions also of motor.coulomb
    raises       NotEnoughData: no two constant torques, no change of speed; BadRecording; BadParameters
    source       bus driveline paper: acceleration and deceleration test
    """
    spans, rigid = spans_of(experiments), rigid_of(drive, options)
    start = one_body(drive.torque_unit, drive.motion_unit).with_values(
        {f"motor.{n}": value for n, value in first_values(spans).items()
         if n != "coulomb" or turns_both_ways(spans)})
    start = start.with_values(
        {n: held_value(n, drive, rigid) for n in rigid.names if rigid.names[n] in options.hold})
    # No free runs for comparison: with a torque of their own they have no information where the logged one is
    # constant.
    hold = {n for n in rigid.names if rigid.names[n] in options.hold}
    # In one direction the constant torque is reported with the Coulomb friction in it.
    hold |= set() if turns_both_ways(spans) else {"motor.coulomb"}
    fit_options = replace(options, known=None, free=(), criterion="innovations",
                          hold=tuple(n for n in rigid.names if n in hold))
    shared, cut = _fit_block_means(experiments, spans, start, fit_options)
    found = fit_with_mean_torque(shared, cut, start, fit_options)
    inertia = found.estimate.line("motor.inertia")
    estimate = as_drive_parameters(found.estimate, drive, rigid)
    road = road_slope_findings(found, estimate, drive, rigid.target)
    forward = sum(bool(s.speed.mean() > 0.0) for s in spans)
    one_way = [] if turns_both_ways(spans) else [
        one_direction_finding(rigid.names["motor.idle_torque"], forward, len(spans) - forward)]
    return replace(
        estimate, step="steady", outcome=_outcome_text(spans, experiments, drive),
        details={**estimate.details, "spans": _span_details(spans, experiments),
                 "inertia_at_motor": {"value": inertia.value, "std": inertia.std},
                 **({"idle_torque_by_record": found.by_record} if found.by_record else {})},
        findings=(*_unit_findings(estimate, drive, rigid), *_common_line_findings(spans),
                  *_drag_findings(shared, cut, start, fit_options), *road,
                  *_unknown_rest_findings(rigid, estimate, drive), *one_way, *estimate.findings),
        exhibits=(_friction_plot(spans, found.estimate.drive, drive), *(
            record_plot("intervals of constant torque", e, [(s.first, s.last) for s in spans if s.recording == k],
                        drive) for k, e in enumerate(experiments))))


def held_value(name: str, drive: Drive, rigid: RigidDrive) -> float:
    """Value of a parameter of one body that the drive's own holds."""
    own = rigid.names[name]
    if own == rigid.target:
        return rigid.rest + (drive.value(own) or 0.0) / rigid.factor
    if owner_of(own) == "total" and own not in drive.values:
        return drive.referred_to_motor(quantity_of(name))
    return drive.value(own) or 0.0


def rigid_of(drive: Drive, options: Options) -> RigidDrive:
    """How the drive's parameters follow from those of one body.

    raises  BadOption: a part of a friction is to be held, of which only the sum is identifiable
    """
    last, turns = drive.bodies[-1], drive.gear_ratios()[-1]
    carries = bool(drive.value(name_of(last, "carried_mass"))) or name_of(last, "radius") in drive.values
    target = name_of(last, "carried_mass") if carries else name_of(last, "inertia")
    first, several = drive.bodies[0], len(drive.bodies) > 1
    friction = {n: f"total.{n}" if several else name_of(first, n) for n in TOTALS.values()} | {
        "coulomb": name_of(first, "coulomb")}  # one body stands for all
    names = {f"motor.{n}": whole for n, whole in friction.items()} | {"motor.inertia": target}
    parts = [n for n in options.hold if quantity_of(n) in friction and n not in names.values()]
    if parts:
        raise BadOption("the friction of the whole drive after --hold of --method acceleration", ", ".join(parts),
                        f"Hold {friction[quantity_of(parts[0])]}: only the sum is identifiable.")
    if options.free:
        raise BadOption("--hold, and no --free, with --method acceleration", f"--free {options.free[0]}",
                        "Leave it out: mass, constant and viscous friction are fitted. Others are for greybox.")
    own = drive.with_values({target: 0.0} if carries else {})
    masses = own.inertias()
    masses[-1] -= 0.0 if carries else own.value(target) or 0.0
    rest = float(sum(j / n**2 for j, n in zip(masses, drive.gear_ratios(), strict=True)))
    others = [n for n in names_of(drive.bodies, "inertia") if n != target]
    radius = drive.value(name_of(last, "radius")) if carries else 1.0
    return RigidDrive(names, target, turns**2 / radius**2, rest, _rest_variance(others, drive, options.known),
                 tuple(n for n in others if n not in drive.values))


def _rest_variance(names: Sequence[str], drive: Drive, known: Covariance | None) -> float:
    """Of the sum of inertias at the motor, by the parameter files."""
    if known is None:
        return 0.0
    turns = dict(zip(drive.bodies, drive.gear_ratios(), strict=True))
    shares = np.array([turns[owner_of(n)] ** -2 if n in names else 0.0 for n in known.names])
    return float(shares @ known.matrix @ shares)


def _fit_block_means(experiments: Sequence[Experiment], spans: Sequence[Span], start: Drive,
            options: Options) -> tuple[Estimate, list[Experiment]]:
    """The fit of one body, and the recordings as they were fitted.

    Torque noise excites shaft oscillations, which one body lacks. Means over blocks are taken, the shortest with
    white one-step prediction errors.
    """
    longest = max(s.last - s.first for s in spans)
    length = max(1, longest // MAX_SPAN_BLOCKS)
    while True:
        cut = [block_averages_of_spans(e, mine, length) for k, e in enumerate(experiments)
               if (mine := [s for s in spans if s.recording == k])]
        found = greybox(cut, start, options)
        if not found.repeats or longest < 2 * length * MIN_SPAN_BLOCKS:
            return found, cut
        length *= 2


def _unit_findings(estimate: Estimate, drive: Drive, rigid: RigidDrive) -> list[Finding]:
    """Findings where the total inertia is far from that of the given values."""
    before, after = drive.value(rigid.target), estimate.drive.values[rigid.target]
    if not before or rigid.unknown:
        return []
    return suspect_unit_findings((rigid.rest + after / rigid.factor) / (rigid.rest + before / rigid.factor))


def _common_line_findings(spans: Sequence[Span]) -> list[Finding]:
    """A finding where no common friction line fits all intervals."""
    probability = p_of_common_line(spans)
    if probability > RECORDINGS_DIFFER_SIGNIFICANCE:
        return []
    return [Finding(
        "warning", "scatter-beyond-noise",
        "One inertia and one friction line do not explain the intervals of constant torque: the residual "
        f"exceeds its noise (p-value {probability:.1g}).", {"probability": probability},
        "Check the sign of the torque in every interval; look for a load, a slope or a brake that acts in some of "
        "them, and for nonlinear friction.")]


def _drag_findings(shared: Estimate, cut: Sequence[Experiment], start: Drive, options: Options) -> list[Finding]:
    """A finding where the friction is not linear in speed: it has a significant quadratic term."""
    found = greybox(cut, start.with_values({**shared.drive.values, DRAG: 0.0}), replace(options, free=(DRAG,)))
    line = found.line(DRAG)
    if line.std is None or line.value < DRAG_SIGNIFICANCE * line.std:
        return []
    return [Finding(
        "warning", "nonlinear-friction",
        f"Friction grows with the square of the speed: {line.value:.3g} +- {line.std:.2g} {line.unit}. The fitted "
        "law of constant and viscous friction does not include it.",
        {"drag": line.value, "std": line.std},
        f"Fit it on the same recordings: greybox --drive one-body --set motor.inertia="
        f"{found.drive.values['motor.inertia']:.3g} --free motor.drag.")]


def as_drive_parameters(found: Estimate, drive: Drive, rigid: RigidDrive) -> Estimate:
    """The estimate of one body, its motor, as parameters of the drive that it represents."""
    lines = {p.name: _as_drive_parameter(p, drive, rigid) for p in found.parameters if p.name in rigid.names}
    values = {p.name: p.value for p in lines.values() if np.isfinite(p.value)}
    if values[rigid.target] <= 0.0:
        unit = drive.unit(name_of(drive.bodies[0], "inertia"))
        raise BadParameters("inertias of the rotating parts below the total inertia that the motor accelerates, "
                            f"{found.drive.values['motor.inertia']:.4g} {unit}",
                            f"{rigid.rest:.4g} at the motor", "Correct their inertias, or the "
                            "ratio; a record of the motor alone identifies its inertia.")
    if "motor.coulomb" in lines:  # that of the other bodies would count twice
        values |= {n: 0.0 for n in names_of(drive.bodies[1:], "coulomb") if drive.values.get(n)}
    own = {n: line.name for n, line in lines.items() if line.std is not None}
    covariance = _covariance(found.covariance, own, rigid)
    texts = sorted(rigid.names.items()) if len(drive.bodies) > 1 else []

    def named(text: str) -> str:
        for old, new in texts:
            text = text.replace(old, new if old != "motor.inertia" else "the inertia at the motor")
        return text

    findings = tuple(f.replace(text=named(f.text), action=named(f.action), parameter=rigid.names.get(
        f.parameter or "")) for f in found.findings)
    return replace(found, drive=drive.with_values(values), covariance=covariance, findings=findings,
                   parameters=in_order(lines.values(), drive))


def _as_drive_parameter(p: Parameter, drive: Drive, rigid: RigidDrive) -> Parameter:
    """A parameter of one body under the drive's name; the inertia less the rest."""
    name = rigid.names[p.name]
    p = p.replace(name=name, unit=drive.unit(name), start=drive.values.get(name))
    if name != rigid.target:
        return p
    value = rigid.factor * (p.value - rigid.rest)
    if rigid.unknown:
        reason = f"{' and '.join(rigid.unknown)} not known; included in this value"
        return p.replace(value=value).without_interval(reason, "not-identifiable")
    if p.std is None:
        return p.replace(value=value).without_interval(p.reason, p.status)
    std = float(rigid.factor * np.hypot(p.std, np.sqrt(rigid.variance)))
    # From few recordings the interval is wider than that of a normal variable.
    half = std * (p.ci95[1] - p.ci95[0]) / (2.0 * p.std) if p.ci95 is not None else Z95 * std
    parts = {n: rigid.factor * v for n in ("std_structure", "std_between", "repeatability")
             if (v := getattr(p, n)) is not None}
    noise = None if p.std_noise is None else float(rigid.factor * np.hypot(p.std_noise, np.sqrt(rigid.variance)))
    return p.replace(value=value).with_interval(std, (0.0, np.inf), half, std_noise=noise, **parts)


def _covariance(found: Covariance | None, names: Mapping[str, str], rigid: RigidDrive) -> Covariance | None:
    """Of the drive's parameters."""
    kept = found and found.part(n for n in found.names if n in names)
    if kept is None:
        return None
    own = [names[n] for n in kept.names]
    size = np.array([rigid.factor if n == rigid.target else 1.0 for n in own])
    matrix = kept.matrix * np.outer(size, size)
    if rigid.target in own:
        at = own.index(rigid.target)
        matrix[at, at] += rigid.factor**2 * rigid.variance
    return Covariance(tuple(own), matrix)


def _unknown_rest_findings(rigid: RigidDrive, estimate: Estimate, drive: Drive) -> list[Finding]:
    """A finding where inertias that turn with the motor are not known."""
    if not rigid.unknown:
        return []
    value, unit = estimate.drive.values[rigid.target], drive.unit(rigid.target)
    return [Finding(
        "warning", "rotating-parts-unknown",
        f"{' and '.join(rigid.unknown)} {'is' if len(rigid.unknown) == 1 else 'are'} not known; "
        f"{rigid.target} = {value:.5g} {unit} includes {'it' if len(rigid.unknown) == 1 else 'them'}.",
        {rigid.target: value},
        f"Give it with --set {rigid.unknown[0]}=VALUE, or fit this recording together with one in which the "
        f"{drive.bodies[-1]} is clamped: greybox --record FILE clamped={drive.bodies[-1]}.")]


def _outcome_text(spans: Sequence[Span], experiments: Sequence[Experiment], drive: Drive) -> str:
    torques = [s.torque for s in spans]
    speeds = [float(f(s.speed)) for s in spans for f in (np.min, np.max)]
    return (f"{len(spans)} intervals of constant torque, {min(torques):.4g} to {max(torques):.4g} "
            f"{drive.torque_unit}, over {min(speeds):.4g} to {max(speeds):.4g} {experiments[0].motion_unit}/s.")


def _span_details(spans: Sequence[Span], experiments: Sequence[Experiment]) -> list[dict[str, object]]:
    """The spans as plain numbers."""
    return [{"file": e.name, "start": e.offset + s.first * e.step, "end": e.offset + s.last * e.step,
             "torque": s.torque, "speed_from": float(s.speed[0]), "speed_to": float(s.speed[-1])}
            for s in spans for e in (experiments[s.recording],)]


def _friction_plot(spans: Sequence[Span], rigid: Drive, drive: Drive) -> PlotData:
    """The torque minus inertia times acceleration, which is friction, over the speed."""
    value = {n: rigid.value(f"motor.{n}") for n in ("inertia", "viscous", "idle_torque", "coulomb")}
    speed = np.concatenate([s.speed for s in spans])
    friction = np.concatenate([s.torque - value["inertia"] * s.slope for s in spans])
    curves = {"measured": (speed, friction)}
    for sign, name in ((1.0, "fit forward"), (-1.0, "fit backward")):
        if side := [float(w) for w in speed if np.sign(w) == sign]:
            ends = np.array([min(side), max(side)])
            curves[name] = (ends, value["idle_torque"] + value["viscous"] * ends + sign * value["coulomb"])
    return PlotData("steady", "Torque minus inertia times acceleration (friction)",
                    f"speed [{drive.motion_unit}/s]", f"torque [{drive.torque_unit}]", curves)

