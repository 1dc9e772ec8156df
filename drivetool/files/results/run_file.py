"""The simulation of a record, as a Parquet table that every step can read like a recording."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from drivetool.check.validation import ModelRun
from drivetool.files.results.parquet_file import parquet_bytes


def run_table(run: ModelRun, about: Mapping[str, str]) -> bytes:
    """A column per role, the unit in its field metadata; the same run gives the same bytes.

    about    metadata of the table: record, its sha256, models
    returns  time [s]; inputs as logged; every output as simulated, under the name of its role; what
             was measured of them as <role>_measured, null where there was no value
    """
    columns = {"time": (run.time, "s"), **{role: (v, run.unit(role)) for role, v in run.inputs.items()}}
    columns |= {role: (values, run.unit(role)) for role, values in run.simulated.items()}
    columns |= {f"{role}_measured": (values, run.unit(role)) for role, values in run.measured.items()}
    fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, (_, unit) in columns.items()]
    arrays = [pa.array(np.ascontiguousarray(values), mask=np.isnan(values)) for values, _ in columns.values()]
    table = pa.table(arrays, schema=pa.schema(fields, metadata={
        key: text.encode("utf-8", "backslashreplace") for key, text in about.items()}))
    # Streams of equal bytes compress far better than floats as they are.
    return parquet_bytes(table, use_dictionary=False, use_byte_stream_split=True)
