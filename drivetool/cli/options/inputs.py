"""From the command line to experiments, parameters and a drive; all of it before anything runs."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivetool.cli.options.job import Job, Opened
from drivetool.cli.options.units_of import units_of
from drivetool.errors import BadOption, BadParameters, DriveToolError, nearest
from drivetool.files.disk import check_folder, check_target
from drivetool.files.yaml import units
from drivetool.logs import ROLES

if TYPE_CHECKING:
    from drivetool.drive import Drive
    from drivetool.files.yaml import Loaded, StatedDrive
    from drivetool.finding import Finding
    from drivetool.identify.setup import KnownStart, Options


def open_all(job: Job) -> Opened:
    """Read the parameter files, the drive file, the map and then the logs, which take longest."""
    from drivetool.files.yaml import load_channel_map, load_parameters
    from drivetool.logs.conditioning import parse_step
    from drivetool.logs.door import open_experiment

    check_outputs(job)
    loaded = load_parameters(job.params)
    shape = _drive_file(job)
    channel_map = load_channel_map(job.map)
    for text in job.condition:
        parse_step(text)
    further = _further_roles(job, loaded, shape)
    experiments = []
    for log in job.logs:
        with _path_as_given(log):
            experiments.append(open_experiment(log, channel_map, job.condition, further))
    return Opened(tuple(experiments), loaded, shape)


@contextlib.contextmanager
def _path_as_given(log: str) -> Iterator[None]:
    """Errors name a recording by its path as given; results know an absolute one by its file's name alone."""
    try:
        yield
    except DriveToolError as error:
        name = os.path.basename(log)
        if not os.path.isabs(log) or log in f"{error.wanted} {error.found}":
            raise
        raise type(error)(error.wanted.replace(name, log), error.found.replace(name, log), error.do,
                          error.available) from None


def _further_roles(job: Job, loaded: Loaded, shape: Loaded | None) -> list[str]:
    """The roles of bodies and shafts that the drive has besides those of the table."""
    from drivetool.drive import KNOWN_DRIVES
    from drivetool.identify.setup import sensors_of

    drive = KNOWN_DRIVES[job.drive]() if job.drive and not shape else (shape or loaded).chain()
    return [role for choices in sensors_of(drive) for role in choices if role not in ROLES]


def drive_for(job: Job, opened: Opened, loaded: Loaded | None = None, free: Sequence[str] = ()) -> StatedDrive:
    """The drive to work with: --drive, else the parameter file's, else two masses.

    loaded  the parameter files to take values from; None: all of them
    free    names of what is to be fitted
    """
    from drivetool.drive import KNOWN_DRIVES, two_mass
    from drivetool.files.yaml import StatedDrive

    loaded = loaded or opened.loaded
    units = units_of(job, opened, loaded, free)
    stated = StatedDrive(loaded.structure(two_mass(*units)))
    if opened.shape:
        stated = opened.shape.stated(two_mass(*units))
    elif job.drive:
        stated = StatedDrive(replace(KNOWN_DRIVES[job.drive](*units), damping_law=stated.start.damping_law))
    return with_set_values(loaded.fill(stated), job.set)


def with_torques(opened: Opened, drive: Drive, free: Sequence[str] = (), off_too: bool = False,
                 ) -> tuple[Opened, Drive]:
    """The recordings with inputs in A, V or % as torques, and the drive with the torque constants used.

    Of an induction motor with voltages of its supply in their frame; off_too: also where that is off.
    """
    from drivetool.identify.setup import as_stator_voltages, as_torques

    experiments, drive = as_stator_voltages(*as_torques(opened.experiments, drive, free), off_too)
    return replace(opened, experiments=experiments), drive


def with_set_values(stated: StatedDrive, words: Sequence[str]) -> StatedDrive:
    """The drive with the values of --set, which are known."""
    with errors_as_usage():
        return stated.with_values(dict(start_value(word, stated.start) for word in words))


@contextlib.contextmanager
def errors_as_usage() -> Iterator[None]:
    """Errors of a name or a value become usage errors where an option gave it."""
    try:
        yield
    except BadParameters as error:
        raise BadOption(error.wanted, error.found, error.do, error.available) from None


def noted_options(job: Job, options: Mapping[str, Any],
          record: Sequence[tuple[str, str]] = ()) -> dict[str, object]:
    """The options that a step used; the conditioning, the start states and the record differences where given.

    record  (recording, word) as given with --record
    """
    used = {name: value for name, value in options.items() if name != "start"}
    if job.start:
        used["start"] = {name: value for name, value in options["start"].items() if name != "records"}
    used |= {"record": [list(pair) for pair in record]} if record else {}
    return used | ({"condition": list(job.condition)} if job.condition else {})


