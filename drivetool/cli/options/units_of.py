"""Units of the drive: those of its recordings, and of torque constants where motors were logged in A, V or %."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from drivetool.cli.options.job import BETWEEN, Job, Opened
from drivetool.errors import BadParameters, BadRecording
from drivetool.files.yaml import torque_over_input

if TYPE_CHECKING:
    from drivetool.files.yaml import Loaded
    from drivetool.logs import Experiment


def units_of(job: Job, opened: Opened, loaded: Loaded, free: Sequence[str] = ()) -> tuple[str, str, str]:
    """(torque, motion, input) unit of the drive.

    loaded, free  as of `drive_for`
    returns       without torque constants the torque is in the unit of the inputs, and these have none
    raises        BadRecording: recordings of several kinds; BadParameters: a constant is missing that joins torques
    """
    from drivetool.drive import is_constant
    from drivetool.identify.setup import electric

    experiments = opened.experiments
    files = [loaded, *([opened.shape] if opened.shape else ())]
    motion = _one("motion", [(e.name, e.motion_unit) for e in experiments])
    fed = _one("input", [(e.name, unit) for e in experiments for unit in electric(e).values()])
    torque = _one("torque", [(e.name, e.torque_unit) for e in experiments if e.torque_unit != fed])
    if not fed:
        return torque, motion, next((unit for each in files if (unit := each.own_units[2])), "")
    said = _said(job, files)
    if not said and not any(map(is_constant, free)):
        if torque:
            raise _missing(experiments, fed, torque)
        return fed, motion, ""
    written = [found[0] for unit in said.values() if (found := torque_over_input(unit or ""))]
    stated = [entry.file.drive.torque_unit for each in files for entry in each.sources if entry.file.drive]
    known = [torque, *written, *(unit for unit in stated if unit in ("Nm", "N")), "N" if motion == "m" else "Nm"]
    return next(filter(None, known)), motion, fed


def one_kind(experiments: Sequence[Experiment]) -> None:
    """Raise BadRecording where recordings have other units than the first."""
    _one("motion", [(e.name, e.motion_unit) for e in experiments])
    _one("torque", [(e.name, e.unit("motor_torque")) for e in experiments])


def _one(what: str, units: Sequence[tuple[str, str]]) -> str:
    """The unit that all have, (recording, unit) each; empty: none has one."""
    if not units:
        return ""
    first, common = units[0]
    for name, unit in units:
        if unit != common:
            raise BadRecording(f"recordings with the {what} in {common}, as {first} has it", f"{unit} in {name}",
                               "Fit them apart, or correct the units in the channel map.")
    return common


def _said(job: Job, files: Sequence[Loaded]) -> dict[str, str | None]:
    """The torque constants that have a value -> the unit in which they were given, if any."""
    from drivetool.drive import is_constant

    found = {name: unit for each in reversed(files) for name, unit in each.constants.items()}
    for word in (*job.set, *(pair.partition(BETWEEN)[2] for pair in job.record)):
        name, _, value = (part.strip() for part in word.partition("="))
        if is_constant(name):
            found[name] = value.lstrip("0123456789.+-eE ") or None
    return found


def _missing(experiments: Sequence[Experiment], fed: str, torque: str) -> BadParameters:
    """No constant, and torques in two units."""
    from drivetool.identify.setup import electric

    role, name = next((role, e.name) for e in experiments for role in electric(e))
    others = [f"{r} of {e.name}" for e in experiments for r in e.signals
              if r.endswith("torque") and e.unit(r) == torque]
    constant = f"{'motor2' if role == 'motor2_torque' else 'motor'}.torque_constant"
    return BadParameters(
        f"{constant} in {torque}/{fed}, since {role} of {name} is in {fed} and {others[0]} in {torque}", "no value",
        f"Give it in a parameter file, or with --set {constant}=VALUE.")
