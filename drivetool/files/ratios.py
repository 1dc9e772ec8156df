"""A model for run-downs from a parameter file: its values, or the ratios to an inertia that it does not know."""

from __future__ import annotations

from msgspec import UNSET

from drivetool.check.validation.validate_run_down import Model
from drivetool.drive.chain import Drive, one_body
from drivetool.errors import BadParameters
from drivetool.files import shapes, units
from drivetool.files.parameter_file import Source
from drivetool.files.written import naming
from drivetool.identify.coast_down.report import INERTIA, ratio_name, ratio_unit

OF_CHOICE = 1.0  # the inertia of a model of ratios, in the drive's own unit: a run-down is the same with any


def only_ratios(file: shapes.ParameterFile) -> bool:
    """Whether a coast-down wrote the file and knew no scale of the torques."""
    return file.details.get("scale") == [] and bool(_ratios(file))


def run_down_model(source: Source, drive: Drive) -> Model:
    """The model of a file, with an inertia of one and its ratios where it has these alone.

    drive   with the values of the file
    raises  BadParameters: a ratio in a unit that is none; ratios beside an inertia that a record adds
    """
    encoder = _encoder(source.file)
    if not only_ratios(source.file):
        return Model(source.name, drive, False, encoder)
    if added := [n for n in drive.values if ".added_inertia" in n]:
        raise BadParameters(f"a known inertia beside {added[0]}", f"ratios alone in {source.name}",
                            "Fit the coast-down with a known scale, or leave the added inertia out.")
    own = one_body(drive.torque_unit, drive.motion_unit)
    found = {n: v for n, v in drive.values.items() if n in own.quantities and "{T}" not in own.quantity(n).unit}
    found[INERTIA] = OF_CHOICE
    told = _ratios(source.file)
    for name, quantity in own.quantities.items():
        entry = told.get(ratio_name(name))
        if entry is not None and name != INERTIA and "{T}" in quantity.unit:
            with naming(source.name):
                found[name] = OF_CHOICE * entry.value * units.factor(
                    entry.unit, ratio_unit(own, name), f"derived.{ratio_name(name)}")
    return Model(source.name, own.with_values(found), True, encoder)


def flux_decay(file: shapes.ParameterFile) -> float:
    """What the fit of a file left out after the switching [s]."""
    value = file.options.get("flux_decay")
    return float(value) if isinstance(value, int | float) else 0.0


def _ratios(file: shapes.ParameterFile) -> dict[str, shapes.DerivedSection]:
    """The figures of a file that are ratios to the inertia."""
    derived = {} if file.derived is UNSET else file.derived
    return {name: entry for name, entry in derived.items() if name.endswith("_over_inertia")}


def _encoder(file: shapes.ParameterFile) -> float:
    """What the fit of a file found that its encoder errs by beyond counts."""
    sensors = file.details.get("sensor")
    found = [s.get("error_beyond_counts", 0.0) for s in sensors if isinstance(s, dict)] \
        if isinstance(sensors, list) else []
    return max((float(e) for e in found if isinstance(e, int | float)), default=0.0)
