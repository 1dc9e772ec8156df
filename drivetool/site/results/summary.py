"""The summary of a site: one long table, as Parquet and CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import StringIO
from typing import Any

from drivetool.files.results import table_bytes
from drivetool.site.results.step_result import StepResult

# Column -> its type in Parquet. The last two are the cost of a run, not part of the result.
SUMMARY_COLUMNS = {
    "recording": "string", "machine": "string", "kind": "string", "start": "timestamp", "order": "int32",
    "step": "string", "parameter": "string", "value": "double", "unit": "string", "std": "double",
    "ci95_low": "double", "ci95_high": "double", "status": "string", "verdict": "string", "fit": "double",
    "findings": "string", "problem": "string", "seconds": "double", "peak_memory_mb": "double",
}
COST_COLUMNS = ("seconds", "peak_memory_mb")
FIT_FIGURE = "simulation_fit_percent"


@dataclass(frozen=True)
class Entry:
    """One step of one recording, or of all recordings of a machine together.

    recording  path from the folder of the site file; empty where the recordings of a machine are fitted together
    start      when the log began (UTC, ISO 8601); None without absolute time
    order      place in the machine's order, from one; 0 for recordings together
    result     content of its file; None with a problem
    problem    why there is no file, in one sentence
    output     path of its file from the folder of the results
    """

    recording: str
    machine: str
    kind: str
    start: str | None
    order: int
    step: str
    result: StepResult | None
    problem: str | None = None
    seconds: float | None = None
    peak_memory_mb: float | None = None
    output: str | None = None


def summary_rows(entries: Iterable[Entry]) -> list[tuple[Any, ...]]:
    """The rows of the summary, columns as in SUMMARY_COLUMNS; an entry without parameters gives one row."""
    table = []
    for e in entries:
        result = e.result or StepResult()
        fit = (result.fit or {}).get(FIT_FIGURE)
        codes = " ".join(code for _, code, _ in result.findings)
        for parameter in result.parameters or ((None,) * 7,):
            table.append((e.recording, e.machine, e.kind, e.start, e.order, e.step, *parameter, result.verdict,
                          None if fit is None else float(fit), codes, e.problem, e.seconds, e.peak_memory_mb))
    return table


def summary_csv(table: Sequence[tuple[Any, ...]]) -> str:
    """The rows as CSV in UTF-8: a dot as decimal sign, empty fields for missing values."""
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(SUMMARY_COLUMNS)
    doubles = [kind == "double" for kind in SUMMARY_COLUMNS.values()]
    for row in table:
        writer.writerow(["" if value is None else repr(float(value)) if double else value
                         for value, double in zip(row, doubles, strict=True)])
    return stream.getvalue()


def summary_parquet(table: Sequence[tuple[Any, ...]]) -> bytes:
    """The rows as Parquet; the same bytes for the same rows."""
    return table_bytes(SUMMARY_COLUMNS, table)
