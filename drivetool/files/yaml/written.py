"""A number of a parameter file as it is written: its value, its unit, and the file that an error names."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from drivetool.drive import Drive
from drivetool.errors import BadParameters
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.yaml import units


def written(entry: shapes.ParameterSection | float) -> tuple[float | None, str | None]:
    """(value, unit) as the person or the step wrote them."""
    return (entry.value, entry.unit) if isinstance(entry, shapes.ParameterSection) else (entry, None)


def factor(drive: Drive, parameter: str, unit: str | None, name: str) -> float:
    """What the written value is multiplied with."""
    with naming(name):
        wanted = drive.unit(parameter)
        return 1.0 if unit is None else units.factor(unit, wanted, parameter)


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Adds the file's name to what the drive or the unit table found wrong."""
    try:
        yield
    except BadParameters as error:
        raise BadParameters(error.wanted, f"{error.found} in {name}", error.do, error.available) from None
