"""From what a channel's numbers say to SI, role by role."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivetool.errors import BadRecording, Finding
from drivetool.logs.channel_map import ChannelMap, RoleEntry, require_rated
from drivetool.logs.experiment import ROLES, Channel, Recording
from drivetool.logs.units import RELATIVE, parse_unit


@dataclass(frozen=True)
class Signal:
    """A role's signal on its own clock: time (n,) [s], values (n,) in the SI unit `si`."""

    time: np.ndarray
    values: np.ndarray
    si: str


def to_signals(recording: Recording, chosen: Mapping[str, str],
               channel_map: ChannelMap | None) -> tuple[dict[str, Signal], list[Finding]]:
    """Every chosen channel in SI, in the order of ROLES; infinite values become missing ones.

    chosen   role -> channel name
    returns  role -> Signal, findings
    raises   BadRecording: unknown or missing unit, % without rated value, no value at all
    """
    signals, findings = {}, []
    for role in ROLES:
        if role not in chosen:
            continue
        channel = recording.channels[chosen[role]]
        entry = channel_map.roles[role] if channel_map else RoleEntry(chosen[role])
        values, si = _convert(channel, entry, role, recording.name)
        finite = np.isfinite(values)
        count = int(np.sum(~finite))
        if count == len(values):
            raise BadRecording(f"values of {role} in {recording.name}", f"none in channel '{chosen[role]}'",
                               "Choose another channel, or leave the role out.")
        if count:
            values = np.where(finite, values, np.nan)
            findings.append(Finding(
                "warning", "missing-values",
                f"{role} has no finite value at {100 * count / len(values):.2g} % of its samples.",
                {"role": role, "samples": count, "of": len(values), "share": count / len(values)},
                "Check the recorder and the sensor."))
        signals[role] = Signal(channel.time, values, si)
    return signals, findings


def _convert(channel: Channel, entry: RoleEntry, role: str, log: str) -> tuple[np.ndarray, str]:
    """((n,) values in SI, SI unit); values that are SI already are passed on untouched."""
    where = f"{role} (channel '{entry.channel}') in {log}"
    unit = parse_unit(entry.unit or channel.unit, ROLES[role], where)
    require_rated(role, unit, entry.rated)
    values = channel.values
    if entry.scale != 1.0:
        values = entry.scale * values
    if entry.offset != 0.0:
        values = values + entry.offset
    if entry.sign < 0:
        values = -values
    if unit.dimension == RELATIVE:
        rated = parse_unit(entry.rated.unit, ROLES[role], where)
        return rated.to_si(unit.to_si(values) * entry.rated.value), rated.si
    return unit.to_si(values), unit.si


def shared_units(signals: Mapping[str, Signal], log: str) -> tuple[str, str, list[Finding]]:
    """(torque unit, motion unit, findings) of the record.

    The chain has one torque unit and one motion unit; only a table behind a ratio may move in
    another one than the motors.
    """
    torques = {role: s.si for role, s in signals.items() if ROLES[role] == "torque"}
    motions = {role: s.si.removesuffix("/s") for role, s in signals.items() if ROLES[role] != "torque"}
    turning = {role: si for role, si in motions.items() if not role.startswith("table_")}
    for what, units in (("torque", torques), ("motion", turning)):
        if len(set(units.values())) > 1:
            raise BadRecording(f"one unit of {what} for all roles of {log}",
                               ", ".join(f"{role} in {si}" for role, si in units.items()),
                               "Convert with `scale` and `unit` in the channel map, or leave a role out.")
    motion = next(iter((turning or motions).values()), None)
    torque = next(iter(torques.values()), None)
    if motion is None:
        motion = "m" if torque == "N" else "rad"
    if torque is None:
        torque = "N" if motion == "m" else "Nm"
    findings = []
    if (torque, motion) in (("N", "rad"), ("Nm", "m")):
        findings.append(Finding(
            "warning", "unusual-units", f"The torque is in {torque} but the motion in {motion}; inertias "
            f"come out in {torque} s^2/{motion}.", {"torque_unit": torque, "motion_unit": motion},
            "Check the units of the two channels."))
    return torque, motion, findings
