"""The parameter file: what every step writes, the next one reads and a person edits."""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import msgspec

from drivetool.drive import KNOWN_DRIVES, TOTALS, Drive, is_constant, two_mass
from drivetool.errors import BadParameters
from drivetool.files.shapes import (
    GAINS_SCHEMA,
    INSPECTION_SCHEMA,
    TRENDS_SCHEMA,
    GainsFile,
    InspectionFile,
    TrendsFile,
    analysis_shapes,
    parameter_shapes as shapes,
)
from drivetool.files.yaml import checked, units
from drivetool.files.yaml.covariances import merged_covariance
from drivetool.files.yaml.stated_drive import StatedDrive
from drivetool.files.yaml.text import from_yaml
from drivetool.files.yaml.written_values import (
    factor_to_drive,
    file_named_in_errors,
    value_in_drive,
    written_value,
)
from drivetool.identify.estimate import Covariance
from drivetool.logs.channels import SCHEMA as MAP_SCHEMA
from drivetool.quantity import ELECTRIC_UNITS, RECORD_MARK, shared

if TYPE_CHECKING:

    Result = (shapes.ParameterFile | shapes.ValidationFile | analysis_shapes.SpectraFile
              | analysis_shapes.ComparisonFile | GainsFile | InspectionFile | TrendsFile)


@dataclass(frozen=True)
class ParameterSource:
    """One file as it was read: name without folder ('-' for standard input), hash, content."""

    name: str
    sha256: str
    file: shapes.ParameterFile


