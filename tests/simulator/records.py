"""Log files as a logger would write them, the same bytes for the same values.

channels  name -> (values (n,), unit)
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import CompressionType, Writer

from tests.simulator.simulate import quantise

Channels = Mapping[str, tuple[np.ndarray, str]]

__all__ = ["Channels", "quantise", "white_noise", "write_mcap", "write_parquet"]


def white_noise(size: int, std: float, seed: int) -> np.ndarray:
    """(size,) normal noise; the same seed gives the same noise."""
    return std * np.random.default_rng(seed).standard_normal(size)


def write_parquet(path: Path | str, channels: Channels, step: float) -> None:
    """One float64 column per channel after `time` [s]; the unit is metadata of the field."""
    size = len(next(iter(channels.values()))[0])
    columns = {"time": (np.round(np.arange(size) * step, 9), "s"), **channels}
    fields = [pa.field(name, pa.float64(), nullable=False, metadata={"unit": unit})
              for name, (_, unit) in columns.items()]
    table = pa.table([np.asarray(values, float) for values, _ in columns.values()], schema=pa.schema(fields))
    # Streams of equal bytes compress far better than floats as they are.
    pq.write_table(table, path, compression="zstd", compression_level=9, use_dictionary=False,
                   use_byte_stream_split=True)


def write_mcap(path: Path | str, channels: Channels, step: float) -> None:
    """One JSON message per sample on /drive with all channels; the schema carries the units."""
    schema = {"type": "object", "properties": {
        name: {"type": "number", "unit": unit} for name, (_, unit) in channels.items()}}
    table = zip(*(np.asarray(values, float).tolist() for values, _ in channels.values()), strict=True)
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="", library="drivetool-simulator")
        kind = writer.register_schema("drive", "jsonschema", json.dumps(schema).encode())
        channel = writer.register_channel("/drive", "json", kind)
        for i, values in enumerate(table):
            when = round(i * step * 1e9)
            text = json.dumps(dict(zip(channels, values, strict=True)), separators=(",", ":"))
            writer.add_message(channel, when, text.encode(), when, i)
        writer.finish()
