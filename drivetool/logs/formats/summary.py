"""The summary of a site: one row per recording, step and parameter, read from Parquet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drivetool.errors import BadRecording
from drivetool.logs import shown

if TYPE_CHECKING:
    import pyarrow as pa

COLUMNS = ("recording", "machine", "start", "order", "step", "parameter", "value", "unit", "std", "status", "kind")
FINDINGS = "findings"  # codes, apart by blanks; a summary by another hand may have none
TEXTS = ("recording", "machine", "step", "parameter", "unit", "status", "kind", FINDINGS)
MAY_BE_EMPTY = ("unit", "status", "kind", FINDINGS)  # null is no text there
MICROSECONDS = 1e6
FIRST_YEAR, LAST_YEAR = -62135596800.0, 253402300799.0  # of a calendar, 1 and 9999, in s since 1970


@dataclass(frozen=True)
class Row:
    """A parameter, as one step found it from one recording.

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

    raises  BadRecording: no Parquet, a table without one of COLUMNS or with another type in it, no rows, or a
            parameter twice for one recording and step
    """
    name = shown(Path(path))
    table = _table(Path(path), name)
    if not table.num_rows:
        raise BadRecording(f"rows in {name}", "none", "Fit recordings first.")
    columns = [_column(table, column, name) for column in COLUMNS]
    said = _column(table, FINDINGS, name) if FINDINGS in table.column_names else [""] * table.num_rows
    rows = [Row(*values, findings=tuple(codes.split())) for *values, codes in zip(*columns, said, strict=True)]
    once(rows, name)
    return rows


def once(rows: Sequence[Row], name: str) -> None:
    """BadRecording where one recording and step have a parameter twice; name: of the summary."""
    counts = Counter((r.machine, r.recording, r.step, r.parameter) for r in rows)
    machine, recording, step, parameter = max(counts, key=lambda key: counts[key])
    if counts[machine, recording, step, parameter] > 1:
        times = counts[machine, recording, step, parameter]
        raise BadRecording(f"one row per recording, step and parameter in {name}",
                           f"{times} of {parameter or 'no parameter'} by {step} of {recording}",
                           "Leave out the rows that are repeated.")


def _table(path: Path, name: str) -> pa.Table:
    """The columns that count."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not path.exists():
        raise BadRecording("the summary of a site", f"no file {name}", "Check the path.")
    if path.is_dir():
        raise BadRecording("the summary of a site", f"the folder {name}", "Name the Parquet file in it.")
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            names = Counter(file.schema_arrow.names)
            if all(names[column] == 1 for column in COLUMNS):
                return file.read(columns=[*COLUMNS, *([FINDINGS] if names[FINDINGS] == 1 else [])])
    except (pa.ArrowException, OSError, ValueError) as problem:
        raise BadRecording(f"the summary of a site in Parquet in {name}",
                           f"something else ({str(problem).splitlines()[0].split('. ')[0][:100]})",
                           "Give the Parquet file that batch wrote.") from None
    wrong = {column: names[column] for column in COLUMNS if names[column] != 1}
    raise BadRecording(f"each column of a summary once in {name}",
                       ", ".join(f"{count or 'no'} {column}" for column, count in wrong.items()),
                       "Give the summary that batch wrote.", names)


def _seconds(start: int | None, name: str) -> float | None:
    """A start in seconds since 1970."""
    if start is None:
        return None
    if not FIRST_YEAR <= start / MICROSECONDS <= LAST_YEAR:
        raise BadRecording(f"starts between the years 1 and 9999 in {name}", f"{start} microseconds since 1970",
                           "Correct the clock of that log.")
    return start / MICROSECONDS


def _column(table: pa.Table, column: str, name: str) -> list:
    """The values of a column as Python has them; a start as seconds since 1970."""
    import pyarrow as pa

    target = pa.string() if column in TEXTS else {
        "start": pa.timestamp("us", "UTC"), "order": pa.int64()}.get(column, pa.float64())
    try:
        values = table.column(column).combine_chunks().cast(target)
        if column == "start":
            return [_seconds(v, name) for v in values.cast(pa.int64()).to_pylist()]
        found = values.to_pylist()
    except (pa.ArrowException, ValueError):
        raise BadRecording(f"a column {column} of type {target} in {name}", str(table.schema.field(column).type),
                           "Give the summary that batch wrote.") from None
    if column in MAY_BE_EMPTY:
        return ["" if v is None else v for v in found]
    if None in found and column not in ("parameter", "value", "std"):
        raise BadRecording(f"a {column} in every row of {name}", f"none in row {found.index(None) + 1}",
                           "Give the summary that batch wrote.")
    return found