@dataclass(frozen=True)
class Loaded:
    """Parameter files in the order given; a later one wins."""

    sources: tuple[ParameterSource, ...] = ()

    @property
    def inputs(self) -> tuple[tuple[str, str], ...]:
        """(file name, sha256) per file."""
        return tuple((source.name, source.sha256) for source in self.sources)

    @property
    def noise(self) -> Mapping[str, float]:
        """Of the last file that has any."""
        noise = next((source.file.noise for source in reversed(self.sources) if source.file.noise), {})
        return {k: v for k, v in noise.items() if v is not None}

    def stated(self, default: Drive | None = None) -> StatedDrive:
        """The drive of the files with their values.

        default  structure where no file has a drive section, and the units of the
                 recordings; None: two masses in the units of the files
        raises   BadParameters: a name, unit or value the drive cannot take
        """
        return self.fill(StatedDrive(self.structure(default) if default else self.chain()))

    def chain(self) -> Drive:
        """The bodies and shafts alone, in the units of the files; two masses where no file has a drive section."""
        return self.structure(two_mass(*self.own_units))

    def structure(self, default: Drive) -> Drive:
        """The chain the last drive section describes, in the units of `default`; no values."""
        drive = replace(default, values={})
        for source in self.sources:
            if source.file.drive is not None:
                drive = _drive_of_section(source.file.drive, drive, source.name)
        return drive

    def fill(self, stated: StatedDrive) -> StatedDrive:
        """`stated` with the values of all the files, converted to its units."""
        for source in self.sources:
            section = source.file.drive or shapes.DriveSection()
            _check_units(section, stated.start, source.name)
            drive = _with_records(stated.start, source)
            values = {name: value for name, entry in source.file.parameters.items()
                      if (value := value_in_drive(drive, name, entry, source.name)) is not None}
            _check_totals(values, drive, source.name)
            marks = {name: entry.reason for name, entry in source.file.parameters.items() if name in values
                     and isinstance(entry, shapes.ParameterSection) and entry.status == "not-identifiable"}
            with file_named_in_errors(source.name):
                stated = replace(stated, start=drive).with_values(values, marks)
        return stated

    def sections(self, drive: Drive) -> dict[str, shapes.ParameterSection]:
        """What the files say about each parameter, bare numbers with the unit of `drive`."""
        return {name: entry if isinstance(entry, shapes.ParameterSection) else
                shapes.ParameterSection(value=float(entry), unit=drive.unit(name))
                for source in self.sources for name, entry in source.file.parameters.items()}

    def covariance(self, drive: Drive, single: bool = False) -> Covariance | None:
        """Of all the files, in the units of `drive`; a value that a later file changes loses its covariance.

        single  of a single recording like those behind the files: with the variance between recordings
        """
        return merged_covariance([(source.name, source.file) for source in self.sources], drive, single)

    def stds(self, drive: Drive) -> dict[str, float]:
        """Standard deviations that the files state, in the units of `drive`; of the last file that has a value."""
        return {name: std for name, std in self._stated_numbers(drive, "std").items() if std > 0.0}

    def starts(self, drive: Drive) -> dict[str, float]:
        """Values that the fits of the files started from, likewise."""
        return self._stated_numbers(drive, "start")

    def _stated_numbers(self, drive: Drive, what: str) -> dict[str, float]:
        found: dict[str, float] = {}
        for source in self.sources:
            for name, entry in source.file.parameters.items():
                found.pop(name, None)
                number = getattr(entry, what) if isinstance(entry, shapes.ParameterSection) else None
                if number is not None:
                    found[name] = number * factor_to_drive(drive, name, entry.unit, source.name)
        return found

    def ratings(self, drive: Drive) -> tuple[float, float] | None:
        """(torque, speed) that 100 % stands for, in the units of `drive`; of the last file that has them."""
        for source in reversed(self.sources):
            if section := source.file.ratings:
                return (_converted(section.torque, drive.torque_unit, "ratings.torque", source.name),
                        _converted(section.speed, f"{drive.motion_unit}/s", "ratings.speed", source.name))
        return None

    @property
    def carried(self) -> dict[str, shapes.Shape]:
        """Sections that no estimator changes and every file takes over."""
        return {key: section for source in self.sources for key in ("ratings", "controller")
                if (section := getattr(source.file, key)) is not None}

    @property
    def speed_filter(self) -> float:
        """Time constant of the speed measurement's filter [s]; 0 where no file has one."""
        for source in reversed(self.sources):
            if (section := source.file.controller) and section.speed_filter:
                return _converted(section.speed_filter, "s", "controller.speed_filter", source.name, least=0.0)
        return 0.0

    @property
    def own_units(self) -> tuple[str, str, str]:
        """Units of torque, motion and input as the files state them; defaults are Nm, rad and none."""
        torque, motion, input_unit = "Nm", "rad", ""
        for source in self.sources:
            section = source.file.drive or shapes.DriveSection()
            torque, motion = section.torque_unit or torque, section.motion_unit or motion
            input_unit = section.input_unit or input_unit
        by_constants = [found for unit in self.constants.values() if (found := units.torque_over_input(unit or ""))]
        if by_constants and not any(source.file.drive and source.file.drive.torque_unit for source in self.sources):
            torque = by_constants[-1][0]
        return torque, motion, input_unit or (by_constants[-1][1] if by_constants else "")

    @property
    def constants(self) -> dict[str, str | None]:
        """Torque constants of which the files have a value -> the unit that is written there."""
        each = {n: written_value(entry) for source in self.sources for n, entry in source.file.parameters.items()}
        return {n: unit for n, (value, unit) in each.items() if value is not None and is_constant(n)}


def load_parameters(paths: Sequence[str | Path], stdin: BinaryIO | None = None) -> Loaded:
    """Read parameter files.

    paths    in the order in which they are merged; '-' is standard input
    stdin    binary stream that '-' reads; None: the process's own
    returns  Loaded, whose `drive` merges them
    raises   BadParameters: a file that cannot be read or used
    """
    if sum(str(path) == "-" for path in paths) > 1:
        raise BadParameters("standard input once", "'--params -' twice", "Give the second one as a file.")
    return Loaded(tuple(_checked_source(*read_bytes(path, stdin)) for path in paths))


