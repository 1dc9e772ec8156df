"""The joint covariance of the values that several parameter files state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive import Drive, is_constant
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.yaml.written_values import factor_to_drive, value_in_drive, written_value
from drivetool.identify.estimate import Covariance

# Relative. Files state ten significant digits: a value carried on and converted differs by far less.
MAX_CARRIED_DIFFERENCE = 1e-8


def merged_covariance(files: Sequence[tuple[str, shapes.ParameterFile]], drive: Drive,
           single: bool) -> Covariance | None:
    """Covariance of the values in the files, in the units of a drive; None: no file has one.

    A later file wins: its covariance replaces the earlier one, and a value that it changes without one has none.

    files   (name, content) in the order given
    single  of a single recording: with the variance from recording to recording, where a file states it
    raises  BadParameters: a unit that the drive cannot take
    """
    names: list[str] = []
    matrix, values, scatter = np.zeros((0, 0)), dict[str, float](), dict[str, float]()
    for name, file in files:
        own, block = _file_covariance(name, file, drive)
        given = {n: v for n, entry in file.parameters.items() if (n in drive.values or not is_constant(n))
                 and (v := value_in_drive(drive, n, entry, name)) is not None}
        unchanged = [i for i, n in enumerate(names) if n not in own and is_carried_on(given.get(n), values.get(n))]
        names = [*(names[i] for i in unchanged), *own]
        matrix = np.block([[matrix[np.ix_(unchanged, unchanged)], np.zeros((len(unchanged), len(own)))],
                           [np.zeros((len(own), len(unchanged))), block]])
        values |= given
        # The std of a value that is only carried on already contains the scatter.
        scatter |= {n: _between_records(n, file.parameters.get(n), drive, name) for n in own}
    # A value that was set by hand, or is now part of a sum, has no known covariance.
    present = [i for i, n in enumerate(names)
               if n in drive.values and is_carried_on(drive.values[n], values.get(n))]
    names, matrix = [names[i] for i in present], matrix[np.ix_(present, present)]
    if single and names:
        matrix = matrix + np.diag([scatter[n] ** 2 for n in names])
    return Covariance(tuple(names), matrix) if names else None


def is_carried_on(new: float | None, old: float | None) -> bool:
    """Whether a value is unchanged; a value that the file does not give counts as unchanged."""
    return new is None or (old is not None and abs(new - old) <= MAX_CARRIED_DIFFERENCE * abs(new))


def _file_covariance(name: str, file: shapes.ParameterFile, drive: Drive) -> tuple[list[str], np.ndarray]:
    """The names in a file's covariance, and that in the units of the drive.

    A file written by hand may have standard deviations alone: its values count as uncorrelated.
    """
    section = file.covariance
    if section is None:
        stds = {n: (e.std, e.unit) for n, e in file.parameters.items()
                if isinstance(e, shapes.ParameterSection) and isinstance(e.std, float) and n in drive.values}
        scaled_stds = [std * factor_to_drive(drive, n, unit, name) for n, (std, unit) in stds.items()]
        return list(stds), np.diag(np.square(scaled_stds)) if scaled_stds else np.zeros((0, 0))
    # A torque constant by which inputs were multiplied is no value of the drive.
    index = [i for i, n in enumerate(section.names) if n in drive.values or not is_constant(n)]
    names = [section.names[i] for i in index]
    scale = [factor_to_drive(drive, n, written_value(file.parameters.get(n, 0.0))[1], name) for n in names]
    return names, np.array(section.matrix, dtype=float)[np.ix_(index, index)] * np.outer(scale, scale)


def _between_records(parameter: str, entry: shapes.ParameterSection | float | None, drive: Drive,
                     name: str) -> float:
    """Standard deviation of a parameter from recording to recording; zero where the file states none."""
    if not isinstance(entry, shapes.ParameterSection) or not isinstance(entry.repeatability, float):
        return 0.0
    return entry.repeatability * factor_to_drive(drive, parameter, entry.unit, name)
