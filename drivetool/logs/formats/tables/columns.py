"""Columns of an Arrow table as channels, nested ones included: `drive.torque`, `effort[0]`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from drivetool.errors import BadRecording
from drivetool.logs.channels import field_path

# The column, then names of fields and places in lists.
ColumnPath = tuple[str | int, ...]


def flat_names(schema: pa.Schema, stamps: Sequence[str]) -> dict[str, ColumnPath]:
    """Channel name -> steps of every column, fields of nested ones separately, those of the clock left out.

    Lists of a fixed length are listed element by element; others can be named by the map.
    """
    return {name: steps for field in schema for name, steps in _flat_fields(field, (field.name,), field.name)
            if name not in stamps}


def _flat_fields(field: pa.Field, steps: ColumnPath, name: str) -> Iterator[tuple[str, ColumnPath]]:
    if pa.types.is_struct(field.type):
        for inner in field.type:
            yield from _flat_fields(inner, (*steps, inner.name), f"{name}.{inner.name}")
    elif pa.types.is_fixed_size_list(field.type) and field.type.list_size <= field_path.MAX_LISTED_ELEMENTS:
        yield from ((f"{name}[{i}]", (*steps, i)) for i in range(field.type.list_size))
    else:
        yield name, steps


def column_path(text: str, schema: pa.Schema) -> ColumnPath | None:
    """The steps behind a name; None if there is no such column."""
    if text in schema.names:
        return (text,)
    path = field_path.parse(text)
    if path is None or not all(isinstance(step, str | int) for step in path):
        return None
    try:
        field_at(schema, path)
    except (KeyError, AttributeError):
        return None
    return path


def field_at(schema: pa.Schema, steps: ColumnPath) -> pa.Field:
    """The Arrow field at the end of the steps; KeyError if there is none."""
    if steps[0] not in schema.names:
        raise KeyError(steps[0])
    field = schema.field(steps[0])
    for step in steps[1:]:
        if isinstance(step, int):
            field = field.type.value_field
            continue
        index = field.type.get_field_index(step) if pa.types.is_struct(field.type) else -1
        if index < 0:
            raise KeyError(step)
        field = field.type.field(index)
    return field


def unit_of(schema: pa.Schema, steps: ColumnPath) -> str | None:
    """`unit` in the metadata of a field, or of the list or structure that it is in."""
    for last in range(len(steps), 0, -1):
        unit = (field_at(schema, steps[:last]).metadata or {}).get(b"unit")
        if unit:
            return unit.decode("utf-8", "replace")
    return None


def column_numbers(table: pa.Table, steps: ColumnPath, name: str, log: str) -> np.ndarray:
    """A column as (n,) floats, missing values as NaN.

    raises  BadRecording: it holds something else
    """
    column = table.column(steps[0])
    for step in steps[1:]:
        column = pc.struct_field(column, step) if isinstance(step, str) else _list_element(column, step)
    kind = column.type
    if pa.types.is_float64(kind) and not column.null_count:
        return column.to_numpy()
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)
            or pa.types.is_boolean(kind)):
        raise BadRecording(f"numbers in channel '{name}'", f"{kind} in {log}", "Choose another channel.")
    if pa.types.is_boolean(kind):
        column = column.cast(pa.int8())
    return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=float)


def _list_element(column: pa.ChunkedArray, index: int) -> pa.ChunkedArray:
    """Element `index` of every list; missing where the list is shorter."""
    long_enough = pc.greater(pc.fill_null(pc.list_value_length(column), 0), index)
    if not pc.any(long_enough).as_py():
        return pa.chunked_array([pa.nulls(len(column), column.type.value_type)])
    # list_element refuses lists that are too short.
    places = pc.indices_nonzero(long_enough)
    found = pc.list_element(column.take(places), index)
    at = np.full(len(column), -1)
    at[places.to_numpy()] = np.arange(len(places))
    return pc.take(found, pa.array(at, mask=at < 0))
