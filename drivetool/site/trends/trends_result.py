"""The trends file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from drivetool.files.results import Inputs, file_sections, finding_sections, tool_section
from drivetool.files.shapes import trend_shapes as shapes
from drivetool.files.yaml import counted_noun, to_plain, written
from drivetool.finding import Finding
from drivetool.logs import display_name
from drivetool.logs.formats import file_sha256
from drivetool.site.trends.trend import Trend


def trends_file(findings: Sequence[Finding], found: Sequence[Trend], options: Mapping[str, Any],
                inputs: Inputs = ()) -> shapes.TrendsFile:
    """The trends file.

    findings, found  as `trends_of` returns them
    options          of the command; inputs: (name, sha256) of the summary
    """
    return shapes.TrendsFile(
        schema=shapes.TRENDS_SCHEMA, tool=tool_section(), step="trend", outcome=count_sentence(findings, found),
        series=[_series_section(each) for each in found], findings=finding_sections(findings),
        inputs=file_sections(inputs), options=to_plain(options))


def count_sentence(findings: Sequence[Finding], found: Sequence[Trend]) -> str:
    """How many alarms there are, in how many series, in one sentence."""
    machines = len({each.series.machine for each in found})
    counts = [counted_noun(sum(f.code == code for f in findings), noun) for code, noun in (
        ("trend-alarm", "alarm"), ("small-change", "smaller change"), ("outlying-recording", "outlying recording"))]
    return f"{counted_noun(len(found), 'series')} of {counted_noun(machines, 'machine')}: {', '.join(counts)}"


def summary_input(path: str) -> tuple[str, str]:
    """(name, sha256) of a summary that was read."""
    return display_name(Path(path)), file_sha256(path)


def _series_section(trend: Trend) -> shapes.SeriesSection:
    series = trend.series
    return shapes.SeriesSection(
        machine=series.machine, parameter=series.parameter, step=series.step,
        kind=series.kind, unit=series.unit,
        first=series.recordings[0], last=series.recordings[-1], left_out=series.left_out,
        outliers=[written(outlier, shapes.OutlierSection) for outlier in trend.outliers],
        mean=written(trend.mean, shapes.MeanSection),
        parts=[written(part, shapes.MeanSection) for part in trend.parts],
        drift=trend.drift and written(trend.drift, shapes.DriftSection),
        changes=[written(change, shapes.ChangeSection) for change in trend.changes],
        correlation=to_plain(trend.correlation),
        reason=trend.reason)