def load_result(path: str | Path, stdin: BinaryIO | None = None) -> Result:
    """A file of any step to show: bare numbers with their unit, names checked.

    raises  BadParameters: a file that cannot be read, or that no step writes
    """
    name, data = read_bytes(path, stdin)
    raw = from_yaml(data, name)
    others = {shapes.VALIDATION_SCHEMA: shapes.ValidationFile, GAINS_SCHEMA: GainsFile,
              **analysis_shapes.ANALYSIS_FILES, INSPECTION_SCHEMA: InspectionFile, TRENDS_SCHEMA: TrendsFile}
    schema = str(raw.get("schema") or "no schema")
    if schema in others:
        return checked.result_file(raw, others[schema], name)
    if schema != shapes.PARAMETERS_SCHEMA:
        advice = {
            MAP_SCHEMA: "A channel map is an input: 'drivetool inspect LOG --map FILE' shows what it makes of "
                        "a log.",
            "no schema": f"Begin a parameter file with 'schema: {shapes.PARAMETERS_SCHEMA}'."}
        raise BadParameters("a file that a step wrote, to show its table", f"{schema} in {name}",
                            advice.get(schema, checked.OTHER_SCHEMA_ADVICE), (shapes.PARAMETERS_SCHEMA, *others))
    loaded = Loaded((_checked_source(name, data),))
    return msgspec.structs.replace(loaded.sources[0].file, parameters=loaded.sections(loaded.stated().start))


def _checked_source(name: str, data: bytes) -> ParameterSource:
    """Check what was read."""
    display_name = "standard input" if name == "-" else name
    file = checked.parameter_file(from_yaml(data, display_name), display_name)
    _check_square(file.covariance, display_name)
    return ParameterSource(name, hashlib.sha256(data).hexdigest(), file)


def read_bytes(path: str | Path, stdin: BinaryIO | None = None) -> tuple[str, bytes]:
    """(name without folder, content) of a file, or of standard input for '-'."""
    if str(path) == "-":
        return "-", (stdin or sys.stdin.buffer).read()
    try:
        return Path(path).name, Path(path).read_bytes()
    except OSError as error:
        raise BadParameters(f"to read {path}", error.strerror or str(error),
                            "Check the path of the parameter file.") from None


def _check_square(section: shapes.CovarianceSection | None, name: str) -> None:
    """Refuse a covariance without exactly one row and one column per name."""
    if section is None:
        return
    n = len(section.names)
    if [len(row) for row in section.matrix] != [n] * n:
        raise BadParameters(f"a covariance matrix of {n} x {n}, as there are {n} names",
                            f"{len(section.matrix)} rows of other lengths in {name}",
                            "Correct it, or delete the whole covariance section.")


def _drive_of_section(section: shapes.DriveSection, drive: Drive, name: str) -> Drive:
    """The chain a drive section describes; what it leaves out is as in `drive`."""
    _check_units(section, drive, name)
    law = section.damping_law or drive.damping_law
    if section.bodies is None:
        if section.shafts is not None:
            raise BadParameters("drive.bodies together with drive.shafts", f"only shafts in {name}",
                                "Name the bodies from the motor outwards.")
        if section.name is None:
            return replace(drive, damping_law=law)
        if section.name not in KNOWN_DRIVES:
            raise BadParameters("a known drive, or one with its bodies and shafts",
                                f"only the name '{section.name}' in {name}",
                                "Add drive.bodies and drive.shafts.", KNOWN_DRIVES)
        known = KNOWN_DRIVES[section.name](drive.torque_unit, drive.motion_unit, drive.input_unit)
        return replace(known, damping_law=law)
    bodies = tuple(section.bodies)
    shafts = section.shafts
    if shafts is None:
        shafts = ["shaft", *(f"shaft{i}" for i in range(2, len(bodies)))][: len(bodies) - 1]
    _check_chain(bodies, tuple(shafts), name)
    return Drive(section.name or "custom", bodies, tuple(shafts), {},
                 drive.torque_unit, drive.motion_unit, law, input_unit=drive.input_unit)


