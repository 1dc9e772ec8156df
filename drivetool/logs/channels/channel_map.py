"""The channel map: which channel plays which role, and what its numbers mean.

On disk it is YAML; `files/` parses it and hands over a plain mapping:

    schema: drivetool/channel-map/1
    roles:
      motor_torque: {channel: /drive.torque, unit: Nm, scale: 1, offset: 0, sign: -1}
      motor_speed:  {channel: n_act, unit: '%', rated: {value: 3000, unit: rpm}}
      motor_angle:  {channel: '/joints.position[name=motor]', unit: counts, per_rev: 8192, wrap: 65536}
      load_angle:   {channel: theta, time: theta_stamp, shift: 0.002}
      load_speed:   omega             # short form: the channel; unit from the log
    time: {channel: t, unit: ms, wrap: 4294967296}  # optional; or just the channel; for MCAP a stamp
                                       # field, log_time (the default) or publish_time
    torque_is: command                 # optional: command or measurement
    condition: [despike, lowpass cutoff=50]   # optional, in this order; see conditioning/steps.py

SI value = sign * (scale * raw + offset), converted from `unit`; `wrap` is undone before that, and a
message or row without a value, which is no sample, becomes `absent` where that is given.
Without `unit` the unit noted in the log is taken. A value in % (or in 1, per unit) is a share of
`rated` and needs it; only the input of a motor may stay in %. Counts need `per_rev`. `shift` is added
to the time stamps [s].
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

import msgspec

from drivetool.errors import BadOption, BadRecording, nearest
from drivetool.logs import (
    COUNTS,
    MOTOR_TORQUES,
    RELATIVE,
    ROLE_NAME_PATTERN,
    ROLES,
    Unit,
    ordered_roles,
    parse_unit,
    quantity,
    role_of,
)
from drivetool.logs.conditioning import parse_step

SCHEMA = "drivetool/channel-map/1"


class Rated(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The value that 100 % stands for."""

    value: float
    unit: str


class TimeEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The channel that holds the time stamps; for MCAP a field, log_time or publish_time.

    channel  name of the channel
    unit     of the time stamps, if the log does not say it
    wrap     counts at which the counter starts again, such as 4294967296
    """

    channel: str
    unit: str | None = None
    wrap: float | None = None


class RoleEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One role: SI value = sign * (scale * raw + offset), converted from `unit`.

    channel  name of the channel; in MCAP the part after the topic is enough where it is the only one
    unit     of the channel, if the log does not say it
    scale    factor on the raw value
    offset   added after the factor
    sign     -1 turns the channel round
    rated    what 100 % is
    per_rev  counts per revolution, for the unit `counts`
    wrap     the raw value at which the channel starts again, such as 65536 or 360; undone first
    unsigned whether the channel is a magnitude, as the current of many drives is; for motor_torque
    absent   the raw value of a message or row without one: 0 where a writer leaves zeros out
    time     the clock of this channel, if it is not the map's
    shift    seconds added to its time stamps
    """

    channel: str
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    sign: Literal[1, -1] = 1
    rated: Rated | None = None
    per_rev: float | None = None
    wrap: float | None = None
    unsigned: bool = False
    absent: float | None = None
    time: TimeEntry | str | None = None
    shift: float = 0.0

    @property
    def clock(self) -> TimeEntry | None:
        """The entry of its own clock, if it has one."""
        return TimeEntry(self.time) if isinstance(self.time, str) else self.time


UNSIGNED_ROLE = "motor_torque"  # the one role that may be logged without its sign
RoleName = Annotated[str, msgspec.Meta(pattern=ROLE_NAME_PATTERN)]


class ChannelMapFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The channel map as it is on disk.

    roles      role -> channel, by its name alone or with what is known of it; a further body or shaft of the drive
               has the roles <body>_speed, <body>_angle and <shaft>_torque
    time       the channel with the time stamps
    torque_is  whether the logged torque is the command or a measurement of it
    condition  conditioning steps, as after --condition, in their order
    """

    schema: Literal["drivetool/channel-map/1"]
    roles: dict[RoleName, RoleEntry | str]
    time: TimeEntry | str | None = None
    torque_is: Literal["command", "measurement", "unknown"] = "unknown"
    condition: list[str] = []


@dataclass(frozen=True)
class ChannelMap:
    """A checked channel map: role -> entry, the time channel if named, what the torque is, conditioning."""

    roles: Mapping[str, RoleEntry]
    time: TimeEntry | None = None
    torque_is: Literal["command", "measurement", "unknown"] = "unknown"
    condition: tuple[str, ...] = ()
    name: str = field(default="channel map", compare=False)

    @classmethod
    def from_mapping(cls, content: object, name: str = "the channel map") -> ChannelMap:
        """The map from what a YAML parser returns.

        content  mapping of the form in the module's docstring; name: for messages
        returns  ChannelMap
        raises   BadOption: unknown key (suggests the nearest), wrong type, unknown unit, % without rated
        """
        _check_keys(content, name)
        try:
            # strict=False: YAML 1.1 reads 1e-3 as a text, and means a number.
            file = msgspec.convert(content, ChannelMapFile, strict=False)
        except msgspec.ValidationError as problem:
            raise BadOption(f"a valid {name}", str(problem).replace("`$", "`map"),
                            f"Correct it; its form is {SCHEMA}.") from None
        given = {role: RoleEntry(entry) if isinstance(entry, str) else entry for role, entry in file.roles.items()}
        roles = {role: given[role] for role in ordered_roles(given)}
        if not roles:
            raise BadOption(f"at least one role in {name}", "none",
                            "Give each role its channel.", ROLES)
        for role, entry in roles.items():
            _check_entry(role, entry, name)
        for text in file.condition:
            parse_step(text)
        time = TimeEntry(file.time) if isinstance(file.time, str) else file.time
        for where, clock in [("time", time), *((f"time of {r}", e.clock) for r, e in roles.items())]:
            if clock and clock.unit is not None:
                parse_unit(clock.unit, "time", f"{where} in {name}", BadOption)
            if clock and clock.wrap is not None and not 1 < clock.wrap < math.inf:
                raise BadOption(f"a number of counts for wrap of {where}", f"{clock.wrap:g}",
                                f"Correct it in {name}.")
        return cls(roles, time, file.torque_is, tuple(file.condition), name)


def _check_keys(content: object, name: str) -> None:
    """Refuse keys that are not in the form; msgspec would, but cannot suggest the nearest."""
    def check_level(value, where, known):
        if not isinstance(value, Mapping):
            raise BadOption(f"keys with values in {where}", f"{type(value).__name__} {value!r:.40}",
                            f"Its keys are: {', '.join(known)}.")
        for key in value:
            if key not in known:
                raise BadOption(f"a known key in {where}", f"'{key}'", nearest(str(key), known))

    check_level(content, name, ChannelMapFile.__struct_fields__)
    if content.get("schema") != SCHEMA:
        raise BadOption(f"schema: {SCHEMA} in {name}", f"schema {content.get('schema')!r}",
                        f"Write `schema: {SCHEMA}` as its first line.")
    further = [key for key in content.get("roles") or () if isinstance(key, str) and role_of(key)]
    check_level(content.get("roles"), f"roles of {name}", tuple(dict.fromkeys([*ROLES, *further])))
    for role, entry in content["roles"].items():
        if not isinstance(entry, str):
            check_level(entry, f"{role} of {name}", RoleEntry.__struct_fields__)
            if not isinstance(entry.get("time"), str | None):
                check_level(entry["time"], f"time of {role}", TimeEntry.__struct_fields__)
            if entry.get("rated") is not None:
                check_level(entry["rated"], f"rated of {role}", Rated.__struct_fields__)
    if not isinstance(content.get("time"), str | None):
        check_level(content["time"], f"time of {name}", TimeEntry.__struct_fields__)


def _check_entry(role: str, entry: RoleEntry, name: str) -> None:
    """Numbers and units of one role."""
    numbers = {"scale": entry.scale, "offset": entry.offset, "shift": entry.shift}
    numbers |= {key: value for key, value in (("per_rev", entry.per_rev), ("wrap", entry.wrap),
                                              ("absent", entry.absent)) if value is not None}
    if entry.rated:
        numbers["rated value"] = entry.rated.value
        rated = parse_unit(entry.rated.unit, quantity(role), f"rated of {role} in {name}", BadOption)
        if rated.dimension in (RELATIVE, COUNTS):
            raise BadOption(f"a unit of {quantity(role)} for rated of {role}", f"'{entry.rated.unit}'",
                            "State what 100 % is, for example {value: 200, unit: Nm}.")
    if entry.unsigned and role != UNSIGNED_ROLE:
        raise BadOption(f"unsigned for {UNSIGNED_ROLE} only", role, f"Leave it out in {name}.")
    for key, value in numbers.items():
        if not math.isfinite(value) or (value == 0 and key not in ("offset", "shift", "absent")):
            raise BadOption(f"a finite {key} other than zero for {role}", f"{value:g}",
                            f"Correct it in {name}.")
    if entry.unit is not None:
        unit = parse_unit(entry.unit, quantity(role), f"{role} in {name}", BadOption)
        require_scale(role, unit, entry, BadOption)


def require_scale(role: str, unit: Unit, entry: RoleEntry, error=BadRecording) -> None:
    """Refuse a share of an unknown rated value, counts of an unknown encoder, and volts of what is no motor."""
    if unit.si == "V" and role not in MOTOR_TORQUES and quantity(role) != "voltage":
        raise error(f"{role} in Nm or N", f"'{unit.text}'",
                    "State the torque or force per volt, for example `scale: 50, unit: Nm`.")
    if unit.dimension == RELATIVE and entry.rated is None and role not in MOTOR_TORQUES:
        raise error(f"the rated value of {role}, which is given in {unit.text}", "none",
                    "Add to its role, for example `rated: {value: 200, unit: Nm}`.")
    if unit.dimension == COUNTS and entry.per_rev is None:
        raise error(f"the counts per revolution of {role}, which is given in counts", "none",
                    "Add to its role, for example `per_rev: 8192`.")
    if entry.per_rev is not None and unit.dimension != COUNTS:
        raise error(f"the unit counts for {role}, which has per_rev", f"'{unit.text}'",
                    "Write `unit: counts`, or leave per_rev out.")


def resolve_channel(name: str, available: Iterable[str]) -> str | None:
    """The one channel that `name` means: itself, or the only `/topic.name`; None if there is none."""
    available = list(available)
    if name in available:
        return name
    found = [c for c in available if c.startswith("/") and c.endswith(f".{name}")]
    if len(found) > 1:
        raise BadRecording(f"one channel '{name}'", "several", "Name one of them in full in the channel map.",
                           found)
    return found[0] if found else None


def choose_channels(available: Sequence[str], channel_map: ChannelMap | None, log: str,
                    further: Sequence[str] = ()) -> dict[str, str]:
    """Which channel of a log plays which role.

    available    names of the channels in the log
    channel_map  the map; None takes the channels named like the roles
    log          name of the log, for messages
    further      roles of bodies and shafts that the drive has besides those of the table
    returns      role -> channel name
    raises       BadRecording: a mapped channel is missing, a name is ambiguous, or no role is found
    """
    if channel_map is None:
        found = {role: resolve_channel(role, available) for role in (*ROLES, *further)}
        chosen = {role: name for role, name in found.items() if name is not None}
        if not chosen:
            raise BadRecording("channels named like the roles (motor_torque, motor_speed, ...)",
                               f"none in {log}", "Say with --map which channel plays which role.",
                               available)
        return chosen
    chosen = {}
    for role, entry in channel_map.roles.items():
        name = resolve_channel(entry.channel, available)
        if name is None:
            raise BadRecording(f"channel '{entry.channel}' for {role}", f"no such channel in {log}",
                               _suggest_channel(entry.channel, available), available)
        chosen[role] = name
    return chosen


def _suggest_channel(name: str, available: Iterable[str]) -> str:
    """The sentence that suggests a channel by its full name or by its field; all of them are listed already."""
    by_field = {channel.partition(".")[2] or channel: channel for channel in available}
    close = difflib.get_close_matches(name, [*available, *by_field], n=1, cutoff=0.6)
    return f"Did you mean '{by_field.get(close[0], close[0])}'?" if close else "Name one of those."
