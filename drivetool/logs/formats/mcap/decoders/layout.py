"""Numbers out of many binary messages at once.

The decoder of its encoding walks a message once and finds where every number lies and which bytes
decide that (lengths, tags, names in selectors). All messages of the same length
with the same deciding bytes have their numbers at the same places, so they are read together. A
message that matches no other is read alone, from the same walk.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivetool.logs.channels import Path, find
from drivetool.logs.formats.mcap.container import Offsets

VARINTS = frozenset(("int64", "uint64", "int32", "uint32", "zigzag", "flag"))
# After MAX_NEW_LAYOUTS new layouts in a block that fit fewer than MIN_LAYOUT_MESSAGES messages on average, the rest
# is read one by one. A choice: learning a layout costs more than reading one message.
MAX_NEW_LAYOUTS, MIN_LAYOUT_MESSAGES = 16, 4
# Layouts that are remembered. A choice: each costs a comparison with all messages of a block.
MAX_KNOWN_LAYOUTS = 128


@dataclass(frozen=True)
class Leaf:
    """Where a number lies.

    offset, size  in the message [bytes]
    kind          a NumPy type ('<f8') or one of VARINTS
    """

    offset: int
    kind: str
    size: int


@dataclass(frozen=True)
class Default:
    """A number that is not sent because it is the default."""

    value: float | int


class Numbers:
    """`count` numbers of one kind in a row, as a list of leaves."""

    def __init__(self, offset: int, kind: str, size: int, count: int):
        self.offset, self.kind, self.size, self.count = offset, kind, size, count

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> Leaf:
        if not 0 <= index < self.count:
            raise IndexError(index)
        return Leaf(self.offset + index * self.size, self.kind, self.size)


class Text(str):
    """A text in a message, and where it lies."""

    offset: int
    size: int

    def __new__(cls, raw: bytes, offset: int):
        text = super().__new__(cls, raw.decode("utf-8", "replace"))
        text.offset, text.size = offset, len(raw)
        return text


@dataclass(frozen=True)
class WalkedMessage:
    """One message walked: its tree of leaves, and (length,) mask of the bits that decide where they lie."""

    tree: Any
    mask: bytearray


Walk = Callable[[bytes], WalkedMessage]


class BrokenMessage(ValueError):
    """A message that is not what its schema says."""


DECODE_ERRORS = (BrokenMessage, IndexError, RecursionError)


@dataclass(frozen=True)
class Layout:
    """Messages alike: length, (offset, kind, bits, mask) of the words that decide, a leaf or none per path."""

    length: int
    decides: tuple[tuple[int, str, int, int], ...]
    leaves: tuple[Leaf | Default | None, ...]

    def fits(self, places: Offsets) -> np.ndarray:
        """(n,) whether the messages of this length there are alike."""
        same = np.ones(len(places.starts), bool)
        for offset, kind, bits, mask in self.decides:
            word = np.dtype(kind).type
            same &= (places.read(offset, kind) & word(mask)) == word(bits)
        return same


class BinaryColumns:
    """Columns of numbers at `paths`, from messages that `walk` understands."""

    def __init__(self, walk: Walk, paths: list[Path]):
        self._walk, self._paths = walk, paths
        self._known: list[Layout] = []

    def read(self, places: Offsets, lengths: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """The numbers of the messages at n places with `lengths` (n,).

        returns  per path (n,) integers where all are, else floats with NaN where there is none;
                 (n,) whether the message could be read
        """
        count, data, starts = len(lengths), places.data, places.starts
        good = np.ones(count, bool)
        for layout in self._known[:1]:  # nearly always the only one
            if np.all(lengths == layout.length) and layout.fits(places).all():
                return [_leaf_values(places, leaf) for leaf in layout.leaves], good
        columns: list[np.ndarray | None] = [None] * len(self._paths)

        def put(here, layout):
            there = Offsets.of(data, starts[here])
            for i, leaf in enumerate(layout.leaves):
                columns[i] = _put_values(columns[i], count, here, _leaf_values(there, leaf))

        todo, learnt, fitted = np.arange(count), 0, 0
        for layout in self._known:
            here, todo = _split_by_layout(layout, data, starts, lengths, todo)
            if len(here):
                put(here, layout)
        while len(todo) and (learnt < MAX_NEW_LAYOUTS or fitted >= MIN_LAYOUT_MESSAGES * learnt):
            layout, learnt = self._learn(data, starts, lengths, todo[0]), learnt + 1
            if layout is None:
                good[todo[0]], todo = False, todo[1:]
                continue
            here, todo = _split_by_layout(layout, data, starts, lengths, todo)
            put(here, layout)
            fitted += len(here)
            if len(here) >= MIN_LAYOUT_MESSAGES and len(self._known) < MAX_KNOWN_LAYOUTS:
                self._known.append(layout)
        if len(todo):
            values, good[todo] = self._read_singly(data, starts[todo], lengths[todo])
            columns = [_put_values(c, count, todo, v) for c, v in zip(columns, values, strict=True)]
        return [np.full(count, np.nan) if c is None else c for c in columns], good

    def _read_singly(self, data: np.ndarray, starts: np.ndarray,
                     lengths: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """As `read`, one message after the other."""
        lists: list[list] = [[] for _ in self._paths]
        good = np.ones(len(starts), bool)
        for i, (first, length) in enumerate(zip(starts.tolist(), lengths.tolist(), strict=True)):
            message = data[first:first + length].tobytes()
            try:
                tree = self._walk(message).tree
                values = [_leaf_number(message, find(tree, path)) for path in self._paths]
            except DECODE_ERRORS:
                good[i], values = False, [0] * len(lists)
            for listed, value in zip(lists, values, strict=True):
                listed.append(value)
        return [np.array(listed) if all(type(v) is int for v in listed) else np.array(listed, float)
                for listed in lists], good

    def _learn(self, data: np.ndarray, starts: np.ndarray, lengths: np.ndarray, which: int) -> Layout | None:
        """The layout of one message; None if it is broken."""
        first, length = int(starts[which]), int(lengths[which])
        message = data[first:first + length].tobytes()
        try:
            shape = self._walk(message)
        except DECODE_ERRORS:
            return None
        compared: list = []
        leaves = [find(shape.tree, path, compared) for path in self._paths]
        for text in compared:
            if isinstance(text, Text):
                shape.mask[text.offset:text.offset + text.size] = b"\xff" * text.size
        leaves = tuple(leaf if isinstance(leaf, Leaf | Default) else None for leaf in leaves)
        return Layout(length, _deciding_words(message, shape.mask), leaves)


def _split_by_layout(layout: Layout, data: np.ndarray, starts: np.ndarray, lengths: np.ndarray,
                     todo: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(messages that the layout fits, the others)."""
    fit = lengths[todo] == layout.length
    mine = todo[fit]
    fit[fit] = layout.fits(Offsets.of(data, starts[mine]))
    return (todo, todo[:0]) if fit.all() else (todo[fit], todo[~fit])