def _with_records(drive: Drive, source: ParameterSource) -> Drive:
    """The drive with the recordings of a file.

    Of two recordings with the same name the earlier one is dropped; a recording with a new name is renamed.
    """
    entries = [] if source.file.records is msgspec.UNSET else source.file.records
    records = {entry.file: entry.sha256.lower() for entry in entries}
    for entry in entries:
        if not re.fullmatch(r"[0-9a-f]{64}", entry.sha256.lower()):
            raise BadParameters(f"the sha256 of {entry.file} in the section records, 64 hexadecimal digits",
                                f"'{entry.sha256}' in {source.name}", "Copy it from `drivetool inspect`.")
    if len(records) < len(entries) or len(set(records.values())) < len(records):
        raise BadParameters("every recording once in the section records", f"one twice in {source.name}",
                            "Delete one of them.")
    names = {sha: name for name, sha in records.items()}
    renamed = {old: names.get(sha, "" if old in records else old) for old, sha in drive.records.items()}
    values = {f"{kind}{at}{renamed[old]}" if at else n: v for n, v in drive.values.items()
              for kind, at, old in [n.partition(RECORD_MARK)] if not at or renamed[old]}
    renamed_records = {new: drive.records[old] for old, new in renamed.items() if new}
    return replace(drive, values=values, records={**renamed_records, **records})


def _check_chain(bodies: tuple[str, ...], shafts: tuple[str, ...], name: str) -> None:
    """Refuse names that are not unique, and chains without exactly one shaft between neighbours."""
    names = bodies + shafts
    if not bodies or len(shafts) != len(bodies) - 1:
        raise BadParameters("at least one body and one shaft fewer than bodies",
                            f"{len(bodies)} bodies and {len(shafts)} shafts in {name}",
                            "Correct drive.bodies and drive.shafts.")
    for each in names:
        if not each.isidentifier() or names.count(each) > 1 or each in ("total", "converter"):
            raise BadParameters(
                "names of bodies and shafts that are single words, each used once", f"'{each}' in {name}",
                "Choose another name; total and converter are taken.")


def _check_units(section: shapes.DriveSection, drive: Drive, name: str) -> None:
    """Refuse parameters in another unit than the recording: Nm and A need a torque constant between them."""
    do = "Use parameters from a recording of the same kind, or correct the unit in the channel map."
    for word, wanted, found in (("torque", drive.torque_unit, section.torque_unit),
                                ("motion", drive.motion_unit, section.motion_unit),
                                ("motor's input", drive.input_unit, section.input_unit or None)):
        if found not in (None, wanted):
            if word == "torque" and wanted in ELECTRIC_UNITS and found not in ELECTRIC_UNITS:
                do = f"Give {drive.bodies[0]}.torque_constant in {found}/{wanted}, with --set or in the file."
            raise BadParameters(f"parameters for a {word} in {wanted}, the unit of the recording",
                                f"{found} in {name}", do)


def _check_totals(values: Mapping[str, float], drive: Drive, name: str) -> None:
    """Refuse a total together with its parts: they are redundant or contradict each other."""
    for total, suffix in TOTALS.items():
        parts = [n for n in values if shared(n) in {f"{body}.{suffix}" for body in drive.bodies}]
        if parts and any(shared(n) == total for n in values):
            raise BadParameters(f"either {total} or its parts", f"{total} and {', '.join(parts)} in {name}",
                                "Delete the total or the parts.")


def _converted(section: shapes.MeasureSection, unit: str, what: str, name: str, least: float = 1e-300) -> float:
    """A number of the file in a unit; above zero unless `least` says otherwise."""
    with file_named_in_errors(name):
        value = section.value * units.conversion_factor(section.unit, unit, what)
    if not least <= value < float("inf"):
        raise BadParameters(f"{what} above zero", f"{section.value:g} {section.unit} in {name}", "Correct it.")
    return value
