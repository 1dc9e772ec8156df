"""Converts the numbers of channels to SI, role by role."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from drivetool.errors import BadRecording
from drivetool.finding import Finding
from drivetool.logs import (
    COUNTS,
    MOTOR_TORQUES,
    PERCENT,
    RELATIVE,
    Channel,
    Recording,
    Signal,
    is_motion,
    ordered_roles,
    parse_unit,
    quantity,
)
from drivetool.logs.channels.channel_map import ChannelMap, RoleEntry, choose_channels, require_scale
from drivetool.logs.samples import looks_unsigned, looks_wrapped, unwrap
from drivetool.quantity import ELECTRIC_UNITS

# No drive reaches this value in any unit; its square does not overflow.
MAX_ABS_VALUE = 1e100


def to_signals(recording: Recording, chosen: Mapping[str, str],
               channel_map: ChannelMap | None) -> tuple[dict[str, Signal], list[Finding]]:
    """Every chosen channel in SI, in the order of the roles; infinite and impossibly large values are none.

    chosen   role -> channel name
    returns  role -> Signal, findings
    raises   BadRecording: unknown or missing unit, % without rated value, no value at all
    """
    signals: dict[str, Signal] = {}
    findings: list[Finding] = []
    known_stamps: dict[tuple[int, bytes], np.ndarray] = {}
    for role in ordered_roles(chosen):
        channel = recording.channels[chosen[role]]
        entry = channel_map.roles[role] if channel_map else RoleEntry(chosen[role])
        values, si, more = _convert_channel(channel, entry, role, recording.name)
        findings += more
        known = np.abs(values) < MAX_ABS_VALUE
        if not known.any():
            raise BadRecording(f"values of {role} in {recording.name}", f"none in channel '{chosen[role]}'",
                               "Choose another channel, or leave the role out.")
        time, empty_stamps, invalid_count = channel.time, np.zeros(0), 0
        if not known.all():
            invalid_count = int(np.sum(~known & ~np.isnan(values)))
            # One array for all channels of a clock that lack the same stamps.
            time = known_stamps.setdefault((id(channel.time), known.tobytes()), channel.time[known])
            empty_stamps, values = channel.time[~known], values[known]
        if entry.shift:
            time, empty_stamps = time + entry.shift, empty_stamps + entry.shift
            findings.append(Finding(
                "note", "clock-corrected", f"{entry.shift:g} s were added to the time stamps of {role}, as the "
                "channel map says.", {"role": role, "shift": entry.shift}))
        signals[role] = Signal(time, values, si, empty_stamps, invalid_count)
    if channel_map:
        _require_plausible_shift(signals, channel_map, recording.name)
    return signals, findings


def _require_plausible_shift(signals: Mapping[str, Signal], channel_map: ChannelMap, log: str) -> None:
    """No `shift` takes a signal away from all others that it was logged with: one in milliseconds does."""
    spans = {role: (float(np.nanmin(s.time)), float(np.nanmax(s.time))) for role, s in signals.items()
             if np.isfinite(s.time).any()}
    for role, (first, last) in spans.items():
        shift = channel_map.roles[role].shift
        others = [span for other, span in spans.items() if other != role]
        if shift and others and not any(a <= last and first <= b for a, b in others) and any(
                a <= last - shift and first - shift <= b for a, b in others):
            raise BadRecording(f"a shift after which {role} overlaps the other signals in {log}",
                               f"{shift:g} s in a record of {last - first:.3g} s",
                               "Correct `shift`, in seconds, in the channel map.")


def _convert_channel(channel: Channel, entry: RoleEntry, role: str,
                     log: str) -> tuple[np.ndarray, str, list[Finding]]:
    """((n,) values in SI, SI unit, findings); values that are SI already are passed on untouched."""
    where = f"{role} (channel '{entry.channel}') in {log}"
    unit = parse_unit(entry.unit or channel.unit, quantity(role), where)
    require_scale(role, unit, entry)
    values, findings = channel.values, []
    if entry.absent is not None:
        values = np.where(np.isnan(values), entry.absent, values)
    if entry.wrap is not None:
        values, findings = unwrap(values, entry.wrap, role)
    elif quantity(role) == "angle":
        findings = looks_wrapped(values, role, unit.text)
    else:
        findings = looks_unsigned(values, role)
    if entry.scale != 1.0:
        values = entry.scale * values
    if entry.offset != 0.0:
        values = values + entry.offset
    if entry.sign < 0:
        values = -values
    if unit.dimension == RELATIVE and entry.rated is None:  # the input of a motor, whatever 100 % of it stand for
        return (values if unit.text == PERCENT else 100.0 * values), PERCENT, findings
    if unit.dimension == RELATIVE:
        rated = parse_unit(entry.rated.unit, quantity(role), where)
        return rated.to_si(unit.to_si(values) * entry.rated.value), rated.si, findings
    if unit.dimension == COUNTS:
        return values * (2 * np.pi / entry.per_rev), unit.si, findings
    return unit.to_si(values), unit.si, findings


def shared_units(signals: Mapping[str, Signal], log: str) -> tuple[str, str, dict[str, str], list[Finding]]:
    """(unit of the torques of a record, of its motions; roles whose torque is in another unit -> that; findings).

    The chain has one torque unit and one motion unit; only a table behind a ratio may move in
    another one than the motors, and the motors may be fed with A, V or % beside other torques in Nm or N.
    """
    torques = {role: s.si for role, s in signals.items() if quantity(role) == "torque"}
    inputs = {role: si for role, si in torques.items() if role in MOTOR_TORQUES and si in ELECTRIC_UNITS}
    others = {role: si for role, si in torques.items() if role not in inputs}
    if others and not set(others.values()) & set(ELECTRIC_UNITS) and len(set(inputs.values())) == 1:
        torques = others
    else:
        inputs = {}
    motions = {role: s.si.removesuffix("/s") for role, s in signals.items() if is_motion(role)}
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
            "warning", "units-mixed", f"The torque is in {torque} but the motion in {motion}; the "
            f"inertias have the unit {torque} s^2/{motion}.", {"torque_unit": torque, "motion_unit": motion},
            "Check the units of the two channels."))
    return torque, motion, inputs, findings


def in_si(recording: Recording, channel_map: ChannelMap | None) -> Recording:
    """The channels that play a role, under its name and in SI, on the clocks they have.

    raises  BadRecording: as `to_signals` and `choose_channels`
    """
    chosen = choose_channels(tuple(recording.channels), channel_map, recording.name)
    if channel_map and any(entry.unsigned for entry in channel_map.roles.values()):
        raise BadRecording("channels that need no channel map after the conversion",
                           "a torque without its sign (unsigned: true)",
                           "Keep the log and its map: the converted table would not state that the sign is "
                           "missing.")
    signals, findings = to_signals(recording, chosen, channel_map)
    channels = {role: Channel(signal.time, signal.values, signal.si) for role, signal in signals.items()}
    return replace(recording, channels=channels, findings=(*recording.findings, *findings))
