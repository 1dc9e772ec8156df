"""The summary of a site: one row per recording, step and parameter, read from Parquet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from drivetool.errors import BadRecording
from drivetool.finding_codes import RENAMED
from drivetool.logs import display_name

SUMMARY_COLUMNS = ("recording", "machine", "start", "order", "step", "parameter", "value", "unit", "std", "status",
                   "kind")
FINDINGS_COLUMN = "findings"  # codes, separated by blanks; a summary from another program may lack the column
TEXT_COLUMNS = ("recording", "machine", "step", "parameter", "unit", "status", "kind", FINDINGS_COLUMN)
OPTIONAL_COLUMNS = ("unit", "status", "kind", FINDINGS_COLUMN)  # null is no text there
MICROSECONDS_PER_SECOND = 1e6
MIN_START, MAX_START = -62135596800.0, 253402300799.0  # of a calendar, 1 and 9999, in s since 1970


@dataclass(frozen=True)
class Row:
    """A parameter that one step found from one recording.

    recording  its path; empty where one step fitted all recordings of the machine together
    start   when the recording began, in seconds since 1970 (UTC); None where its log does not say
    order   its place among the recordings of the machine
    value, std  in `unit`; None where there is none, parameter too
    kind    what was recorded, in a word of the site file; findings: codes of what the step said
    """

    recording: str
    machine: str
    start: float | None
    order: int
    step: str
    parameter: str | None
    value: float | None
    unit: str
    std: float | None
    status: str = ""
    kind: str = ""
    findings: tuple[str, ...] = ()


def read_summary(path: Path | str) -> list[Row]:
    """The rows of a summary, in its order.

    raises  BadRecording: no Parquet, a table without one of SUMMARY_COLUMNS or with another type, no rows, or a
            parameter twice for one recording and step
    """
    name = display_name(Path(path))
    table = _read_table(Path(path), name)
    if not table.num_rows:
        raise BadRecording(f"rows in {name}", "none", "Fit recordings first.")
    columns = [_column_values(table, column, name) for column in SUMMARY_COLUMNS]
    codes_of_rows = _column_values(table, FINDINGS_COLUMN, name) if FINDINGS_COLUMN in table.column_names \
        else [""] * table.num_rows
    rows = [Row(*values, findings=tuple(RENAMED.get(code, code) for code in codes.split()))
            for *values, codes in zip(*columns, codes_of_rows, strict=True)]
    refuse_repeated_rows(rows, name)
    return rows


def refuse_repeated_rows(rows: Sequence[Row], name: str) -> None:
    """BadRecording where one recording and step have a parameter twice; name: of the summary."""
    counts = Counter((r.machine, r.recording, r.step, r.parameter) for r in rows)
    machine, recording, step, parameter = max(counts, key=lambda key: counts[key])
    if counts[machine, recording, step, parameter] > 1:
        times = counts[machine, recording, step, parameter]
        raise BadRecording(f"one row per recording, step and parameter in {name}",
                           f"{times} with {parameter or 'no parameter'}, step {step} and recording {recording}",
                           "Leave out the rows that are repeated.")


def _read_table(path: Path, name: str) -> pa.Table:
    """The columns of a summary."""
    if not path.exists():
        raise BadRecording("the summary of a site", f"no file {name}", "Check the path.")
    if path.is_dir():
        raise BadRecording("the summary of a site", f"the folder {name}", "Name the Parquet file in it.")
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            names = Counter(file.schema_arrow.names)
            if all(names[column] == 1 for column in SUMMARY_COLUMNS):
                return file.read(columns=[*SUMMARY_COLUMNS,
                                          *([FINDINGS_COLUMN] if names[FINDINGS_COLUMN] == 1 else [])])
    except (pa.ArrowException, OSError, ValueError) as problem:
        raise BadRecording(f"the summary of a site in Parquet in {name}",
                           f"something else ({str(problem).splitlines()[0].split('. ')[0][:100]})",
                           "Give the Parquet file that batch wrote.") from None
    wrong = {column: names[column] for column in SUMMARY_COLUMNS if names[column] != 1}
    raise BadRecording(f"each column of a summary once in {name}",
                       ", ".join(f"{count or 'no'} {column}" for column, count in wrong.items()),
                       "Give the summary that batch wrote.", names)


def _start_seconds(start: int | None, name: str) -> float | None:
    """A start in seconds since 1970."""
    if start is None:
        return None
    if not MIN_START <= start / MICROSECONDS_PER_SECOND <= MAX_START:
        raise BadRecording(f"starts between the years 1 and 9999 in {name}", f"{start} microseconds since 1970",
                           "Correct the clock of that log.")
    return start / MICROSECONDS_PER_SECOND


def _column_values(table: pa.Table, column: str, name: str) -> list:
    """The values of a column as Python has them; a start as seconds since 1970."""
    target = pa.string() if column in TEXT_COLUMNS else {
        "start": pa.timestamp("us", "UTC"), "order": pa.int64()}.get(column, pa.float64())
    try:
        values = table.column(column).combine_chunks().cast(target)
        if column == "start":
            return [_start_seconds(v, name) for v in values.cast(pa.int64()).to_pylist()]
        found = values.to_pylist()
    except (pa.ArrowException, ValueError):
        raise BadRecording(f"a column {column} of type {target} in {name}", str(table.schema.field(column).type),
                           "Give the summary that batch wrote.") from None
    if column in OPTIONAL_COLUMNS:
        return ["" if v is None else v for v in found]
    if None in found and column not in ("parameter", "value", "std"):
        raise BadRecording(f"a {column} in every row of {name}", f"none in row {found.index(None) + 1}",
                           "Give the summary that batch wrote.")
    return found