def collected_findings(opened: Opened, more: Sequence[Finding], used: Collection[str], drive: Drive | None,
             step: str, options: Options | None = None) -> tuple[Finding, ...]:
    """Findings about the recordings, then about their unused parts, then those of the step; each once.

    used   the roles that the step uses
    drive  the drive that it models; None: none
    options  of an estimator
    """
    from drivetool.identify.channels import unused_roles
    from drivetool.identify.setup import rates_left_out

    first = [finding for each in opened.experiments for finding in each.findings]
    first += unused_roles(opened.experiments, used, drive, step)
    first += rates_left_out(step, opened.experiments, options)
    return tuple([finding for finding in first if finding not in more] + list(more))


def _drive_file(job: Job) -> Loaded | None:
    """The drive file, if --drive names one."""
    from drivetool.drive import KNOWN_DRIVES
    from drivetool.files.yaml import load_parameters

    if job.drive is None or job.drive in KNOWN_DRIVES:
        return None
    if not os.path.exists(job.drive):
        raise BadOption("a known drive or a YAML file after --drive", f"'{job.drive}'",
                        nearest(job.drive, KNOWN_DRIVES))
    shape = load_parameters([job.drive])
    if shape.sources[0].file.drive is None:
        raise BadOption("a drive section in the file after --drive", f"none in {shape.sources[0].name}",
                        "Add for example 'drive: {bodies: [motor, load], shafts: [shaft]}'.")
    return shape


# A number, and the unit behind it with or without a blank.
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?inf|)\s*(.*)")


def start_value(word: str, drive: Drive, option: str = "--set") -> tuple[str, float]:
    """'shaft.half_gap=2 mrad' as name and value in the drive's unit."""
    name = word.partition("=")[0].strip()
    return name, _parsed_value(option, word, drive.unit(name))


def start_of(words: Sequence[str], drive: Drive) -> KnownStart:
    """'rest' and 'motor.speed=20 rpm' as the known start state of the recordings."""
    from drivetool.identify.setup import REST, KnownStart, check_state

    given: dict[str, float] = {}
    for word in words:
        name = word.partition("=")[0].strip()
        if name in given:
            raise BadOption("every state once after --start", f"'{name}' twice", "Drop one of the two.")
        if word.strip() == REST:
            given[REST] = 0.0
            continue
        check_state(word if name == REST else name, 0.0, drive)
        with errors_as_usage():
            given[name] = _parsed_value("--start", word,
                                        drive.motion_unit + ("/s" if name.endswith(".speed") else ""))
        check_state(name, given[name], drive)
    return KnownStart(REST in given, {name: value for name, value in given.items() if name != REST})


def _parsed_value(option: str, word: str, wanted: str) -> float:
    """The value of 'NAME=VALUE', in the wanted unit."""
    name, equals, rest = (part.strip() for part in word.partition("="))
    number, unit = _NUMBER.match(rest).groups()
    do = f"Write for example '{option} {name}=0.4' (in {wanted or 'no unit'})."
    if not equals or not rest:
        raise BadOption(f"NAME=VALUE after {option}", f"'{word}'", do)
    try:
        value = float(number)
    except ValueError:
        raise BadOption(f"a finite number for {name} after {option}", f"'{rest}'", do) from None
    return value * (units.conversion_factor(unit.strip(), wanted, name) if unit else 1.0)


def check_outputs(job: Job, **further: str | None) -> None:
    """Every output can be written, is no input and no other output; before anything runs.

    further  option without its dashes -> path of a file written beside --out
    raises   BadOption: see also `check_target`
    """
    if job.plot:
        check_folder(job.plot)
    options: dict[str, str] = {}
    for option, path in {"out": job.out, **further}.items():
        if path in (None, "-"):
            continue
        other = options.setdefault(os.path.realpath(path), option)
        if other != option:
            raise BadOption(f"two files for --{other} and --{option}", f"{path} for both", "Give one another name.")
        if is_input(job, path):
            raise BadOption("an output file that is not an input", f"{path} for both",
                            f"Give --{option} another name; inputs are never changed.")
        check_target(path)


def is_input(job: Job, path: str) -> bool:
    """Whether a file is read: by its name, through a link, or as a part of a recording that is a folder."""
    if not os.path.isfile(path):
        return False
    read = [entry for entry in job.inputs if os.path.exists(entry)]
    return any(os.path.samefile(entry, path) for entry in read) or any(
        os.path.realpath(path).startswith(os.path.join(os.path.realpath(entry), ""))
        for entry in read if os.path.isdir(entry))
