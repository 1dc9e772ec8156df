"""The time stamps of a table: floats, whole numbers, Arrow time stamps and durations."""

from __future__ import annotations

import re

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from drivetool.errors import BadRecording
from drivetool.logs import parse_unit
from drivetool.logs.channels import TimeEntry, as_seconds, require_time_resolution, unwrap_counter
from drivetool.logs.formats.tables.columns import column_numbers, column_path, field_at

TIME_NAMES = ("time", "t", "timestamp", "timestamps", "stamp", "time_stamp", "datetime")
_TICKS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}


def time_column(schema: pa.Schema, entry: TimeEntry | None, log: str) -> str | None:
    """Name of the time column: the map's, or the first of TIME_NAMES, possibly with a unit at its end.

    raises  BadRecording: the map names one that is not there
    """
    if entry is not None:
        if not column_path(entry.channel, schema):
            raise BadRecording(f"time channel '{entry.channel}'", f"no such column in {log}",
                               "Correct `time` in the channel map.", schema.names)
        return entry.channel
    return next((name for known in TIME_NAMES for name in schema.names
                 if re.fullmatch(rf"{known}(_?\[?(s|ms|us|ns)\]?)?", name.strip().lower())), None)


def table_time(table: pa.Table, column: str, schema: pa.Schema, entry: TimeEntry | None,
               log: str) -> tuple[np.ndarray, float]:
    """((n,) seconds, origin [s]) of a time column.

    entry   what the map says of it, or None
    raises  BadRecording: whole numbers without a unit, or no numbers
    """
    steps = column_path(column, schema)
    kind, unit = field_at(schema, steps).type, _time_unit(column, schema, steps, entry)
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) or pa.types.is_integer(kind):
        stored = table.column(steps[0])
        for step in steps[1:]:
            stored = pc.struct_field(stored, step)
        if pa.types.is_integer(kind):
            ticks = _TICKS[parse_unit(unit, "time", f"the integer time column '{column}' of {log}").text]
        else:
            ticks = _TICKS[kind.unit]
        return _from_ticks(stored.cast(pa.int64()), ticks, entry)
    try:
        seconds = column_numbers(table, steps, column, log)
    except BadRecording:
        raise BadRecording(f"numbers or time stamps in the time column '{column}' of {log}", f"{kind}",
                           "Name another with `time:` in the channel map, or export it as time stamps.") from None
    to_si = parse_unit(unit or "s", "time", f"time column '{column}' of {log}").to_si
    if pa.types.is_float32(kind):
        require_time_resolution(seconds, to_si, column, log)
    seconds = unwrap_counter(seconds, entry)
    return to_si(seconds) if unit else as_seconds(seconds, column, log), origin_of(schema)


def origin_of(schema: pa.Schema) -> float:
    """`origin` [s] in the metadata of a table, from which its seconds are counted; 0 if there is none."""
    return _metadata_number(schema, b"origin")


def _metadata_number(schema: pa.Schema, key: bytes) -> float:
    """A number in the metadata of a table; 0 if there is none, or none that is finite."""
    try:
        found = float((schema.metadata or {}).get(key, 0))
    except ValueError:
        return 0.0
    return found if np.isfinite(found) else 0.0


def _time_unit(column: str, schema: pa.Schema, steps: tuple, entry: TimeEntry | None) -> str | None:
    """Unit of the time column: from the map, the field's metadata, or the end of its name."""
    if entry is not None and entry.unit:
        return entry.unit
    unit = (field_at(schema, steps).metadata or {}).get(b"unit")
    if unit:
        return unit.decode("utf-8", "replace")
    ending = re.search(r"_\[?(s|ms|us|ns)\]?$|\[(s|ms|us|ns)\]$", column.strip().lower())
    return (ending[1] or ending[2]) if ending else None


def _from_ticks(column: pa.ChunkedArray, per_second: int, entry: TimeEntry | None) -> tuple[np.ndarray, float]:
    """Integer time stamps, counted from the first one before they become floats."""
    missing = np.asarray(column.is_null().to_numpy())
    ticks = np.array(pc.fill_null(column, 0).to_numpy(), dtype=np.int64)
    known = ticks[~missing] = unwrap_counter(ticks[~missing], entry)
    first = int(known[0]) if len(known) else 0
    seconds = (ticks - first) / per_second
    seconds[missing] = np.nan
    return seconds, first / per_second


def from_step(schema: pa.Schema, count: int, log: str) -> np.ndarray:
    """Time of a table without a time column, from `step` in its metadata."""
    step = _metadata_number(schema, b"step")
    if not step > 0:
        raise BadRecording(f"a time column in {log}", f"columns {', '.join(schema.names[:20])}",
                           "Name it with `time: {channel: ..., unit: ...}` in the channel map.", TIME_NAMES)
    return np.arange(count) * step
