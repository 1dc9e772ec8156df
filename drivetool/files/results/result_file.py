"""From what a step returned to the file it writes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import msgspec

import drivetool
from drivetool.check.validation import CheckSection, Validation
from drivetool.drive import TOTALS, Drive, is_constant
from drivetool.files.shapes import parameter_shapes as shapes
from drivetool.files.yaml import to_json, to_plain, to_yaml, written
from drivetool.finding import Finding
from drivetool.finding_codes import DOUBTING
from drivetool.identify.estimate import Covariance, Estimate, Parameter, StartsSection, derived_figures_of
from drivetool.quantity import name_of, quantity_of

COPIED_PARAMETER = "copied from the parameter file, not used in this step"
Form = Literal["yaml", "json"]
Inputs = Sequence[tuple[str, str]]


def dump(file: shapes.Shape, form: Form = "yaml") -> str:
    """A file as text, keys in the order of its type; equal files give equal bytes.

    form  yaml, or json with the same content
    """
    document = msgspec.to_builtins(file)
    if document.get("diagnosis", "") is None:  # only diagnose fills it
        del document["diagnosis"]
    return to_json(document) if form == "json" else to_yaml(document)


def estimate_file(estimate: Estimate, inputs: Inputs = (),
                  carried: Mapping[str, shapes.Shape] | None = None,
                  unidentified: Mapping[str, str] | None = None) -> shapes.ParameterFile:
    """The parameter file of an estimate, every value of its drive included.

    carried       sections of the input files that no estimator changes: ratings, controller
    unidentified  name -> reason of values that no recording identifies: where one was held, or is a part of such a
                  sum, the file says so again
    """
    drive = replace(estimate.drive, values={**estimate.drive.constants, **estimate.drive.values})
    known = [_stated_once(p, drive) for p in estimate.parameters]
    if any(f.code in DOUBTING for f in estimate.findings):
        known = [p.replace(reason=p.reason or shapes.IF_COMPLETE) if p.std is not None else p for p in known]
    parameters = {p.name: parameter_section(p) for p in known}
    for name, value in drive.values.items():
        if name not in parameters:
            # Otherwise the next step would lose the results of an earlier one.
            reason = f"inputs in {drive.input_unit} are multiplied by it" if is_constant(name) else COPIED_PARAMETER
            parameters[name] = parameter_section(Parameter(
                name=name, value=value, unit=drive.unit(name), status="held", reason=reason))
    marks = unidentified or {}
    parameters |= {n: section.replace(status="not-identifiable", reason=why) for n, section in parameters.items()
                   if section.status == "held"
                   and (why := marks.get(n, marks.get(name_of("total", quantity_of(n))))) is not None}
    order = {name: i for i, name in enumerate(drive.quantities)}
    return shapes.ParameterFile(
        schema=shapes.PARAMETERS_SCHEMA, tool=tool_section(), step=estimate.step, outcome=estimate.outcome,
        drive=drive_section(drive),
        parameters={n: parameters[n] for n in sorted(parameters, key=lambda n: order.get(n, len(order)))},
        derived=_derived_sections(estimate) or msgspec.UNSET, explanation=estimate.explanation or msgspec.UNSET,
        laws=[written(law, shapes.LawSection) for law in estimate.laws] or msgspec.UNSET,
        fit=to_plain(estimate.fit), starts=estimate.starts and written(estimate.starts, StartsSection),
        findings=finding_sections(estimate.findings),
        covariance=_covariance_section(estimate.covariance), noise=to_plain(estimate.noise), **(carried or {}),
        details=to_plain(estimate.details), records=file_sections(drive.records.items()) or msgspec.UNSET,
        data=file_sections(estimate.data), inputs=file_sections(inputs), options=to_plain(estimate.options))


def validation_file(validation: Validation, inputs: Inputs = ()) -> shapes.ValidationFile:
    """The validation file: passed means every check met every limit that was set."""
    return shapes.ValidationFile(
        schema=shapes.VALIDATION_SCHEMA, tool=tool_section(), step="validate", verdict=validation.verdict,
        passed=all(check.passed for check in validation.checks),
        checks=[written(check, CheckSection) for check in validation.checks],
        findings=finding_sections(validation.findings), data=file_sections(validation.data),
        inputs=file_sections(inputs),
        options=to_plain(validation.options))


def drive_section(drive: Drive) -> shapes.DriveSection:
    """The chain, written out in full so that the file explains itself."""
    return shapes.DriveSection(
        name=drive.name, bodies=list(drive.bodies), shafts=list(drive.shafts),
        torque_unit=drive.torque_unit, motion_unit=drive.motion_unit, damping_law=drive.damping_law,
        input_unit=drive.input_unit or msgspec.UNSET)


def parameter_section(parameter: Parameter) -> shapes.ParameterSection:
    """One parameter; what is not finite becomes null with a reason."""
    section = written(parameter, shapes.ParameterSection)
    if section.reason:
        return section
    if section.value is None:
        return section.replace(reason="no finite value" if math.isnan(parameter.value) else "absent (infinite)")
    lost = section.std is None and parameter.std is not None
    return section.replace(reason="the standard deviation is not finite") if lost else section


def _derived_sections(estimate: Estimate) -> dict[str, shapes.DerivedSection]:
    """The figures derived from the parameters."""
    return {p.name: written(p, shapes.DerivedSection)
            for p in (*estimate.ratios,
                      *derived_figures_of(estimate.drive, estimate.parameters, estimate.covariance,
                                          estimate.options.get("hold", ())))}


def _stated_once(parameter: Parameter, drive: Drive) -> Parameter:
    """A part whose total the drive has, or the reverse, has no value: a file states each quantity once."""
    for total, suffix in TOTALS.items():
        parts = [f"{body}.{suffix}" for body in drive.bodies]
        others = parts if parameter.name == total else [total] if parameter.name in parts else []
        known = [name for name in others if name in drive.values]
        if known and parameter.name not in drive.values:
            return parameter.replace(value=math.nan, std=None, ci95=None,
                                     reason=parameter.reason or f"stated as {', '.join(known)}")
    return parameter


def _covariance_section(covariance: Covariance | None) -> shapes.CovarianceSection | None:
    """Rows and columns that are finite; None if nothing is left."""
    if covariance is None:
        return None
    matrix = to_plain(covariance.matrix)
    keep = [i for i, row in enumerate(matrix) if row[i] is not None]
    rows = [[matrix[i][j] for j in keep] for i in keep]
    if not keep or any(value is None for row in rows for value in row):
        return None
    return shapes.CovarianceSection(names=[covariance.names[i] for i in keep], matrix=rows)


def finding_sections(findings: Iterable[Finding]) -> list[shapes.FindingSection]:
    """In the order in which they were found."""
    return [written(f, shapes.FindingSection) for f in findings]


def file_sections(files: Iterable[Sequence[str | None]]) -> list[shapes.FileSection]:
    """(name, sha256) of files, and of recordings the time at which they began, as sections."""
    return [shapes.FileSection(*(text for text in each if text is not None)) for each in files]


def tool_section() -> shapes.Tool:
    """This program."""
    return shapes.Tool(name="drivetool", version=drivetool.__version__)
