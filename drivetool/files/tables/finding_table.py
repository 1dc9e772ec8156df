"""The registry of finding codes, as plain values and as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console

from drivetool.errors import BadOption, nearest
from drivetool.files.tables.table import Column, Row, Table, lines, pairs
from drivetool.finding_codes import CODES, RENAMED, STAGES


def finding_entries(code: str | None = None) -> list[dict[str, Any]]:
    """Every code as plain values, stage by stage.

    code    of one finding, also as an earlier version named it; None: all of them
    raises  BadOption: an unknown code
    """
    code = RENAMED.get(code or "", code)
    if code is not None and code not in CODES:
        raise BadOption("a registered finding code", f"'{code}'", nearest(code, CODES))
    return [{"code": name, "stage": stage, "severities": list(entry.severities), "meaning": entry.meaning,
             "action": entry.action}
            for stage, table in STAGES.items() for name, entry in table.items() if code in (None, name)]


def print_findings_list(entries: Sequence[Mapping[str, Any]], console: Console) -> None:
    """One row per code, a table per stage."""
    columns = [Column("code", least=24), Column("severity"), Column("meaning")]
    for stage in dict.fromkeys(entry["stage"] for entry in entries):
        console.print(Table(columns, [Row((each["code"], "/".join(each["severities"]), each["meaning"]))
                                      for each in entries if each["stage"] == stage], stage))
    console.print(lines(["drivetool findings CODE gives the action for one of them."], "dim"))


def print_finding(entry: Mapping[str, Any], console: Console) -> None:
    """One code in full."""
    names = {"severities": "severity", "action": "what to do"}
    console.print(pairs((names.get(key, key), " or ".join(value) if key == "severities" else value)
                        for key, value in entry.items()))
