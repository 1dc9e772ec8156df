"""Trends as a table for the terminal, at 80 columns."""

from __future__ import annotations

from rich.console import Console

from drivetool.files.shapes import trend_shapes as shapes
from drivetool.files.tables.number_format import rounded, short
from drivetool.files.tables.table import Column, Row, Table, lines, numbers


def print_trends(file: shapes.TrendsFile, console: Console) -> None:
    """One row per series; its last column refers to the findings below."""
    columns = [Column("machine"), Column("parameter", least=14), *numbers("n", "mean", "+- 95 %"),
               Column("unit", fold=False), *numbers("s_r", "s_R", "per record", rank=1),
               Column("trend", fold=False)]
    console.print(Table(columns, [_series_row(each) for each in file.series], keys=2))
    console.print(lines(["s_r: scatter within a day; s_R: between days (std)"], "dim"), lines([file.outcome]))


def _series_row(series: shapes.SeriesSection) -> Row:
    """The mean with its interval, the scatter, the drift, and the trend in one word."""
    mean, alarms = series.mean, [change.alarm for change in series.changes]
    if series.drift is not None and series.drift.significant:
        alarms.append(series.drift.alarm)
    word = "alarm" if any(alarms) else "small" if alarms else "-"
    value, half = rounded(mean.value, None if mean.ci95 is None else (mean.ci95[1] - mean.ci95[0]) / 2.0)
    cells = (series.machine, series.parameter, str(mean.recordings), value, half, series.unit,
             short(mean.std_within_day, 2), short(mean.std_between_days, 2),
             short(series.drift and series.drift.per_recording.value, 2), word)
    return Row(cells, {"alarm": "bold red", "small": "yellow"}.get(word, ""))
