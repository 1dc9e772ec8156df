"""Trends to disk and to a person: the file, its table and what the pictures show."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivetool.check.trends.outliers import Outlier
from drivetool.check.trends.random_effects import RandomEffects
from drivetool.check.trends.trend import Change, Drift, Slope, Trend
from drivetool.errors import Finding
from drivetool.files import trend_shapes as shapes
from drivetool.files.result_file import Inputs, file_sections, finding_sections, tool_section
from drivetool.files.tables import rounded, short
from drivetool.files.text import plain, several
from drivetool.logs.experiment import shown


@dataclass(frozen=True)
class TrendExhibit:
    """What the picture of one machine shows: a panel per series."""

    title: str
    trends: tuple[Trend, ...]
    kind: str = "trend"


def trends_file(findings: Sequence[Finding], found: Sequence[Trend], options: Mapping[str, Any],
                inputs: Inputs = ()) -> shapes.TrendsFile:
    """The trends file.

    findings, found  as `check.trends.findings.trends_of` returns them
    options          of the command; inputs: (name, sha256) of the summary
    """
    return shapes.TrendsFile(
        schema=shapes.TRENDS_SCHEMA, tool=tool_section(), step="trend", outcome=outcome(findings, found),
        series=[_series(each) for each in found], findings=finding_sections(findings),
        inputs=file_sections(inputs), options=plain(options))


def outcome(findings: Sequence[Finding], found: Sequence[Trend]) -> str:
    """How many alarms there are, in how many series, in one sentence."""
    machines = len({each.series.machine for each in found})
    counts = [several(sum(f.code == code for f in findings), noun) for code, noun in (
        ("trend-alarm", "alarm"), ("small-change", "smaller change"), ("outlying-recording", "outlying recording"))]
    return f"{several(len(found), 'series')} of {several(machines, 'machine')}: {', '.join(counts)}"


def summary_input(path: str) -> tuple[str, str]:
    """(name, sha256) of a summary that was read."""
    return shown(Path(path)), hashlib.sha256(Path(path).read_bytes()).hexdigest()


def exhibits_of(found: Sequence[Trend]) -> tuple[list[TrendExhibit], list[str]]:
    """(a picture per machine, names of the machines); a series of equal values has no panel."""
    drawn = [each for each in found if not each.series.constant]
    machines = list(dict.fromkeys(each.series.machine for each in drawn))
    return [TrendExhibit(name, tuple(each for each in drawn if each.series.machine == name))
            for name in machines], machines


def print_trends(file: shapes.TrendsFile, console: Console) -> None:
    """One row per series; its last column names what stands in the findings below."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False)
    for title, side in (("machine", "left"), ("parameter", "left"), ("n", "right"), ("mean", "right"),
                        ("+- 95 %", "right"), ("unit", "left"), ("s_r", "right"), ("s_R", "right"),
                        ("per rec.", "right"), ("trend", "left")):
        table.add_column(title, justify=side, overflow="fold")
    for each in file.series:
        mean, word = each.mean, _word(each)
        value, half = rounded(mean.value, None if mean.ci95 is None else (mean.ci95[1] - mean.ci95[0]) / 2.0)
        cells = (each.machine, each.parameter, str(mean.recordings), value, half, each.unit,
                 short(mean.std_within_day, 2), short(mean.std_between_days, 2),
                 short(each.drift and each.drift.per_recording.value, 2), word)
        table.add_row(*map(Text, cells), style={"alarm": "bold red", "small": "yellow"}.get(word, ""))
    console.print(table)
    console.print(Text("  s_r: scatter within a day; s_R: between days (std)", style="dim"))
    console.print(Text(f"  {file.outcome}"))


def _word(series: shapes.SeriesSection) -> str:
    """What the series does, in a word."""
    alarms = [change.alarm for change in series.changes]
    if series.drift is not None and series.drift.significant:
        alarms.append(series.drift.alarm)
    return "alarm" if any(alarms) else "small" if alarms else "-"


def _series(trend: Trend) -> shapes.SeriesSection:
    series = trend.series
    return shapes.SeriesSection(
        machine=series.machine, parameter=series.parameter, step=series.step,
        kind=series.kind, unit=series.unit,
        first=series.recordings[0], last=series.recordings[-1], left_out=series.left_out,
        outliers=[_outlier(name, outlier) for name, outlier in trend.outliers], mean=_mean(trend.mean),
        parts=[_mean(part) for part in trend.parts], drift=trend.drift and _drift(trend.drift),
        changes=[_change(trend, change) for change in trend.changes], correlation=plain(trend.correlation),
        reason=trend.reason)


def _outlier(name: str, outlier: Outlier) -> shapes.OutlierSection:
    content = plain(asdict(outlier))
    del content["place"]
    return shapes.OutlierSection(recording=name, **content)


def _mean(mean: RandomEffects) -> shapes.MeanSection:
    return shapes.MeanSection(
        value=plain(mean.value), ci95=_pair(mean.ci95), std_within_day=plain(mean.within_day),
        std_between_days=plain(mean.between_days), recordings=mean.recordings, days=mean.days)


def _drift(drift: Drift) -> shapes.DriftSection:
    content = plain(asdict(drift)) | {"significant": drift.told}
    del content["told"]
    return shapes.DriftSection(**content | {
        "per_recording": _slope(drift.per_recording), "per_day": drift.per_day and _slope(drift.per_day)})


def _slope(slope: Slope) -> shapes.SlopeSection:
    return shapes.SlopeSection(value=plain(slope.value), std=plain(slope.std), ci95=_pair(slope.ci95))


def _change(trend: Trend, change: Change) -> shapes.ChangeSection:
    series, content = trend.series, plain(asdict(change))
    place = content.pop("place")
    began = None if series.starts is None else tuple(
        datetime.fromtimestamp(float(series.starts[i]), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        for i in (place - 1, place))
    return shapes.ChangeSection(last_before=series.recordings[place - 1], first_after=series.recordings[place],
                                began=began, **content)


def _pair(pair: tuple[float, float] | None) -> tuple[float | None, float | None] | None:
    return None if pair is None else (plain(pair[0]), plain(pair[1]))
