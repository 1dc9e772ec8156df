"""Mass and friction from intervals of constant torque: the drive accelerates, or coasts, as one body.

Straight lines through the speed are wrong where friction is viscous: here J dw/dt = T - T0 - c w - Tc sgn(w) is
fitted, with the noise of torque and sensor. What turns with the motor is then subtracted from what it accelerates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import TOTALS, Drive, one_body
from drivetool.errors import BadOption, BadParameters, Finding
from drivetool.identify.acceleration.road import UNLIKELY, mean_of_recordings, slope_of_the_road
from drivetool.identify.acceleration.spans import (
    Span,
    averaged,
    first_values,
    off_the_line,
    spans_of,
    turns_both_ways,
)
from drivetool.identify.channels import doubted_units
from drivetool.identify.estimate import Z95, Covariance, Estimate, Exhibit, Parameter
from drivetool.identify.greybox import greybox
from drivetool.identify.plateaus import in_one_direction, record_with
from drivetool.identify.setup import Options
from drivetool.logs import Experiment

MOST = 400  # blocks of the longest span: the speed is a smooth curve, of which more tell nothing more
FEWEST = 60  # blocks of the longest span, of which a fit needs ten for a stretch and its findings some dozens
DRAG = "motor.drag"
BENT = 4.0  # standard deviations of a square that is stated: chance alone exceeds them once in 30 000 recordings


@dataclass(frozen=True)
class Rigid:
    """The drive as one body at its motor.

    names    of its parameters -> what they are called in the drive; target: the drive's name of what is left of the
             inertia when the rest is subtracted
    factor   from an inertia at the motor to the target; rest: inertia of everything else at the motor
    variance of the rest, by the parameter files
    unknown  inertias of the rest that nobody gave
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
    drive        what is known of the rotating parts, the gear and the radius; start values are not needed
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
    # No free runs for a witness: with a torque of its own each tells nothing where the logged torque is constant.
    asked = replace(options, known=None, free=(), criterion="innovations",
                    hold=tuple(n for n in rigid.names if rigid.names[n] in options.hold))
    shared, cut = _fitted(experiments, spans, start, asked)
    found = mean_of_recordings(shared, cut, start, asked)
    estimate = in_the_drive(found.estimate, drive, rigid)
    road = slope_of_the_road(found, estimate, drive, rigid.target)
    forward = sum(bool(s.speed.mean() > 0.0) for s in spans)
    one_way = [] if turns_both_ways(spans) else [
        in_one_direction(rigid.names["motor.idle_torque"], forward, len(spans) - forward)]
    return replace(
        estimate, step="steady", outcome=_outcome(spans, experiments, drive),
        details={**estimate.details, "spans": _listed(spans, experiments),
                 "inertia_at_motor": _plain(found.estimate, "motor.inertia"),
                 **({"idle_torque_by_record": found.by_record} if found.by_record else {})},
        findings=(*_units(estimate, drive, rigid), *_lines_apart(spans), *_bent(shared, cut, start, asked), *road,
                  *_of_the_rest(rigid, estimate, drive), *one_way, *estimate.findings),
        exhibits=(_picture(spans, found.estimate.drive, drive), *(
            record_with("intervals of constant torque", e, [(s.first, s.last) for s in spans if s.recording == k],
                        drive) for k, e in enumerate(experiments))))


def held_value(name: str, drive: Drive, rigid: Rigid) -> float:
    """Value of a parameter of one body that the drive's own holds."""
    own = rigid.names[name]
    if own == rigid.target:
        return rigid.rest + (drive.value(own) or 0.0) / rigid.factor
    if own.startswith("total.") and own not in drive.values:
        return drive.felt(name.rpartition(".")[2])
    return drive.value(own) or 0.0


def rigid_of(drive: Drive, options: Options) -> Rigid:
    """How the drive's parameters follow from those of one body.

    raises  BadOption: a part of a friction is to be held, which only the sum shows
    """
    last, turns = drive.bodies[-1], drive.turns()[-1]
    carries = bool(drive.value(f"{last}.carried_mass")) or f"{last}.radius" in drive.values
    target = f"{last}.carried_mass" if carries else f"{last}.inertia"
    first, several = drive.bodies[0], len(drive.bodies) > 1
    friction = {n: f"total.{n}" if several else f"{first}.{n}" for n in TOTALS.values()} | {
        "coulomb": f"{first}.coulomb"}  # one body stands for all
    names = {f"motor.{n}": whole for n, whole in friction.items()} | {"motor.inertia": target}
    parts = [n for n in options.hold if n.rpartition(".")[2] in friction and n not in names.values()]
    if parts:
        raise BadOption("the friction of the whole drive after --hold of --method acceleration", ", ".join(parts),
                        f"Hold {friction[parts[0].rpartition('.')[2]]}: only the sum shows.")
    if options.free:
        raise BadOption("--hold, and no --free, with --method acceleration", f"--free {options.free[0]}",
                        "Leave it out: mass, constant and viscous friction are fitted. Others are for greybox.")
    own = drive.with_values({target: 0.0} if carries else {})
    masses = own.inertias()
    masses[-1] -= 0.0 if carries else own.value(target) or 0.0
    rest = float(sum(j / n**2 for j, n in zip(masses, drive.turns(), strict=True)))
    others = [n for n in (f"{b}.inertia" for b in drive.bodies) if n != target]
    radius = drive.value(f"{last}.radius") if carries else 1.0
    return Rigid(names, target, turns**2 / radius**2, rest, _variance(others, drive, options.known),
                 tuple(n for n in others if n not in drive.values))


