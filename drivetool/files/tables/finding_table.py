"""The registry of finding codes, as plain values and as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivetool.errors import BadOption, nearest
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
    for stage in dict.fromkeys(entry["stage"] for entry in entries):
        table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False, title=Text(stage),
                      title_justify="left")
        for title in ("code", "severity", "meaning"):
            table.add_column(title, overflow="fold", no_wrap=title == "severity")
        for entry in entries:
            if entry["stage"] == stage:
                table.add_row(*map(Text, (entry["code"], "/".join(entry["severities"]), entry["meaning"])))
        console.print(table)
    console.print(Text("  drivetool findings CODE gives the action for one of them.", style="dim"))


def print_finding(entry: Mapping[str, Any], console: Console) -> None:
    """One code in full."""
    lines = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    names = {"severities": "severity", "action": "what to do"}
    for key, value in {**entry, "severities": " or ".join(entry["severities"])}.items():
        lines.add_row(Text(names.get(key, key), style="bold"), Text(value))
    console.print(lines)
