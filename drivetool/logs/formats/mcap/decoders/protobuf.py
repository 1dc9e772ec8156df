"""Protobuf messages: what their descriptors declare, and where the numbers of one message lie."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from drivetool.logs.formats.mcap.decoders.layout import (
    BrokenMessage,
    Default,
    Leaf,
    Numbers,
    Text,
    Walk,
    WalkedMessage,
)

# Type numbers of descriptor.proto -> (kind of leaf, wire type, size of fixed ones).
_SCALARS = {1: ("<f8", 1, 8), 2: ("<f4", 5, 4), 3: ("int64", 0, 0), 4: ("uint64", 0, 0), 5: ("int32", 0, 0),
            6: ("<u8", 1, 8), 7: ("<u4", 5, 4), 8: ("flag", 0, 0), 13: ("uint32", 0, 0), 14: ("int32", 0, 0),
            15: ("<i4", 5, 4), 16: ("<i8", 1, 8), 17: ("zigzag", 0, 0), 18: ("zigzag", 0, 0)}
_STRING, _MESSAGE, _REPEATED = 9, 11, 3
_MAX_DEPTH = 60  # of nested messages; below the limit of 100 in Protobuf's own parsers. Deeper is damage.


@dataclass(frozen=True)
class Field:
    """A field: name, type number and, for a message, its name; whether it repeats; what it is if not sent."""

    name: str
    type: int
    message: str
    repeated: bool
    default: float | int | None


Types = dict[str, dict[int, Field]]


def protobuf_walk(name: str, descriptors: bytes) -> tuple[Walk, Types]:
    """How a message is walked.

    name         full name of the message; descriptors: a serialised FileDescriptorSet
    raises       Broken: descriptors that cannot be read, or without the message
    """
    types: Types = {}
    try:
        for file in _field_contents(_wire_fields(descriptors), 1):
            parts = _wire_fields(file)
            package, proto3 = _first_text(parts, 2), _first_text(parts, 12) == "proto3"
            for inner in _field_contents(parts, 4):
                _declare(inner, f"{package}." if package else "", proto3, types)
    except (IndexError, UnicodeDecodeError):
        raise BrokenMessage("descriptors that are cut short") from None
    if name not in types:
        raise BrokenMessage(f"no description of {name}")
    return partial(_walk, name=name, types=types), types


def _declare(descriptor: bytes, prefix: str, proto3: bool, types: Types) -> None:
    """Add a message type and those nested in it."""
    parts = _wire_fields(descriptor)
    full = prefix + _first_text(parts, 1)
    types[full] = dict(_field_of_descriptor(each, proto3) for each in _field_contents(parts, 2))
    for inner in _field_contents(parts, 3):
        _declare(inner, f"{full}.", proto3, types)


def _field_of_descriptor(descriptor: bytes, proto3: bool) -> tuple[int, Field]:
    """(number, Field) of a field descriptor."""
    parts = _wire_fields(descriptor)
    numbers = {number: value for number, value in parts if isinstance(value, int)}
    kind, repeated = numbers.get(5, 0), numbers.get(4) == _REPEATED
    # Only a proto3 field that is neither optional nor in a oneof is left out when it is zero.
    implicit = proto3 and 9 not in numbers and not numbers.get(17)
    default = (0.0 if kind in (1, 2) else 0) if implicit and kind in _SCALARS else None
    return numbers.get(3, 0), Field(_first_text(parts, 1), kind, _first_text(parts, 6).lstrip("."), repeated,
                                    default)


def _wire_fields(data: bytes) -> list[tuple[int, int | bytes | None]]:
    """(field number, number or bytes) of each field."""
    return [(number, data[begin:end] if wire == 2 else value)
            for number, wire, value, begin, end in _walk_wire(data, 0, len(data))]


def _field_contents(parts: list, number: int) -> list[bytes]:
    return [value for n, value in parts if n == number and isinstance(value, bytes)]


def _first_text(parts: list, number: int) -> str:
    return next((value.decode() for value in _field_contents(parts, number)), "")


def _walk_wire(data: bytes, first: int, last: int) -> Iterator[tuple[int, int, int | None, int, int]]:
    """(field number, wire type, number or None, where the content begins, where it ends) of each field."""
    at = first
    while at < last:
        tag, at = _varint(data, at)
        number, wire = tag >> 3, tag & 7
        begin = at
        value = None
        if wire == 0:
            value, at = _varint(data, at)
        elif wire == 1:
            at += 8
        elif wire == 5:
            at += 4
        elif wire == 2:
            size, begin = _varint(data, at)
            at = begin + size
        else:
            raise BrokenMessage(f"wire type {wire}")
        if at > last or number == 0:
            raise BrokenMessage("a field beyond its message")
        yield number, wire, value, begin, at


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """(number, where it ends)."""
    total = shift = 0
    while True:
        byte = data[at]
        at += 1
        total |= (byte & 0x7F) << shift
        if byte < 0x80:
            return total, at
        shift += 7
        if shift > 63:
            raise BrokenMessage("a number that is too long")


def _walk(message: bytes, name: str, types: Types) -> WalkedMessage:
    """One message; Broken if it is not what its descriptors say."""
    mask = bytearray(len(message))
    return WalkedMessage(_message(message, 0, len(message), name, types, mask, 0), mask)


def _message(data: bytes, first: int, last: int, name: str, types: Types, mask: bytearray,
             depth: int) -> dict[str, Any]:
    """The tree of a message that lies between two places."""
    fields = types.get(name)
    if fields is None or depth > _MAX_DEPTH:
        raise BrokenMessage(f"a message {name}")
    tree: dict[str, Any] = {}
    before = first
    for number, wire, _, begin, end in _walk_wire(data, first, last):
        field = fields.get(number)
        # The tag and a length before the content decide where everything lies.
        mask[before:begin] = b"\xff" * (begin - before)
        if wire == 0:
            mask[begin:end] = b"\x80" * (end - begin)
        before = end
        if field is not None:
            _add_field(tree, field, wire, data, begin, end, types, mask, depth)
    for field in fields.values():
        if field.name not in tree and (field.default is not None or field.repeated):
            tree[field.name] = [] if field.repeated else Default(field.default)
    return tree


def _add_field(tree: dict, field: Field, wire: int, data: bytes, begin: int, end: int, types: Types,
               mask: bytearray, depth: int) -> None:
    """Put one field into the tree; the last of several wins, as the format has it."""
    value: Any
    if field.type in _SCALARS:
        kind, usual, size = _SCALARS[field.type]
        if wire == 2 and field.repeated:
            found = _packed_numbers(data, begin, end, kind, size, mask)
            known = tree.get(field.name)
            tree[field.name] = found if not known else [*known, *found]
            return
        if wire != usual:
            raise BrokenMessage(f"{field.name} in another form")
        value = Leaf(begin, kind, end - begin)
    elif field.type == _MESSAGE and wire == 2:
        value = _message(data, begin, end, field.message, types, mask, depth + 1)
        known = tree.get(field.name)
        if not field.repeated and isinstance(known, dict):
            value = known | {key: each for key, each in value.items()
                             if key not in known or not isinstance(each, Default)}
    elif field.type == _STRING and wire == 2:
        value = Text(data[begin:end], begin)
    else:
        return
    if field.repeated:
        tree[field.name] = [*tree.get(field.name, ()), value]
    else:
        tree[field.name] = value


def _packed_numbers(data: bytes, begin: int, end: int, kind: str, size: int, mask: bytearray) -> Any:
    """Numbers without tags between them."""
    if size:
        if (end - begin) % size:
            raise BrokenMessage("a list that is cut short")
        return Numbers(begin, kind, size, (end - begin) // size)
    leaves, at = [], begin
    while at < end:
        _, after = _varint(data, at)
        leaves.append(Leaf(at, kind, after - at))
        mask[at:after] = b"\x80" * (after - at)
        at = after
    if at > end:
        raise BrokenMessage("a list that is cut short")
    return leaves