def _variance(names: Sequence[str], drive: Drive, known: Covariance | None) -> float:
    """Of the sum of inertias at the motor, as far as parameter files say."""
    if known is None:
        return 0.0
    turns = dict(zip(drive.bodies, drive.turns(), strict=True))
    shares = np.array([turns[n.partition(".")[0]] ** -2 if n in names else 0.0 for n in known.names])
    return float(shares @ known.matrix @ shares)


def _fitted(experiments: Sequence[Experiment], spans: Sequence[Span], start: Drive,
            options: Options) -> tuple[Estimate, list[Experiment]]:
    """The fit of one body, and the recordings as they were fitted.

    Torque noise swings a shaft, which one body has not. Means over blocks are taken, the shortest that leave the
    one-step errors white.
    """
    longest = max(s.last - s.first for s in spans)
    length = max(1, longest // MOST)
    while True:
        cut = [averaged(e, mine, length) for k, e in enumerate(experiments)
               if (mine := [s for s in spans if s.recording == k])]
        found = greybox(cut, start, options)
        if not found.repeats or longest < 2 * length * FEWEST:
            return found, cut
        length *= 2


def _units(estimate: Estimate, drive: Drive, rigid: Rigid) -> list[Finding]:
    """That the whole inertia is far off what the given values make of it."""
    before, after = drive.value(rigid.target), estimate.drive.values[rigid.target]
    if not before or rigid.unknown:
        return []
    return doubted_units((rigid.rest + after / rigid.factor) / (rigid.rest + before / rigid.factor))


def _lines_apart(spans: Sequence[Span]) -> list[Finding]:
    """That no one friction line fits all intervals."""
    probability = off_the_line(spans)
    if probability > UNLIKELY:
        return []
    return [Finding(
        "warning", "scatter-beyond-noise",
        "The intervals of constant torque do not follow one inertia and one friction line: what one leaves "
        f"exceeds its noise (probability {probability:.1g}).", {"probability": probability},
        "Check the sign of the torque in every interval; look for a load, a slope or a brake that acts in some of "
        "them, and for friction that bends.")]


def _bent(shared: Estimate, cut: Sequence[Experiment], start: Drive, options: Options) -> list[Finding]:
    """That the friction is no line over the speed: it has a square that the recordings tell."""
    found = greybox(cut, start.with_values({**shared.drive.values, DRAG: 0.0}), replace(options, free=(DRAG,)))
    line = next(p for p in found.parameters if p.name == DRAG)
    if line.std is None or line.value < BENT * line.std:
        return []
    return [Finding(
        "warning", "friction-is-bent",
        f"Friction grows with the square of the speed: {line.value:.3g} +- {line.std:.2g} {line.unit}. The line of "
        "constant and viscous friction has no place for it.",
        {"drag": line.value, "std": line.std},
        f"Fit it on the same recordings: greybox --drive one-body --set motor.inertia="
        f"{found.drive.values['motor.inertia']:.3g} --free motor.drag.")]


def in_the_drive(found: Estimate, drive: Drive, rigid: Rigid) -> Estimate:
    """What was found of one body, its motor, as parameters of the drive that it stands for."""
    lines = {p.name: _line(p, drive, rigid) for p in found.parameters if p.name in rigid.names}
    values = {p.name: p.value for p in lines.values() if np.isfinite(p.value)}
    if values[rigid.target] <= 0.0:
        raise BadParameters(f"rotating parts that are smaller than what the motor accelerates, "
                            f"{found.drive.values['motor.inertia']:.4g} {drive.unit(f'{drive.bodies[0]}.inertia')}",
                            f"{rigid.rest:.4g} at the motor", "Correct their inertias, or the "
                            "ratio; recorded alone, the motor tells its own.")
    if "motor.coulomb" in lines:  # what the others had would count twice
        values |= {n: 0.0 for n in (f"{b}.coulomb" for b in drive.bodies[1:]) if drive.values.get(n)}
    told = {n: line.std is not None for n, line in lines.items()}
    covariance = _covariance(found.covariance, {n: rigid.names[n] for n in told if told[n]}, rigid)
    texts = sorted(rigid.names.items()) if len(drive.bodies) > 1 else []

    def named(text: str) -> str:
        for old, new in texts:
            text = text.replace(old, new if old != "motor.inertia" else "the inertia at the motor")
        return text

    findings = tuple(replace(f, text=named(f.text), action=named(f.action), parameter=rigid.names.get(
        f.parameter or "")) for f in found.findings)
    order = list(drive.quantities)
    return replace(found, drive=drive.with_values(values), covariance=covariance, findings=findings,
                   parameters=tuple(sorted(lines.values(), key=lambda p: order.index(p.name))))


def _line(p: Parameter, drive: Drive, rigid: Rigid) -> Parameter:
    """A parameter of one body under the drive's name; of the inertia what is left of it."""
    name = rigid.names[p.name]
    p = replace(p, name=name, unit=drive.unit(name), start=drive.values.get(name))
    if name != rigid.target:
        return p
    value = rigid.factor * (p.value - rigid.rest)
    if rigid.unknown:
        reason = f"{' and '.join(rigid.unknown)} not known, and counted in it"
        return replace(p, value=value).untold(reason, "not-identifiable")
    if p.std is None:
        return replace(p, value=value).untold(p.reason, p.status)
    std = float(rigid.factor * np.hypot(p.std, np.sqrt(rigid.variance)))
    # Of a few recordings the interval is wider than that of a normal variable.
    half = std * (p.ci95[1] - p.ci95[0]) / (2.0 * p.std) if p.ci95 is not None else Z95 * std
    parts = {n: rigid.factor * v for n in ("std_structure", "std_between", "repeatability")
             if (v := getattr(p, n)) is not None}
    noise = None if p.std_noise is None else float(rigid.factor * np.hypot(p.std_noise, np.sqrt(rigid.variance)))
    return replace(p, value=value, std=std, ci95=(max(value - half, 0.0), value + half), std_noise=noise, **parts)


def _covariance(found: Covariance | None, names: Mapping[str, str], rigid: Rigid) -> Covariance | None:
    """Of the drive's parameters."""
    kept = [i for i, n in enumerate(found.names) if n in names] if found is not None else []
    if not kept:
        return None
    own = [names[found.names[i]] for i in kept]
    size = np.array([rigid.factor if n == rigid.target else 1.0 for n in own])
    matrix = found.matrix[np.ix_(kept, kept)] * np.outer(size, size)
    if rigid.target in own:
        at = own.index(rigid.target)
        matrix[at, at] += rigid.factor**2 * rigid.variance
    return Covariance(tuple(own), matrix)


def _of_the_rest(rigid: Rigid, estimate: Estimate, drive: Drive) -> list[Finding]:
    """That what turns with the motor is not known."""
    if not rigid.unknown:
        return []
    value, unit = estimate.drive.values[rigid.target], drive.unit(rigid.target)
    return [Finding(
        "warning", "rotating-parts-unknown",
        f"{' and '.join(rigid.unknown)} {'is' if len(rigid.unknown) == 1 else 'are'} not known, so that "
        f"{rigid.target} = {value:.5g} {unit} has that in it.", {rigid.target: value},
        f"Give it with --set {rigid.unknown[0]}=VALUE, or fit a record with the {drive.bodies[-1]} clamped beside "
        f"this one: greybox --record FILE clamped={drive.bodies[-1]}.")]


def _outcome(spans: Sequence[Span], experiments: Sequence[Experiment], drive: Drive) -> str:
    torques = [s.torque for s in spans]
    speeds = [float(f(s.speed)) for s in spans for f in (np.min, np.max)]
    return (f"{len(spans)} intervals of constant torque, {min(torques):.4g} to {max(torques):.4g} "
            f"{drive.torque_unit}, over {min(speeds):.4g} to {max(speeds):.4g} {experiments[0].motion_unit}/s.")


def _listed(spans: Sequence[Span], experiments: Sequence[Experiment]) -> list[dict[str, object]]:
    """The spans as plain numbers."""
    return [{"file": e.name, "start": e.offset + s.first * e.step, "end": e.offset + s.last * e.step,
             "torque": s.torque, "speed_from": float(s.speed[0]), "speed_to": float(s.speed[-1])}
            for s in spans for e in (experiments[s.recording],)]


def _plain(found: Estimate, name: str) -> dict[str, float | None]:
    line = next(p for p in found.parameters if p.name == name)
    return {"value": line.value, "std": line.std}


def _picture(spans: Sequence[Span], rigid: Drive, drive: Drive) -> Exhibit:
    """What is left of the torque for friction, over the speed."""
    value = {n: rigid.value(f"motor.{n}") for n in ("inertia", "viscous", "idle_torque", "coulomb")}
    speed = np.concatenate([s.speed for s in spans])
    left = np.concatenate([s.torque - value["inertia"] * s.slope for s in spans])
    curves = {"measured": (speed, left)}
    for sign, name in ((1.0, "fit forward"), (-1.0, "fit backward")):
        if side := [float(w) for w in speed if np.sign(w) == sign]:
            ends = np.array([min(side), max(side)])
            curves[name] = (ends, value["idle_torque"] + value["viscous"] * ends + sign * value["coulomb"])
    return Exhibit("steady", "Torque less what accelerates", f"speed [{drive.motion_unit}/s]",
                   f"torque [{drive.torque_unit}]", curves)

