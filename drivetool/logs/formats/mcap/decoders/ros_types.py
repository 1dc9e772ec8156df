"""Message definitions of ROS 1 and 2 as text, and what types they declare."""

from __future__ import annotations

import re
from dataclasses import dataclass

from drivetool.logs.formats.mcap.decoders.layout import BrokenMessage

# name -> (NumPy kind without byte order, size); `char` and `byte` differ between the two.
PRIMITIVES = {
    "bool": ("u1", 1), "int8": ("i1", 1), "uint8": ("u1", 1), "int16": ("i2", 2), "uint16": ("u2", 2),
    "int32": ("i4", 4), "uint32": ("u4", 4), "int64": ("i8", 8), "uint64": ("u8", 8),
    "float32": ("f4", 4), "float64": ("f8", 8)}
_ROS1 = {**PRIMITIVES, "char": ("u1", 1), "byte": ("i1", 1)}
_ROS2 = {**PRIMITIVES, "char": ("i1", 1), "byte": ("u1", 1)}
_STAMPS = {True: {"builtin_interfaces/Time": (("sec", "int32"), ("nanosec", "uint32")),
                  "builtin_interfaces/Duration": (("sec", "int32"), ("nanosec", "uint32"))},
           False: {"time": (("secs", "uint32"), ("nsecs", "uint32")),
                   "duration": (("secs", "int32"), ("nsecs", "int32"))}}
_FIELD = re.compile(r"^([\w/]+)(<=\d+)?(\[(<=)?(\d*)\])?\s+([A-Za-z]\w*)\s*(=)?")
_UNIT = re.compile(r"#\s*\[([^\]]+)\]")


@dataclass(frozen=True)
class Field:
    """A field of a message.

    kind   (NumPy kind, size) of a number, "string", or the full name of another type
    count  None: one; 0: a sequence with its length before it; else an array of that length
    unit   as the comment at the field gives it in brackets: `float64 torque  # [Nm]`
    """

    name: str
    kind: tuple[str, int] | str
    count: int | None
    unit: str | None = None


Types = dict[str, tuple[Field, ...]]


def parse_definition(name: str, text: str, ros2: bool) -> Types:
    """The types in a definition.

    name     of the message; text: its definition, those it needs after lines of `=` and `MSG: name`
    returns  full name (package/Type) -> fields in order; `name` is the key of the message itself
    raises   Broken: a line that is none, or a type that is not defined
    """
    raw = {_short_name(name): []}
    current = _short_name(name)
    for line in text.splitlines():
        line = line.strip()
        if line.startswith("===") or not line:
            continue
        if line.startswith("MSG:"):
            current = _short_name(line[4:].strip())
            raw[current] = []
            continue
        entry = _parse_field(line)
        if entry:
            raw[current].append(entry)
    known = _ROS2 if ros2 else _ROS1
    for stamp, parts in _STAMPS[ros2].items():
        raw.setdefault(stamp, [(part, kind, None, None) for part, kind in parts])
    types = {owner: tuple(Field(field, known.get(kind) or _full_name(kind, owner, raw), count, unit)
                          for field, kind, count, unit in entries) for owner, entries in raw.items()}
    types[name] = types[_short_name(name)]
    return types


def _parse_field(line: str) -> tuple[str, str, int | None, str | None] | None:
    """(name, type, count, unit) of a line; None for a comment or a constant."""
    if line.startswith("#"):
        return None
    found = _FIELD.match(line)
    if not found:
        if line.startswith(("@", "---")):
            return None
        raise BrokenMessage(f"the line '{line[:40]}'")
    kind, _, brackets, bounded, size, name, constant = found.groups()
    if constant:
        return None
    count = None if brackets is None else 0 if bounded or not size else int(size)
    unit = _UNIT.search(line)
    return name, kind, count, unit[1].strip() if unit else None


def _short_name(name: str) -> str:
    """package/Type, whatever stands between."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}" if len(parts) > 1 else name


def _full_name(kind: str, owner: str, known: dict) -> str:
    """The full name of a type that a field of `owner` names."""
    if kind in ("string", "wstring"):
        return kind
    for name in (_short_name(kind), f"{owner.partition('/')[0]}/{kind}", f"std_msgs/{kind}"):
        if name in known:
            return name
    raise BrokenMessage(f"the type {kind}, which is not defined")
