"""Summaries of a site on disk, for tests."""

import pyarrow as pa
import pyarrow.parquet as pq

# As batch writes it, the columns that trends do not read left out.
FIELDS = {"recording": pa.string(), "machine": pa.string(), "start": pa.timestamp("us", "UTC"), "order": pa.int32(),
          "step": pa.string(), "parameter": pa.string(), "value": pa.float64(), "unit": pa.string(),
          "std": pa.float64(), "status": pa.string(), "kind": pa.string()}


def table_of(rows):
    """Rows of `drivetool.logs.summary` as the table of a summary."""
    columns = {name: [getattr(row, name) for row in rows] for name in FIELDS}
    columns["start"] = [None if s is None else round(s * 1e6) for s in columns["start"]]
    return pa.table([pa.array(columns[name], pa.int64() if name == "start" else kind).cast(kind)
                     for name, kind in FIELDS.items()], schema=pa.schema(FIELDS))


def write_summary(path, rows):
    pq.write_table(table_of(rows), path)
    return path
