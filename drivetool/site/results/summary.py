"""The summary of a site: one long table, as Parquet and CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import StringIO
from typing import Any

from drivetool.files.results import table_bytes
from drivetool.site.results.job_sentences import Told

# Column -> its type in Parquet. The last two are the cost of a run, and no part of the result.
COLUMNS = {
    "recording": "string", "machine": "string", "kind": "string", "start": "timestamp", "order": "int32",
    "step": "string", "parameter": "string", "value": "double", "unit": "string", "std": "double",
    "ci95_low": "double", "ci95_high": "double", "status": "string", "verdict": "string", "fit": "double",
    "findings": "string", "problem": "string", "seconds": "double", "peak_memory_mb": "double",
}
COSTS = ("seconds", "peak_memory_mb")
FIT = "simulation_fit_percent"


@dataclass(frozen=True)
class Entry:
    """One step of one recording, or of a machine's together.

    recording  path from the folder of the site file; empty where the recordings of a machine are fitted together
    start      when the log began (UTC, ISO 8601); None without absolute time
    order      place in the machine's order, from one; 0 of recordings together
    told       what its file tells; None beside a problem
    problem    why there is no file, in one sentence
    """

    recording: str
    machine: str
    kind: str
    start: str | None
    order: int
    step: str
    told: Told | None
    problem: str | None = None
    seconds: float | None = None
    peak_memory_mb: float | None = None


def rows(entries: Iterable[Entry]) -> list[tuple[Any, ...]]:
    """The rows of the summary, columns as in COLUMNS; one without a parameter for what has none."""
    found = []
    for e in entries:
        told = e.told or Told()
        fit = (told.fit or {}).get(FIT)
        codes = " ".join(code for _, code, _ in told.findings)
        for parameter in told.parameters or ((None,) * 7,):
            found.append((e.recording, e.machine, e.kind, e.start, e.order, e.step, *parameter, told.verdict,
                          None if fit is None else float(fit), codes, e.problem, e.seconds, e.peak_memory_mb))
    return found


def summary_csv(table: Sequence[tuple[Any, ...]]) -> str:
    """The rows as CSV in UTF-8: a dot as decimal sign, empty fields where there is nothing."""
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    doubles = [kind == "double" for kind in COLUMNS.values()]
    for row in table:
        writer.writerow(["" if value is None else repr(float(value)) if double else value
                         for value, double in zip(row, doubles, strict=True)])
    return stream.getvalue()


def summary_parquet(table: Sequence[tuple[Any, ...]]) -> bytes:
    """The rows as Parquet; the same bytes for the same rows."""
    return table_bytes(COLUMNS, table)
