"""Trends as a table for the terminal, at 80 columns."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivetool.files.shapes import trend_shapes as shapes
from drivetool.files.tables.result_tables import rounded, short


def print_trends(file: shapes.TrendsFile, console: Console) -> None:
    """One row per series; its last column refers to the findings below."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False)
    for title, side in (("machine", "left"), ("parameter", "left"), ("n", "right"), ("mean", "right"),
                        ("+- 95 %", "right"), ("unit", "left"), ("s_r", "right"), ("s_R", "right"),
                        ("per rec.", "right"), ("trend", "left")):
        table.add_column(title, justify=side, overflow="fold")
    for each in file.series:
        mean, word = each.mean, _trend_word(each)
        value, half = rounded(mean.value, None if mean.ci95 is None else (mean.ci95[1] - mean.ci95[0]) / 2.0)
        cells = (each.machine, each.parameter, str(mean.recordings), value, half, each.unit,
                 short(mean.std_within_day, 2), short(mean.std_between_days, 2),
                 short(each.drift and each.drift.per_recording.value, 2), word)
        table.add_row(*map(Text, cells), style={"alarm": "bold red", "small": "yellow"}.get(word, ""))
    console.print(table)
    console.print(Text("  s_r: scatter within a day; s_R: between days (std)", style="dim"))
    console.print(Text(f"  {file.outcome}"))


def _trend_word(series: shapes.SeriesSection) -> str:
    """The trend of a series in one word."""
    alarms = [change.alarm for change in series.changes]
    if series.drift is not None and series.drift.significant:
        alarms.append(series.drift.alarm)
    return "alarm" if any(alarms) else "small" if alarms else "-"
