"""Parquet files: a recording, with a column per channel on one clock, else a row per value; and any rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from io import BytesIO
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from drivetool.logs import Recording


def recording_bytes(recording: Recording) -> bytes:
    """The file that gives the same recording when it is read; the same bytes for the same recording.

    recording  channels with units; time in seconds from its origin, which is noted in the metadata
    """
    channels = recording.channels
    first = next(iter(channels.values())).time
    metadata = {"origin": repr(float(recording.origin))}
    if all(c.time is first or np.array_equal(c.time, first, equal_nan=True) for c in channels.values()):
        columns = {"time": (first, "s"), **{name: (c.values, c.unit) for name, c in channels.items()}}
        fields = [pa.field(name, pa.float64(), metadata={"unit": unit} if unit else None)
                  for name, (_, unit) in columns.items()]
        table = pa.table([values for values, _ in columns.values()], schema=pa.schema(fields, metadata))
    else:
        sizes = [len(c.values) for c in channels.values()]

        def dictionary_column(texts):
            # Each text once: of a dictionary that repeats one, Arrow writes bits that were never set.
            kinds = list(dict.fromkeys(texts))
            codes = np.repeat(np.array([kinds.index(text) for text in texts], np.int32), sizes)
            return pa.DictionaryArray.from_arrays(codes, pa.array(kinds, pa.string()))

        arrays = [dictionary_column(list(channels)), pa.array(np.concatenate([c.time for c in channels.values()])),
                  pa.array(np.concatenate([c.values for c in channels.values()])),
                  dictionary_column([c.unit for c in channels.values()])]
        fields = [pa.field("channel", arrays[0].type), pa.field("time", pa.float64(), metadata={"unit": "s"}),
                  pa.field("value", pa.float64()), pa.field("unit", arrays[3].type)]
        table = pa.table(arrays, schema=pa.schema(fields, metadata))
    # Streams of equal bytes compress far better than floats as they are.
    return parquet_bytes(table, use_dictionary=["channel", "unit"], column_encoding={
        f.name: "BYTE_STREAM_SPLIT" for f in fields if f.type == pa.float64()})


def parquet_bytes(table: pa.Table, **coding: Any) -> bytes:
    """A table as a Parquet file; coding: of its columns."""
    buffer = BytesIO()
    parquet.write_table(table, buffer, compression="zstd", **coding)
    return buffer.getvalue()


def table_bytes(columns: Mapping[str, str], rows: Sequence[tuple[Any, ...]]) -> bytes:
    """Rows as Parquet; the same bytes for the same rows.

    columns  name -> string, double, int32, or timestamp: ISO 8601 in the rows, UTC
    """
    kinds = {"string": pa.string(), "double": pa.float64(), "int32": pa.int32(),
             "timestamp": pa.timestamp("us", tz="UTC")}
    by_column = list(zip(*rows, strict=True)) or [()] * len(columns)
    arrays = []
    for values, kind in zip(by_column, columns.values(), strict=True):
        if kind == "timestamp":
            values = tuple(None if v is None else datetime.fromisoformat(v) for v in values)
        elif kind == "string":  # bytes of a file name that are no text, escaped
            values = tuple(None if v is None else v.encode("utf-8", "backslashreplace").decode() for v in values)
        elif kind == "double":
            values = tuple(None if v is None else float(v) for v in values)
        arrays.append(pa.array(values, kinds[kind]))
    return parquet_bytes(pa.table(arrays, names=list(columns)))
