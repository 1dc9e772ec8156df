"""A model for run-downs from a parameter file: its values, or the ratios to an inertia that it does not know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from msgspec import UNSET

from drivetool.check.validation import Model
from drivetool.drive import AT, Drive, one_body, shared
from drivetool.errors import BadParameters
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.yaml import units
from drivetool.files.yaml.parameter_file import Source
from drivetool.files.yaml.written import naming
from drivetool.identify.coast_down import INERTIA, ratio_name, ratio_unit
from drivetool.identify.estimate import Covariance

OF_CHOICE = 1.0  # the inertia of a model of ratios, in the drive's own unit: a run-down is the same with any


def only_ratios(file: shapes.ParameterFile) -> bool:
    """Whether a coast-down wrote the file and knew no scale of the torques."""
    return file.details.get("scale") == [] and bool(_ratios(file))


def of_coast_down(file: shapes.ParameterFile) -> bool:
    """Whether a coast-down wrote the file."""
    return isinstance(file.details.get("scale"), list)


def run_down_model(source: Source, drive: Drive, known: Covariance | None) -> Model:
    """The model of a file, with an inertia of one and its ratios where it has these alone.

    drive   with the values of the file; known: covariance of its parameters
    raises  BadParameters: a ratio in a unit that is none; what a record adds to an inertia that is not known
    """
    encoder = _encoder(source.file)
    if not only_ratios(source.file):
        return Model(source.name, drive, False, encoder, known)
    own, found, told = replace(one_body(drive.torque_unit, drive.motion_unit), records=drive.records), {}, {}
    entries = _ratios(source.file)
    for name in (*own.quantities, *(n for n in drive.values if AT in n and shared(n) in own.quantities)):
        entry = entries.get(ratio_name(name))
        if "{T}" not in own.quantity(name).unit:
            found |= {name: drive.values[name]} if name in drive.values else {}
            told[name] = name
        elif name == INERTIA:
            found[name] = OF_CHOICE
        elif entry is not None:
            with naming(source.name):
                factor = units.factor(entry.unit, ratio_unit(own, name), f"derived.{ratio_name(name)}")
            found[name] = OF_CHOICE * factor * entry.value
            told |= {ratio_name(name): name} if factor == 1.0 else {}  # another unit than that of the covariance
        elif AT in name:
            raise BadParameters(f"a known inertia beside {name}", f"ratios alone in {source.name}",
                                "Fit the coast-down with a known scale, or leave it out.")
    with naming(source.name):
        return Model(source.name, own.with_values(found), True, encoder, _spread(source.file, told))


def _spread(file: shapes.ParameterFile, told: Mapping[str, str]) -> Covariance | None:
    """Covariance of the ratios as the step wrote it, by the names of the model; None: the file has none."""
    section = file.details.get("ratio_covariance")
    names, matrix = (section.get(k) for k in ("names", "matrix")) if isinstance(section, dict) else (None, None)
    if not isinstance(names, list) or not all(isinstance(n, str) and n in told for n in names):
        return None
    try:
        found = np.array(matrix, float)
    except (TypeError, ValueError):
        return None
    if found.shape != (len(names), len(names)) or not np.all(np.isfinite(found)):
        return None
    return Covariance(tuple(told[n] for n in names), OF_CHOICE**2 * found)


def flux_decay(file: shapes.ParameterFile) -> float:
    """What the fit of a file left out after the switching [s]."""
    return _size(file.options.get("flux_decay"))


def _ratios(file: shapes.ParameterFile) -> dict[str, shapes.DerivedSection]:
    """The figures of a file that are ratios to the inertia."""
    derived = {} if file.derived is UNSET else file.derived
    return {name: entry for name, entry in derived.items() if name.endswith("_over_inertia")}


def _encoder(file: shapes.ParameterFile) -> float:
    """What the fit of a file found that its encoder errs by beyond counts."""
    sensors = file.details.get("sensor")
    found = [s.get("error_beyond_counts", 0.0) for s in sensors if isinstance(s, dict)] \
        if isinstance(sensors, list) else []
    return max(map(_size, found), default=0.0)


def _size(value: object) -> float:
    """A number that is not negative; zero for anything else that a hand may have written."""
    return float(value) if isinstance(value, int | float) and 0.0 <= value < float("inf") else 0.0
