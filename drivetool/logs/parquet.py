"""Parquet, wide: one column per channel and one with the time."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drivetool.errors import BadRecording
from drivetool.logs.channel_map import ChannelMap
from drivetool.logs.experiment import Channel, Recording
from drivetool.logs.units import parse_unit

if TYPE_CHECKING:
    import pyarrow as pa

    from drivetool.logs.read import Choose

TIME_NAMES = ("time", "t", "timestamp", "timestamps", "stamp", "time_stamp", "datetime")
_TICKS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}


def read_parquet(path: Path, choose: Choose, channel_map: ChannelMap | None,
                 lenient: bool = False) -> Recording:
    """A wide Parquet table; only the columns asked for are read.

    choose   called with the names of all columns but the time; returns those to read
    returns  Recording on one clock: the time column (named in the map, or one of TIME_NAMES, which may
             end in _s, _ms, _us or _ns), or the schema metadata `step` [s] if there is no such column
    raises   BadRecording: not Parquet, no rows, no time, columns that hold no numbers
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(path, page_checksum_verification=True)
    except (pa.ArrowException, OSError) as problem:
        reason = str(problem).split(". ")[0][:100]
        raise BadRecording(f"a Parquet file in {path.name}", f"something else ({reason})",
                           "Record or export it again; a half-written Parquet file cannot be read.") from None
    with file:
        schema = file.schema_arrow
        if file.metadata.num_rows == 0:
            raise BadRecording(f"samples in {path.name}", "a table without rows",
                               "Record or export it again.")
        stamp = _time_column(schema.names, channel_map, path.name)
        wanted = list(dict.fromkeys(choose([n for n in schema.names if n != stamp])))
        try:
            table = file.read(columns=[*wanted, *([stamp] if stamp else [])])
        except (pa.ArrowException, OSError) as problem:
            raise BadRecording(f"readable data in {path.name}", str(problem)[:100],
                               "The file is damaged; record or export it again.") from None
    time, origin = _time(table, stamp, schema, channel_map, path.name)
    channels = {}
    for name in wanted:
        unit = (table.schema.field(name).metadata or {}).get(b"unit")
        channels[name] = Channel(time, _numbers(table, name, path.name), unit.decode() if unit else None)
    return Recording(path.name, "", channels, (), origin)


def _time_column(names: list[str], channel_map: ChannelMap | None, log: str) -> str | None:
    """The column that holds the time, or None."""
    if channel_map and channel_map.time:
        if channel_map.time.channel not in names:
            raise BadRecording(f"time channel '{channel_map.time.channel}'", f"none in {log}",
                               "Correct `time` in the channel map.", names)
        return channel_map.time.channel
    for known in TIME_NAMES:
        for name in names:
            if re.fullmatch(rf"{known}(_?\[?(s|ms|us|ns)\]?)?", name.strip().lower()):
                return name
    return None


def _numbers(table: pa.Table, name: str, log: str) -> np.ndarray:
    """A column as (n,) floats, missing values as NaN."""
    import pyarrow as pa

    kind = table.schema.field(name).type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)):
        raise BadRecording(f"numbers in channel '{name}'", f"{kind} in {log}", "Choose another channel.")
    column = table.column(name).cast(pa.float64(), safe=False)
    return np.asarray(column.to_numpy(), dtype=float)


def _time(table: pa.Table, stamp: str | None, schema: pa.Schema, channel_map: ChannelMap | None,
          log: str) -> tuple[np.ndarray, float]:
    """((n,) seconds, origin [s]) of the table's clock."""
    import pyarrow as pa

    if stamp is None:
        return _from_step(schema, table.num_rows, log), 0.0
    column, kind = table.column(stamp), schema.field(stamp).type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        return _from_ticks(column.cast(pa.int64()), _TICKS[kind.unit])
    unit = _time_unit(stamp, schema, channel_map)
    if pa.types.is_integer(kind):
        found = parse_unit(unit, "time", f"the integer time column '{stamp}' of {log}")
        return _from_ticks(column.cast(pa.int64()), _TICKS[found.text])
    seconds = _numbers(table, stamp, log)
    return parse_unit(unit or "s", "time", f"time column '{stamp}' of {log}").to_si(seconds), 0.0


def _time_unit(stamp: str, schema: pa.Schema, channel_map: ChannelMap | None) -> str | None:
    """Unit of the time column: from the map, the field's metadata, or the end of its name."""
    if channel_map and channel_map.time and channel_map.time.unit:
        return channel_map.time.unit
    unit = (schema.field(stamp).metadata or {}).get(b"unit")
    if unit:
        return unit.decode()
    ending = re.search(r"_\[?(s|ms|us|ns)\]?$|\[(s|ms|us|ns)\]$", stamp.strip().lower())
    return (ending[1] or ending[2]) if ending else None


def _from_ticks(column: pa.ChunkedArray, per_second: int) -> tuple[np.ndarray, float]:
    """Integer time stamps, counted from the first one before they become floats."""
    import pyarrow.compute as pc

    missing = np.asarray(column.is_null().to_numpy())
    ticks = np.asarray(pc.fill_null(column, 0).to_numpy(), dtype=np.int64)
    known = ticks[~missing]
    first = int(known[0]) if len(known) else 0
    seconds = (ticks - first) / per_second
    seconds[missing] = np.nan
    return seconds, first / per_second


def _from_step(schema: pa.Schema, count: int, log: str) -> np.ndarray:
    """Time of a table without a time column, from `step` in its metadata."""
    text = (schema.metadata or {}).get(b"step")
    try:
        step = float(text) if text else 0.0
    except ValueError:
        step = 0.0
    if not (np.isfinite(step) and step > 0):
        raise BadRecording(f"a time column in {log}", f"columns {', '.join(schema.names[:20])}",
                           "Name it with `time: {channel: ..., unit: ...}` in the channel map.", TIME_NAMES)
    return np.arange(count) * step
