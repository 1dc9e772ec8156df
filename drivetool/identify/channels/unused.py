"""Roles that a recording has and a step does not use, each with the reason."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from drivetool.drive import Drive
from drivetool.drive.effects import VOLTAGES
from drivetool.finding import Finding
from drivetool.identify.setup import both_outputs, fed_by_voltages, roles_of, sensors_of
from drivetool.logs import INPUTS, ROLES, Experiment, role_of

AT_MOTOR = ("motor_speed", "motor_angle")


def used_by(step: str, experiments: Sequence[Experiment], drive: Drive, criterion: str = "") -> set[str]:
    """The roles that a step takes of recordings that it can work with."""
    if step == "steady" or criterion == "coast-down":
        return _used_by_steady(experiments, drive)
    roles = roles_of(experiments, drive)
    if step == "blackbox" and (both := both_outputs(experiments, drive)) is not None:
        roles = both
    elif step in ("blackbox", "compare"):  # one output
        return {*roles.inputs, *[r for r in roles.outputs if r in AT_MOTOR][:1]}
    used = {*roles.inputs, *roles.outputs}
    if criterion == "inverse":  # instruments
        used |= {name for name, role in ROLES.items() if role.kind == "reference"}
    return used


def _used_by_steady(experiments: Sequence[Experiment], drive: Drive) -> set[str]:
    """The torque and the motor's motion; of two bodies also the shaft torque, and the load's motion with it."""
    common = set.intersection(*(set(e.signals) for e in experiments))
    voltages = VOLTAGES if fed_by_voltages(drive) else ()
    used = {"motor_torque", *voltages, *[r for r in AT_MOTOR if r in common][:1]}
    if len(drive.bodies) == 2 and "shaft_torque" in common:
        used |= {"shaft_torque", *[r for r in ("load_speed", "load_angle") if r in common][:1]}
    return used


def unused_roles(experiments: Sequence[Experiment], used: Collection[str], drive: Drive | None,
                 step: str) -> list[Finding]:
    """One finding on the roles that the step does not use; a warning where the drive has no such body.

    used   the roles that it takes
    drive  that it models; None: none
    """
    there = dict.fromkeys(role for e in experiments for role in e.signals)
    common = set.intersection(*(set(e.signals) for e in experiments))
    unused, impossible = [], []
    for role in there:
        if role in used:
            continue
        if drive and (reason := _why_impossible(role, drive)):
            impossible.append(f"{role} ({reason})")
        else:
            unused.append(f"{role} ({_why_unused(role, common, used, drive)})")
    if not (unused or impossible):
        return []
    return [Finding(
        "warning" if impossible else "note", "role-not-used",
        f"{step} does not use {', '.join([*impossible, *unused])}.", {"roles": len(unused) + len(impossible)},
        "Give the bodies and shafts of the drive the names that the roles use "
        f"(drive: bodies: [{', '.join(drive.bodies)}])."
        if drive and impossible else "")]


def _why_impossible(role: str, drive: Drive) -> str:
    """Why no model of this drive can have a role; empty if one can."""
    owner, _, what = role.rpartition("_")
    if role in INPUTS:
        return f"the drive has no body {owner}" if owner == "motor2" and owner not in drive.bodies else ""
    if role_of(role).kind == "reference" or any(role in choices for choices in sensors_of(drive)):
        return ""
    if owner in ("load", "shaft") and not drive.shafts:
        return "the drive has one body"
    kind = "shaft" if what == "torque" and role not in ROLES else "body"
    return f"the drive has no {kind} {owner}"


def _why_unused(role: str, common: Collection[str], used: Collection[str], drive: Drive | None) -> str:
    """Why a role that the drive can have is not used."""
    if role not in common:
        return "not in every recording"
    choices = next((c for c in sensors_of(drive) if role in c), ()) if drive else ()
    alternative = next((c for c in choices if c in used), None)
    return f"{alternative} is used instead" if alternative else "not requested"
