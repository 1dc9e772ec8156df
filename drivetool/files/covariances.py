"""What several parameter files know together: the joint covariance of their values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive.chain import Drive, is_constant
from drivetool.files import shapes
from drivetool.files.written import factor, written
from drivetool.identify.estimate import Covariance

SAME = 1e-8  # relative difference of a value that a later file only carries on: ten digits are written


def merged(files: Sequence[tuple[str, shapes.ParameterFile]], drive: Drive, single: bool) -> Covariance | None:
    """Covariance of what the files told, in the units of a drive; None: no file has one.

    A later file wins: what it told itself has its covariance, what it gives another value without has none.

    files   (name, content) in the order given
    single  of a single recording: with the variance from recording to recording, where a file states it
    raises  BadParameters: a unit that the drive cannot take
    """
    names: list[str] = []
    matrix, values = np.zeros((0, 0)), dict[str, float]()
    for name, file in files:
        own, block = _own(name, file, drive)
        given = {n: v for n, entry in file.parameters.items() if (v := _value(n, entry, drive, name)) is not None}
        stays = [i for i, n in enumerate(names) if n not in own and not (
            n in given and abs(given[n] - values.get(n, np.nan)) > SAME * abs(given[n]))]
        names = [*(names[i] for i in stays), *own]
        matrix = np.block([[matrix[np.ix_(stays, stays)], np.zeros((len(stays), len(own)))],
                           [np.zeros((len(own), len(stays))), block]])
        values |= given
    if single and names:
        matrix = matrix + np.diag([_scatter(files, n, drive) ** 2 for n in names])
    return Covariance(tuple(names), matrix) if names else None


def _own(name: str, file: shapes.ParameterFile, drive: Drive) -> tuple[list[str], np.ndarray]:
    """The names in a file's covariance, and that in the units of the drive."""
    section = file.covariance
    if section is None:
        return [], np.zeros((0, 0))
    # A torque constant by which inputs were multiplied is no value of the drive.
    index = [i for i, n in enumerate(section.names) if n in drive.values or not is_constant(n)]
    names = [section.names[i] for i in index]
    scale = [factor(drive, n, written(file.parameters.get(n, 0.0))[1], name) for n in names]
    return names, np.array(section.matrix, dtype=float)[np.ix_(index, index)] * np.outer(scale, scale)


def _scatter(files: Sequence[tuple[str, shapes.ParameterFile]], parameter: str, drive: Drive) -> float:
    """Standard deviation of a parameter from recording to recording, by the last file that states one."""
    for name, file in reversed(files):
        entry = file.parameters.get(parameter)
        if isinstance(entry, shapes.ParameterSection) and isinstance(entry.repeatability, float):
            return entry.repeatability * factor(drive, parameter, entry.unit, name)
    return 0.0


def _value(parameter: str, entry: shapes.ParameterSection | float, drive: Drive, name: str) -> float | None:
    value, unit = written(entry)
    known = not is_constant(parameter) or parameter in drive.values
    return None if value is None or not known else value * factor(drive, parameter, unit, name)
