"""What several parameter files know together: the joint covariance of their values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive import Drive, is_constant
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.yaml.written import factor, written
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
    matrix, values, scatter = np.zeros((0, 0)), dict[str, float](), dict[str, float]()
    for name, file in files:
        own, block = _own(name, file, drive)
        given = {n: v for n, entry in file.parameters.items() if (v := _value(n, entry, drive, name)) is not None}
        stays = [i for i, n in enumerate(names) if n not in own and same(given.get(n), values.get(n))]
        names = [*(names[i] for i in stays), *own]
        matrix = np.block([[matrix[np.ix_(stays, stays)], np.zeros((len(stays), len(own)))],
                           [np.zeros((len(own), len(stays))), block]])
        values |= given
        # What a file carries on has the scatter in it already.
        scatter |= {n: _scatter(n, file.parameters.get(n), drive, name) for n in own}
    # Of a value that was set by hand, or stands in a sum now, nothing is known.
    kept = [i for i, n in enumerate(names) if n in drive.values and same(drive.values[n], values.get(n))]
    names, matrix = [names[i] for i in kept], matrix[np.ix_(kept, kept)]
    if single and names:
        matrix = matrix + np.diag([scatter[n] ** 2 for n in names])
    return Covariance(tuple(names), matrix) if names else None


def same(new: float | None, old: float | None) -> bool:
    """Whether a value is only carried on; one that is not given is."""
    return new is None or (old is not None and abs(new - old) <= SAME * abs(new))


def _own(name: str, file: shapes.ParameterFile, drive: Drive) -> tuple[list[str], np.ndarray]:
    """The names in a file's covariance, and that in the units of the drive.

    A file by hand may have standard deviations alone: those of values that are told apart.
    """
    section = file.covariance
    if section is None:
        stds = {n: (e.std, e.unit) for n, e in file.parameters.items()
                if isinstance(e, shapes.ParameterSection) and isinstance(e.std, float) and n in drive.values}
        alone = [std * factor(drive, n, unit, name) for n, (std, unit) in stds.items()]
        return list(stds), np.diag(np.square(alone)) if alone else np.zeros((0, 0))
    # A torque constant by which inputs were multiplied is no value of the drive.
    index = [i for i, n in enumerate(section.names) if n in drive.values or not is_constant(n)]
    names = [section.names[i] for i in index]
    scale = [factor(drive, n, written(file.parameters.get(n, 0.0))[1], name) for n in names]
    return names, np.array(section.matrix, dtype=float)[np.ix_(index, index)] * np.outer(scale, scale)


def _scatter(parameter: str, entry: shapes.ParameterSection | float | None, drive: Drive, name: str) -> float:
    """Standard deviation of a parameter from recording to recording; zero where the file states none."""
    if not isinstance(entry, shapes.ParameterSection) or not isinstance(entry.repeatability, float):
        return 0.0
    return entry.repeatability * factor(drive, parameter, entry.unit, name)


def _value(parameter: str, entry: shapes.ParameterSection | float, drive: Drive, name: str) -> float | None:
    value, unit = written(entry)
    known = not is_constant(parameter) or parameter in drive.values
    return None if value is None or not known else value * factor(drive, parameter, unit, name)
