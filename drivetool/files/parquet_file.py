"""A recording as Parquet: a column per channel on one clock, else a row per value."""

from __future__ import annotations

from io import BytesIO

import numpy as np

from drivetool.logs.experiment import Recording


def recording_bytes(recording: Recording) -> bytes:
    """The file that gives the same recording when it is read; the same bytes for the same recording.

    recording  channels with units; time in seconds from its origin, which is noted in the metadata
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

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

        def spread(texts):
            # Each text once: of a dictionary that repeats one, Arrow writes bits that were never set.
            kinds = list(dict.fromkeys(texts))
            codes = np.repeat(np.array([kinds.index(text) for text in texts], np.int32), sizes)
            return pa.DictionaryArray.from_arrays(codes, pa.array(kinds, pa.string()))

        arrays = [spread(list(channels)), pa.array(np.concatenate([c.time for c in channels.values()])),
                  pa.array(np.concatenate([c.values for c in channels.values()])),
                  spread([c.unit for c in channels.values()])]
        fields = [pa.field("channel", arrays[0].type), pa.field("time", pa.float64(), metadata={"unit": "s"}),
                  pa.field("value", pa.float64()), pa.field("unit", arrays[3].type)]
        table = pa.table(arrays, schema=pa.schema(fields, metadata))
    buffer = BytesIO()
    # Streams of equal bytes compress far better than floats as they are.
    pq.write_table(table, buffer, compression="zstd", use_dictionary=["channel", "unit"],
                   column_encoding={f.name: "BYTE_STREAM_SPLIT" for f in fields if f.type == pa.float64()})
    return buffer.getvalue()
