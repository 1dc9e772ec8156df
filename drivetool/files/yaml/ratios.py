"""A model for coast-downs from a parameter file: its values, or their ratios to an unidentified inertia."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from msgspec import UNSET

from drivetool.check.validation import CoastDownModel
from drivetool.drive import Drive, one_body
from drivetool.errors import BadParameters
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.yaml import units
from drivetool.files.yaml.parameter_file import ParameterSource
from drivetool.files.yaml.written_values import file_named_in_errors
from drivetool.identify.coast_down import INERTIA, ratio_name, ratio_unit
from drivetool.identify.estimate import Covariance
from drivetool.quantity import RECORD_MARK, shared

# Inertia of a model of ratios, in the drive's own unit: without torque the motion depends on the ratios alone.
REFERENCE_INERTIA = 1.0


def has_only_ratios(file: shapes.ParameterFile) -> bool:
    """Whether the file is of a coast-down without a known scale of the torques."""
    return file.details.get("scale") == [] and bool(_inertia_ratios(file))


def is_coast_down_file(file: shapes.ParameterFile) -> bool:
    """Whether the file is of a coast-down."""
    return isinstance(file.details.get("scale"), list)


def coast_down_model(source: ParameterSource, drive: Drive, known: Covariance | None) -> CoastDownModel:
    """The model of a file, with an inertia of one and its ratios where it has these alone.

    drive   with the values of the file; known: covariance of its parameters
    raises  BadParameters: a ratio in an unknown unit; an inertia that a record adds to an unidentified one
    """
    encoder = _encoder_error(source.file)
    if not has_only_ratios(source.file):
        return CoastDownModel(source.name, drive, False, encoder, known)
    own, values, model_names = (
        replace(one_body(drive.torque_unit, drive.motion_unit), records=drive.records), {}, {})
    entries = _inertia_ratios(source.file)
    for name in (*own.quantities, *(n for n in drive.values if RECORD_MARK in n and shared(n) in own.quantities)):
        entry = entries.get(ratio_name(name))
        if "{T}" not in own.quantity(name).unit:
            values |= {name: drive.values[name]} if name in drive.values else {}
            model_names[name] = name
        elif name == INERTIA:
            values[name] = REFERENCE_INERTIA
        elif entry is not None:
            with file_named_in_errors(source.name):
                factor = units.conversion_factor(entry.unit, ratio_unit(own, name), f"derived.{ratio_name(name)}")
            values[name] = REFERENCE_INERTIA * factor * entry.value
            # In another unit the covariance does not apply.
            model_names |= {ratio_name(name): name} if factor == 1.0 else {}
        elif RECORD_MARK in name:
            raise BadParameters(f"a known inertia in addition to {name}", f"only ratios in {source.name}",
                                "Fit the coast-down with a known scale, or leave it out.")
    with file_named_in_errors(source.name):
        return CoastDownModel(source.name, own.with_values(values), True, encoder,
                     _ratio_covariance(source.file, model_names))


def _ratio_covariance(file: shapes.ParameterFile, model_names: Mapping[str, str]) -> Covariance | None:
    """Covariance of the ratios as the step wrote it, by the names of the model; None: the file has none."""
    section = file.details.get("ratio_covariance")
    names, matrix = (section.get(k) for k in ("names", "matrix")) if isinstance(section, dict) else (None, None)
    if not isinstance(names, list) or not all(isinstance(n, str) and n in model_names for n in names):
        return None
    try:
        found = np.array(matrix, float)
    except (TypeError, ValueError):
        return None
    if found.shape != (len(names), len(names)) or not np.all(np.isfinite(found)):
        return None
    return Covariance(tuple(model_names[n] for n in names), REFERENCE_INERTIA**2 * found)


def fitted_flux_decay(file: shapes.ParameterFile) -> float:
    """Time after the switching that the fit of a file left out [s]."""
    return _nonnegative(file.options.get("flux_decay"))


def _inertia_ratios(file: shapes.ParameterFile) -> dict[str, shapes.DerivedSection]:
    """The derived figures of a file that are ratios to the inertia."""
    derived = {} if file.derived is UNSET else file.derived
    return {name: entry for name, entry in derived.items() if name.endswith("_over_inertia")}


def _encoder_error(file: shapes.ParameterFile) -> float:
    """The encoder error beyond quantisation that the fit of a file found."""
    sensors = file.details.get("sensor")
    found = [s.get("error_beyond_counts", 0.0) for s in sensors if isinstance(s, dict)] \
        if isinstance(sensors, list) else []
    return max(map(_nonnegative, found), default=0.0)


def _nonnegative(value: object) -> float:
    """A finite number that is not negative; zero for anything else in a file edited by hand."""
    return float(value) if isinstance(value, int | float) and 0.0 <= value < float("inf") else 0.0
