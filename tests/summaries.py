"""Summaries of a site on disk. That of the pages: python -m tests.summaries fixtures/site/summary.parquet"""

import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.check.trends.sites import site, step

# As batch writes it, the columns that trends do not read left out.
FIELDS = {"recording": pa.string(), "machine": pa.string(), "start": pa.timestamp("us", "UTC"), "order": pa.int32(),
          "step": pa.string(), "parameter": pa.string(), "value": pa.float64(), "unit": pa.string(),
          "std": pa.float64(), "status": pa.string(), "kind": pa.string()}
PARAMETERS = ("shaft.half_gap", "motor.viscous", "motor.inertia")


def table_of(rows):
    """Rows of `drivetool.logs.formats.summary` as the table of a summary."""
    columns = {name: [getattr(row, name) for row in rows] for name in FIELDS}
    columns["start"] = [None if s is None else round(s * 1e6) for s in columns["start"]]
    return pa.table([pa.array(columns[name], pa.int64() if name == "start" else kind).cast(kind)
                     for name, kind in FIELDS.items()], schema=pa.schema(FIELDS))


def write_summary(path, rows):
    pq.write_table(table_of(rows), path)
    return path


def site_of_the_pages():
    """Three presses: the gap of one opens in a step, the friction of another grows slowly."""
    changed = {(3, "shaft.half_gap"): step(9.0, 15), (2, "motor.viscous"): 0.4 * np.arange(25)}
    rows = site(4, machines=3, changed=changed)
    return [row for row in rows if row.parameter in PARAMETERS]


if __name__ == "__main__":
    Path(sys.argv[1]).parent.mkdir(parents=True, exist_ok=True)
    write_summary(sys.argv[1], site_of_the_pages())
