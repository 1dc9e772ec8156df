"""Units of the drive: those of its recordings, and of torque constants where motors were logged in A, V or %."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from drivetool.cli.options.job import WORD_SEPARATOR, Job, Opened
from drivetool.drive import is_constant
from drivetool.errors import BadParameters, BadRecording
from drivetool.files.yaml import torque_over_input

if TYPE_CHECKING:
    from drivetool.files.yaml import Loaded
    from drivetool.logs import Experiment


def units_of(job: Job, opened: Opened, loaded: Loaded, free: Sequence[str] = ()) -> tuple[str, str, str]:
    """(torque, motion, input) unit of the drive.

    loaded, free  as of `drive_for`
    returns       without torque constants the torque is in the unit of the inputs, and these have none
    raises        BadRecording: recordings of several kinds; BadParameters: a torque constant is missing
    """
    from drivetool.identify.setup import electric_inputs

    experiments = opened.experiments
    files = [loaded, *([opened.shape] if opened.shape else ())]
    motion = _common_unit("motion", [(e.name, e.motion_unit) for e in experiments])
    input_unit = _common_unit("input",
                              [(e.name, unit) for e in experiments for unit in electric_inputs(e).values()])
    torque = _common_unit("torque", [(e.name, e.torque_unit) for e in experiments if e.torque_unit != input_unit])
    if not input_unit:
        return torque, motion, next((unit for each in files if (unit := each.own_units[2])), "")
    constants = _stated_constants(job, files)
    if not constants and not any(map(is_constant, free)):
        if torque:
            raise _missing_constant(experiments, input_unit, torque)
        return input_unit, motion, ""
    written = [found[0] for unit in constants.values() if (found := torque_over_input(unit or ""))]
    file_torque_units = [entry.file.drive.torque_unit
                         for each in files for entry in each.sources if entry.file.drive]
    known = [torque, *written, *(unit for unit in file_torque_units if unit in ("Nm", "N")),
             "N" if motion == "m" else "Nm"]
    return next(filter(None, known)), motion, input_unit


def check_common_units(experiments: Sequence[Experiment]) -> None:
    """Raise BadRecording where recordings have other units than the first."""
    _common_unit("motion", [(e.name, e.motion_unit) for e in experiments])
    _common_unit("torque", [(e.name, e.unit("motor_torque")) for e in experiments])


def _common_unit(what: str, units: Sequence[tuple[str, str]]) -> str:
    """The unit that all have, (recording, unit) each; empty: none has one."""
    if not units:
        return ""
    first, common = units[0]
    for name, unit in units:
        if unit != common:
            raise BadRecording(f"recordings with the {what} in {common}, the unit of {first}", f"{unit} in {name}",
                               "Fit them separately, or correct the units in the channel map.")
    return common


def _stated_constants(job: Job, files: Sequence[Loaded]) -> dict[str, str | None]:
    """The torque constants that have a value -> the unit in which they were given, if any."""
    found = {name: unit for each in reversed(files) for name, unit in each.constants.items()}
    for word in (*job.set, *(pair.partition(WORD_SEPARATOR)[2] for pair in job.record)):
        name, _, value = (part.strip() for part in word.partition("="))
        if is_constant(name):
            found[name] = value.lstrip("0123456789.+-eE ") or None
    return found


def _missing_constant(experiments: Sequence[Experiment], input_unit: str, torque: str) -> BadParameters:
    """No constant, and torques in two units."""
    from drivetool.identify.setup import electric_inputs

    role, name = next((role, e.name) for e in experiments for role in electric_inputs(e))
    others = [f"{r} of {e.name}" for e in experiments for r in e.signals
              if r.endswith("torque") and e.unit(r) == torque]
    constant = f"{'motor2' if role == 'motor2_torque' else 'motor'}.torque_constant"
    return BadParameters(
        f"{constant} in {torque}/{input_unit}, "
        f"since {role} of {name} is in {input_unit} and {others[0]} in {torque}", "no value",
        f"Give it in a parameter file, or with --set {constant}=VALUE.")
