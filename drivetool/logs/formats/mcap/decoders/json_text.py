"""JSON messages: many at once where they are what they should be, one by one where not."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import Any

import msgspec
import numpy as np

from drivetool.logs.channels import Path, Selector, find
from drivetool.logs.formats.mcap.container import Offsets

_NUMBER = bool | int | float | None


def loads(message: bytes) -> dict | None:
    """One message; None if it is none. Unlike msgspec, json reads the NaN that many recorders write."""
    try:
        found = json.loads(message)
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def is_number(value: Any) -> bool:
    """Whether a value is a number, or the null that stands for a missing one."""
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


class JsonColumns:
    """Columns of numbers at `paths`."""

    def __init__(self, paths: Sequence[Path]):
        self._paths = list(paths)
        kind, self._read = _message_type(self._paths)
        self._decoder = msgspec.json.Decoder(list[kind])

    def read(self, places: Offsets, lengths: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """The numbers of the messages at n places with `lengths` (n,); see layout.Columns."""
        view = memoryview(places.data)
        ends = (places.starts + lengths).tolist()
        texts = [view[first:last] for first, last in zip(places.starts.tolist(), ends, strict=True)]
        try:
            messages = self._decoder.decode(b"[" + b",".join(texts) + b"]")
        except (ValueError, RecursionError):  # not JSON, not UTF-8, or not numbers
            messages = []
        good = np.ones(len(texts), bool)
        if len(messages) == len(texts):
            return [_number_column(list(map(read, messages))) for read in self._read], good
        trees = [loads(bytes(text)) for text in texts]
        good[:] = [tree is not None for tree in trees]
        return [_number_column([find(tree, path) if tree is not None else None for tree in trees])
                for path in self._paths], good


def _message_type(paths: list[Path]) -> tuple[type, list]:
    """(type that holds what the paths need and skips the rest, a function per path that reads it)."""
    wanted: dict[str, list[Path]] = {}
    for path in paths:
        wanted.setdefault(str(path[0]), []).append(path)
        if len(path) > 1 and isinstance(path[1], Selector):
            wanted.setdefault(path[1].key, [])
    fields, readers = [], {}
    names = {f"f{i}": key for i, key in enumerate(wanted)}
    for field, group in zip(names, wanted.values(), strict=True):
        if group and all(len(path) == 1 for path in group):
            fields.append((field, _NUMBER, None))
            readers |= {path: attrgetter(field) for path in group}
        elif group and all(len(path) > 1 and isinstance(path[1], str) for path in group):
            kind, inner = _message_type([path[1:] for path in group])
            fields.append((field, kind | None, None))
            readers |= {path: _nested_field_reader(attrgetter(field), read)
                        for path, read in zip(group, inner, strict=True)}
        else:
            fields.append((field, Any, None))
            readers |= {path: _bracket_path_reader(path, {n: f for f, n in names.items()}) for path in group}
    kind = msgspec.defstruct("Message", fields, rename=names, frozen=True, gc=False)
    return kind, [readers[path] for path in paths]


def _bracket_path_reader(path: Path, fields: dict[str, str]):
    """A reader of a path with brackets."""
    keys = [str(path[0]), *(step.key for step in path[1:2] if isinstance(step, Selector))]
    reads = [(key, attrgetter(fields[key])) for key in keys]
    return lambda message: find({key: read(message) for key, read in reads}, path)


def _nested_field_reader(outer, inner):
    """A reader of a field of a field that may be missing."""
    def read(message):
        found = outer(message)
        return None if found is None else inner(found)

    return read


def _number_column(values: list) -> np.ndarray:
    """(n,) whole numbers where all are, else floats with NaN for what is no number."""
    try:
        column = np.array(values)
    except ValueError:  # lists among them
        column = np.zeros(0)
    if column.dtype.kind in "if" and column.shape == (len(values),):
        return column
    return np.array([_to_float(v) if isinstance(v, int | float) else np.nan for v in values])


def _to_float(value: float) -> float:
    """A number as a float; NaN if it is too large for one."""
    try:
        return float(value)
    except OverflowError:
        return np.nan


def declared_paths(schema: Any, path: Path = ()) -> Iterator[Path]:
    """Paths of the numbers that a JSON schema declares."""
    properties = schema.get("properties") if isinstance(schema, dict) else None
    for key, inner in (properties.items() if isinstance(properties, dict) else ()):
        kinds = inner.get("type", ()) if isinstance(inner, dict) else ()
        kinds = {kinds} if isinstance(kinds, str) else set(kinds)
        if kinds & {"number", "integer"}:
            yield (*path, key)
        yield from declared_paths(inner, (*path, key))


def schema_unit(schema: Any, path: Path) -> str | None:
    """The property `unit` that a JSON schema gives a field, or the list that it is in."""
    found = None
    for step in path:
        if isinstance(step, str):
            properties = schema.get("properties") if isinstance(schema, dict) else None
            schema = properties.get(step) if isinstance(properties, dict) else None
            found = None
        else:
            schema = schema.get("items") if isinstance(schema, dict) else None
        own = schema.get("unit") if isinstance(schema, dict) else None
        found = own if isinstance(own, str) else found
    return found
