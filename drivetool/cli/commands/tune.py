"""Settings of the speed controller.

PI for load-torque steps under a limit of the sensitivity, with margins and what uncertainty and backlash do to
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from drivetool.cli.options import Job, check_outputs, common as cli, with_set_values
from drivetool.cli.output import deliver
from drivetool.errors import BadOption, BadParameters, nearest
from drivetool.files.yaml import units

if TYPE_CHECKING:
    from drivetool.drive import Drive
    from drivetool.files.yaml import Loaded, StatedDrive
    from drivetool.tune import TuneOptions

EXAMPLE = 'drivetool tune -p backlash.yaml --converter "433,0.69,2 ms" --out gains.yaml'

# How the dead time enters.
DeadTimeForm = StrEnum("DeadTimeForm", ("exact", "zero"))
Params = Annotated[list[str], typer.Option(
    "--params", "-p", metavar="FILE", help="Parameter file of an earlier step or by hand; several merge, later "
    "wins; - reads standard input.")]
Map = Annotated[str | None, typer.Option(
    "--map", "-m", metavar="FILE", help="Channel map; says whether a shaft torque is measured.")]
Converter = Annotated[str | None, typer.Option(
    "--converter", metavar="BANDWIDTH[,DAMPING[,DEAD_TIME]]",
    help="Torque path, with units if not rad/s and s: '433,0.69,2 ms'. What is left out is as in the parameter "
    "file; a dead time that neither states counts as none.")]
Criterion = Annotated[str, typer.Option("--criterion", metavar="NAME", help="IAE, ISE, IE, ITSE, IT2SE ...")]
Sensitivity = Annotated[float, typer.Option(
    "--max-sensitivity", metavar="MS", help="Largest sensitivity, above 1.")]
MaxGain = Annotated[str | None, typer.Option(
    "--max-gain", metavar="KP", help="Largest Kp, in the drive's unit; for a speed signal that is noisy.")]
Weight = Annotated[list[str] | None, typer.Option(
    "--weight", metavar="SIGNAL=W", help="Weight in the criterion of load_speed (1), motor_speed or "
    "motor_torque (0); repeatable.")]
Configuration = Annotated[list[str] | None, typer.Option(
    "--configuration", metavar="NAME", help="siso, miso or mimo; repeatable. Default: all that fit the drive.")]
Motors = Annotated[str | None, typer.Option(
    "--motors", metavar="NAMES", help="Driven bodies, separated by commas. Default: those called motor...")]
Filter = Annotated[str | None, typer.Option(
    "--speed-filter", metavar="TIME", help="Time constant of the controller's filter of the speed: '2 ms'. It "
    "stands in series with the sensor.bandwidth of the parameter file.")]
Speed = Annotated[str | None, typer.Option(
    "--speed", metavar="SPEED", help="Working speed of the first motor, at which friction is linearised: "
    "'1500 rpm'. Default: slow motion forward.")]
DeadTime = Annotated[DeadTimeForm, typer.Option(
    "--dead-time", help="exact, or zero: the printed 1 - s td/2 of Tallfors 2005, half the delay.")]
Confidence = Annotated[float | None, typer.Option(
    "--confidence", metavar="P", help="Hold the sensitivity in this share of the drives that the covariance "
    "allows, for example 0.95.")]
DrawCount = Annotated[int, typer.Option("--draws", metavar="N", min=20, max=100000, help="Of the covariance.")]
PerUnit = Annotated[bool, typer.Option("--per-unit", help="Table per unit; needs ratings in a parameter file.")]


def command(
    params: Params, converter: Converter = None, criterion: Criterion = "IAE",
    max_sensitivity: Sensitivity = 2.0, max_gain: MaxGain = None, weight: Weight = None,
    configuration: Configuration = None, motors: Motors = None, speed_filter: Filter = None,
    speed: Speed = None, dead_time: DeadTime = DeadTimeForm.exact, confidence: Confidence = None,
    draws: DrawCount = 200, map: Map = None,
    set: cli.Set = None, seed: cli.Seed = 1, per_unit: PerUnit = False, out: cli.Out = None, json: cli.Json = False,
    plot: cli.Plot = None, strict: cli.Strict = False, debug: cli.Debug = False, quiet: cli.Quiet = False,
) -> int:
    """Its options; the exit code."""
    job = Job("tune", (), params, map, None, set or (), out, json, plot, strict, quiet)
    words = {
        "criterion": criterion, "max_sensitivity": max_sensitivity, "max_gain": max_gain,
        "weight": list(weight or ()), "converter": converter,
        "configuration": list(configuration or ()), "motors": motors,
        "speed_filter": speed_filter, "speed": speed, "dead_time": dead_time.value,
        "confidence": confidence, "draws": draws,
        "seed": seed, "set": list(set or ()), "per_unit": per_unit}
    return run(job, words)


def run(job: Job, words: dict[str, object]) -> int:
    """Read, design, deliver; the exit code."""
    from drivetool.files.results import gains_file
    from drivetool.files.yaml import load_parameters
    from drivetool.tune import tune

    check_outputs(job)
    loaded = load_parameters(job.params)
    stated = _with_converter(with_set_values(loaded.stated(), job.set), words["converter"])
    options = replace(_tune_options(job, words, stated.start, loaded), unidentified=stated.unidentified)
    gains = tune(stated.start, options, draw_pictures=bool(job.plot))
    _, doubts = stated.assumed(warn=any(each.watches for each in gains.designs))
    gains = replace(gains, findings=(*doubts, *gains.findings))
    return deliver(job, gains_file(gains, loaded.inputs, words), gains.exhibits, bool(words["per_unit"]))


def _tune_options(job: Job, words: dict[str, object], drive: Drive, loaded: Loaded) -> TuneOptions:
    """The options of the tuning, from the command line and the files."""
    from drivetool.tune import Ratings, TuneOptions, gain_unit
    from drivetool.tune.optimisation import TuneLimits, criterion

    rated = loaded.ratings(drive)
    if words["per_unit"] and rated is None:
        raise BadParameters(
            "ratings for per-unit figures", "none in the parameter files",
            "Add 'ratings: {torque: {value: 100, unit: Nm}, speed: {value: 1500, unit: rpm}}' to one.")
    filter_time = words["speed_filter"]
    gain, speed = words["max_gain"], words["speed"]
    return TuneOptions(
        criterion=criterion(str(words["criterion"]), _weights(words["weight"])),
        limits=TuneLimits(float(words["max_sensitivity"]),
                      float("inf") if gain is None else _number_in_unit(gain, gain_unit(drive), "--max-gain")),
        configurations=_configurations(words["configuration"]),
        motors=tuple(m.strip() for m in words["motors"].split(",")) if words["motors"] else None,
        speed_filter=loaded.speed_filter if filter_time is None else _limited_number(
            filter_time, "s", "--speed-filter", "a filter time of zero or more", 1e3, least=0.0),
        speed=0.0 if speed is None else _limited_number(
            speed, f"{drive.motion_unit}/s", "--speed", "a working speed", 1e6),
        dead_time=words["dead_time"], shaft_torque=_shaft_torque(job, loaded), confidence=words["confidence"],
        draws=words["draws"], seed=words["seed"], known=loaded.covariance(drive), stds=loaded.stds(drive),
        ratings=rated and Ratings(*rated))


def _configurations(names: Sequence[str]) -> tuple | None:
    """The requested configurations, in their usual order."""
    known = ("siso", "miso", "mimo")
    for name in names:
        if name not in known:
            raise BadOption("siso, miso or mimo after --configuration", f"'{name}'", nearest(name, known))
    return tuple(name for name in known if name in names) or None


def _weights(words: Sequence[str]) -> dict[str, float]:
    """'motor_torque=1e-4' as signal and weight."""
    found = {}
    for word in words:
        name, _, number = word.partition("=")
        try:
            found[name.strip()] = float(number)
        except ValueError:
            raise BadOption("SIGNAL=W after --weight", f"'{word}'",
                            "Write for example '--weight motor_torque=1e-4'.") from None
    return found


def _with_converter(stated: StatedDrive, text: object) -> StatedDrive:
    """The drive with the torque path of --converter, which is known."""
    if text is None:
        return stated
    parts = [part.strip() for part in str(text).split(",")]
    if not 1 <= len(parts) <= 3:
        raise BadOption("BANDWIDTH[,DAMPING[,DEAD_TIME]] after --converter", f"'{text}'",
                        "Write for example '--converter 433,0.69,0.002'.")
    names = ("bandwidth", "damping", "dead_time")
    units = ("rad/s", "", "s")
    return stated.with_values({
        f"converter.{name}": _number_in_unit(part, unit, "--converter")
        for name, unit, part in zip(names, units, parts, strict=False)})


def _limited_number(text: object, unit: str, option: str, what: str, limit: float,
                    least: float = float("-inf")) -> float:
    """A number in a unit, its size below a limit."""
    value = _number_in_unit(text, unit, option)
    if not (least <= value and abs(value) < limit):
        raise BadOption(f"{what} after {option}", f"{value:g} {unit}", "Correct it.")
    return value


def _number_in_unit(text: object, wanted: str, option: str) -> float:
    """'2 ms' in the wanted unit."""
    number, _, unit = str(text).strip().partition(" ")
    try:
        value = float(number)
    except ValueError:
        raise BadOption(f"a number after {option}, with a unit if it is not {wanted or 'plain'}", f"'{text}'",
                        "Correct it.") from None
    return value * (units.conversion_factor(unit.strip(), wanted, option) if unit else 1.0)


def _shaft_torque(job: Job, loaded: Loaded) -> bool:
    """Whether a shaft torque is measured, by the channel map or by the noise that an estimator found."""
    from drivetool.files.yaml import load_channel_map

    channel_map = load_channel_map(job.map)
    mapped = channel_map is not None and "shaft_torque" in channel_map.roles
    return mapped or "sensor_std.shaft_torque" in loaded.noise
