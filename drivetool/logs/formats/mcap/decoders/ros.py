"""Messages of ROS 1, and of ROS 2 in CDR: where the numbers of one message lie."""

from __future__ import annotations

import struct
from functools import partial
from typing import Any

from drivetool.logs.formats.mcap.decoders.layout import BrokenMessage, Leaf, Numbers, Text, Walk, WalkedMessage
from drivetool.logs.formats.mcap.decoders.ros_types import Types, parse_definition

# A list with more elements that are not plain numbers has a damaged length; a choice far above any drive's.
MAX_LIST_LENGTH = 100_000


def ros_walk(name: str, definition: str, cdr: bool) -> tuple[Walk, Types]:
    """How a message is walked.

    cdr     ROS 2: aligned numbers after a head that gives the byte order; else ROS 1: no alignment, low byte first
    raises  Broken: a definition that is none
    """
    types = parse_definition(name, definition, ros2=cdr)
    return partial(_walk, name=name, types=types, cdr=cdr), types


def _walk(message: bytes, name: str, types: Types, cdr: bool) -> WalkedMessage:
    """One message; Broken if it is not what its definition says."""
    cursor = _Cursor(message, types, cdr)
    return WalkedMessage(cursor.message(name), cursor.mask)


class _Cursor:
    """A place in a message that moves on as fields are read."""

    def __init__(self, message: bytes, types: Types, cdr: bool):
        self.bytes, self.types, self.cdr = message, types, cdr
        self.mask = bytearray(len(message))
        self.at, self.origin, self.order, self.widest = 0, 0, "<", 1
        if cdr:
            # 0, 1: plain CDR; 6, 7: its second version, which aligns to four bytes at most.
            if len(message) < 4 or message[1] not in (0, 1, 6, 7):
                raise BrokenMessage("an encapsulation other than plain CDR")
            self.order = "<" if message[1] & 1 else ">"
            self.widest = 8 if message[1] < 2 else 4
            self.mask[:2] = b"\xff\xff"
            self.at = self.origin = 4

    def message(self, name: str) -> dict[str, Any]:
        """The tree of a type."""
        fields = self.types[name]
        if not fields and self.cdr:
            self._take(1)  # a message without fields is sent as one byte
        return {field.name: self._value(field.kind) if field.count is None
                else self._many(field.kind, field.count or self._length()) for field in fields}

    def _value(self, kind: tuple[str, int] | str) -> Any:
        """One number, text or message."""
        if isinstance(kind, tuple):
            code, size = kind
            self._align(size)
            return Leaf(self._take(size), self.order + code, size)
        if kind == "wstring":
            raise BrokenMessage("a wstring")
        return self._text() if kind == "string" else self.message(kind)

    def _many(self, kind: tuple[str, int] | str, count: int) -> Any:
        """A list of numbers, texts or messages."""
        if isinstance(kind, tuple):
            code, size = kind
            if count:
                self._align(size)
            return Numbers(self._take(size * count), self.order + code, size, count)
        if count > MAX_LIST_LENGTH:
            raise BrokenMessage(f"a list of {count}")
        return [self._value(kind) for _ in range(count)]

    def _text(self) -> Text:
        length = self._length()
        first = self._take(length)
        return Text(self.bytes[first:first + length - self.cdr * (length > 0)], first)

    def _take(self, size: int) -> int:
        """Where the next bytes begin, so many of them; the place moves behind them."""
        first, self.at = self.at, self.at + size
        if self.at > len(self.bytes):
            raise BrokenMessage("a message that is too short")
        return first

    def _length(self) -> int:
        """A length that is sent; it decides where what follows lies."""
        self._align(4)
        first = self._take(4)
        self.mask[first:first + 4] = b"\xff\xff\xff\xff"
        return struct.unpack_from(f"{self.order}I", self.bytes, first)[0]

    def _align(self, size: int) -> None:
        size = min(size, self.widest)
        self.at += -(self.at - self.origin) % size
