"""From tuned gains to the gains file, and back to the controller for a replay."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import BinaryIO

from drivetool.drive import Drive
from drivetool.errors import BadOption
from drivetool.files.results.result_file import (
    Inputs,
    drive_section,
    file_sections,
    finding_sections,
    tool_section,
)
from drivetool.files.shapes import gains_shapes as shapes
from drivetool.files.yaml import checked, from_yaml, read_bytes, to_plain, written
from drivetool.tune import Design, Gains, Ratings, gain_unit
from drivetool.tune.optimisation import SpeedFactors
from drivetool.tune.speed_loop import SHAFT_TORQUE_SHARE, Settings, Wiring


def gains_file(gains: Gains, inputs: Inputs = (), options: dict[str, object] | None = None) -> shapes.GainsFile:
    """The gains file.

    inputs   (name, sha256) of the parameter files
    options  of the command line, as they were used
    """
    used, drive = gains.options, gains.drive
    ratings = used.ratings and {
        "torque": shapes.Figure(value=used.ratings.torque, unit=drive.torque_unit),
        "speed": shapes.Figure(value=used.ratings.speed, unit=f"{drive.motion_unit}/s")}
    return shapes.GainsFile(
        schema=shapes.GAINS_SCHEMA, tool=tool_section(), step="tune", outcome=gains.outcome,
        drive=drive_section(drive),
        criterion=written(used.criterion, shapes.CriterionSection),
        constraint=shapes.ConstraintSection(
            max_sensitivity=float(used.limits.sensitivity), max_gain=to_plain(used.limits.gain),
            confidence=used.confidence),
        best=gains.best.wiring.configuration,
        designs=[_design_section(drive, design, gains) for design in gains.designs],
        findings=finding_sections(gains.findings), inputs=file_sections(inputs), ratings=ratings,
        options=to_plain(options or {}))


def load_gains(path: str | Path, stdin: BinaryIO | None = None) -> tuple[str, str, shapes.GainsFile]:
    """(file name, sha256, content) of a gains file.

    raises  BadParameters: not a gains file
    """
    name, data = read_bytes(path, stdin)
    return name, hashlib.sha256(data).hexdigest(), checked.gains_file(from_yaml(data, name), name)


def controller_of(file: shapes.GainsFile, name: str, configuration: str | None = None) -> tuple[Wiring, Settings]:
    """The wiring and settings of a design: the requested one, else the best.

    raises  BadOption: the file has no such design
    """
    wanted = configuration or file.best
    found = [d for d in file.designs if d.configuration == wanted]
    if not found:
        raise BadOption(f"a {wanted} design in {name}", "none", "Choose another --configuration.",
                        [d.configuration for d in file.designs])
    design = found[0]
    second = design.gains.kp2.value / design.gains.kp.value if design.gains.kp2 else 1.0
    return (Wiring(design.configuration, tuple(design.motors), design.speed_filter.value, design.dead_time_form),
            Settings(design.gains.kp.value, design.gains.ti.value, second))


def _design_section(drive: Drive, design: Design, gains: Gains) -> shapes.DesignSection:
    """One design in SI and per unit."""
    base, settings, kind = gains.options.ratings, design.settings, design.wiring.configuration

    def kp(value: float) -> shapes.Figure:
        per_unit = value * base.speed / base.torque if base else None
        return shapes.Figure(value=value, unit=gain_unit(drive), per_unit=per_unit,
                             per_unit_unit="p.u." if base else "")

    section = shapes.GainsSection(
        kp=kp(settings.gain), ti=_seconds(settings.integral_time),
        kp2=kp(settings.second * settings.gain) if kind == "miso" else None,
        ti2=_seconds(settings.second * settings.integral_time) if kind == "miso" else None,
        k3=shapes.Figure(value=SHAFT_TORQUE_SHARE, unit="") if kind == "mimo" else None)
    return shapes.DesignSection(
        configuration=kind, motors=list(design.wiring.motors), speed_filter=_seconds(design.wiring.speed_filter),
        dead_time_form=design.wiring.dead_time, gains=section,
        criterion_value=_criterion_value(drive, design, gains),
        active=design.active,
        factors=shapes.FactorsSection(
            load_speed=_speed_section(drive, design.factors.load, base),
            motor_speed=_speed_section(drive, design.factors.motor, base),
            torque_overshoot_percent={k: float(v) for k, v in design.factors.torque_overshoot.items()}),
        margins=written(design.margins, shapes.MarginsSection),
        variations=[written(each, shapes.VariationSection) for each in design.variations],
        spread=design.spread and written(design.spread, shapes.SpreadSection), kept=design.kept,
        hunting=[written(watch, shapes.HuntingSection) for watch in design.watches],
        gain_without_cycle=design.safe_gain)


def _speed_section(drive: Drive, speed: SpeedFactors, base: Ratings | None) -> shapes.SpeedSection:
    """Figures of a unit step."""
    q, t = drive.motion_unit, drive.torque_unit
    drop, ie, iae = (_of_load_step(value, f"{q}/{t}", "% s", base)
                     for value in (speed.impact_drop, speed.ie, speed.iae))
    return shapes.SpeedSection(
        peak=_of_load_step(speed.peak, f"({q}/s)/{t}", "%", base), impact_drop=drop,
        overshoot_percent=speed.overshoot, settling_time=_seconds(speed.settling_time),
        ie=ie, ise=_of_load_step(speed.ise, f"({q}/s)^2 s/{t}^2", "%^2 s", base, 2), iae=iae)


def _criterion_value(drive: Drive, design: Design, gains: Gains) -> shapes.Figure:
    """The criterion's value; its unit where it is of the load speed alone."""
    wanted, base = gains.options.criterion, gains.options.ratings
    if wanted.weights != {"load_speed": 1.0}:
        return shapes.Figure(value=design.value, unit="weighted")
    q, t, power = drive.motion_unit, drive.torque_unit, wanted.power
    if power is None:
        return _of_load_step(design.value, f"{q}/{t}", "% s", base)
    time = f"s^{power + 1}" if power else "s"
    return _of_load_step(design.value, f"({q}/s)^2 {time}/{t}^2", f"%^2 {time}", base, 2)


def _of_load_step(value: float, unit: str, per_unit: str, base: Ratings | None, power: int = 1) -> shapes.Figure:
    """A figure of a unit step; per unit for a step of the rated torque, in % of the rated speed."""
    if base is None:
        return shapes.Figure(value=value, unit=unit)
    scale = 100.0 * base.torque / base.speed
    return shapes.Figure(value=value, unit=unit, per_unit=value * scale**power, per_unit_unit=per_unit)


def _seconds(value: float) -> shapes.Figure:
    return shapes.Figure(value=float(value), unit="s")
