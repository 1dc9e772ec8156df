"""A number of a parameter file as it is written: its value, its unit, and the file that an error names."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from drivetool.drive import Drive
from drivetool.errors import BadParameters
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.yaml import units


def written_value(entry: shapes.ParameterSection | float) -> tuple[float | None, str | None]:
    """(value, unit) as written in the file."""
    return (entry.value, entry.unit) if isinstance(entry, shapes.ParameterSection) else (entry, None)


def value_in_drive(drive: Drive, parameter: str, entry: shapes.ParameterSection | float,
                   name: str) -> float | None:
    """The value in the drive's own unit; None: the file has none."""
    value, unit = written_value(entry)
    return None if value is None else value * factor_to_drive(drive, parameter, unit, name)


def factor_to_drive(drive: Drive, parameter: str, unit: str | None, name: str) -> float:
    """Factor from the written unit to the drive's own."""
    with file_named_in_errors(name):
        wanted = drive.unit(parameter)
        return 1.0 if unit is None else units.conversion_factor(unit, wanted, parameter)


@contextmanager
def file_named_in_errors(name: str) -> Iterator[None]:
    """Adds the file's name to errors of the drive or of the unit table."""
    try:
        yield
    except BadParameters as error:
        raise BadParameters(error.wanted, f"{error.found} in {name}", error.do, error.available) from None