def _deciding_words(message: bytes, mask: bytearray) -> tuple[tuple[int, str, int, int], ...]:
    """The bits that decide, in words of eight bytes, or of one in a message shorter than that."""
    size, kind = (8, "<u8") if len(message) >= 8 else (1, "u1")
    words, at = [], 0
    while True:
        at += len(mask[at:]) - len(mask[at:].lstrip(b"\0"))
        if at >= len(mask):
            return tuple(words)
        first = min(at, len(message) - size)
        bits = bytearray(size)
        bits[at - first:] = mask[at:first + size]
        care = int.from_bytes(bits, "little")
        words.append((first, kind, int.from_bytes(message[first:first + size], "little") & care, care))
        at = first + size


def _put_values(column: np.ndarray | None, count: int, here: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The column with values at some places; what has no value is NaN, and makes all of it floats."""
    if len(here) == count:
        return values
    if column is None:
        column = np.full(count, np.nan) if values.dtype.kind == "f" else np.zeros(count, values.dtype)
    if column.dtype.kind != values.dtype.kind:
        column = column.astype(float)
    column[here] = values
    return column


def _leaf_values(places: Offsets, leaf: Leaf | Default | None) -> np.ndarray:
    """(n,) floats or whole numbers at a leaf of every message; NaN if there is none."""
    if leaf is None:
        return np.full(len(places.starts), np.nan)
    if isinstance(leaf, Default):
        return np.full(len(places.starts), leaf.value)
    if leaf.kind in VARINTS:
        return _varints(places.rows(leaf.offset, leaf.size), leaf.kind)
    values = places.read(leaf.offset, leaf.kind)
    if values.dtype.kind == "f":
        return values.astype(float, copy=False)
    return _signed(values) if values.dtype.kind == "u" else values.astype(np.int64)


def _leaf_number(message: bytes, leaf: Any) -> float | int:
    """The number at a leaf of one message; NaN if there is none."""
    if isinstance(leaf, Default):
        return leaf.value
    if not isinstance(leaf, Leaf):
        return np.nan
    if leaf.kind in VARINTS:
        raw = np.frombuffer(message, np.uint8, leaf.size, leaf.offset)
        return _varints(raw[None], leaf.kind)[0].item()
    return np.frombuffer(message, leaf.kind, 1, leaf.offset)[0].item()


def _signed(values: np.ndarray) -> np.ndarray:
    """Unsigned numbers as signed ones, as floats if they do not fit."""
    fits = values.dtype.itemsize < 8 or not len(values) or int(values.max()) < 1 << 63
    return values.astype(np.int64 if fits else float)


def _varints(raw: np.ndarray, kind: str) -> np.ndarray:
    """(n,) numbers from (n, size) bytes, seven bits each, the low ones first."""
    total = np.zeros(len(raw), np.uint64)
    for i in range(raw.shape[1]):
        total |= (raw[:, i] & np.uint8(0x7F)).astype(np.uint64) << np.uint64(7 * i)
    if kind == "flag":
        return (total != 0).astype(np.int64)
    if kind == "zigzag":
        return (total >> np.uint64(1)).astype(np.int64) ^ -(total & np.uint64(1)).astype(np.int64)
    if kind == "uint64":
        return _signed(total)
    if kind == "int32":
        return (total & np.uint64(0xFFFFFFFF)).astype(np.uint32).view(np.int32).astype(np.int64)
    if kind == "uint32":
        return (total & np.uint64(0xFFFFFFFF)).astype(np.int64)
    return total.view(np.int64)
