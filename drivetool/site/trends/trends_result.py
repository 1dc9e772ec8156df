"""The trends file."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivetool.errors import Finding
from drivetool.files.results import Inputs, file_sections, finding_sections, tool_section
from drivetool.files.shapes import trend_shapes as shapes
from drivetool.files.yaml import counted_noun, to_plain, written
from drivetool.logs import display_name
from drivetool.site.trends.outliers import Outlier
from drivetool.site.trends.random_effects import RandomEffects
from drivetool.site.trends.trend import Change, Trend


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
    return display_name(Path(path)), hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _series_section(trend: Trend) -> shapes.SeriesSection:
    series = trend.series
    return shapes.SeriesSection(
        machine=series.machine, parameter=series.parameter, step=series.step,
        kind=series.kind, unit=series.unit,
        first=series.recordings[0], last=series.recordings[-1], left_out=series.left_out,
        outliers=[_outlier_section(name, outlier) for name, outlier in trend.outliers],
        mean=_mean_section(trend.mean), parts=[_mean_section(part) for part in trend.parts],
        drift=trend.drift and written(trend.drift, shapes.DriftSection),
        changes=[_change_section(trend, change) for change in trend.changes],
        correlation=to_plain(trend.correlation),
        reason=trend.reason)


def _outlier_section(name: str, outlier: Outlier) -> shapes.OutlierSection:
    content = to_plain(asdict(outlier))
    del content["place"]
    return shapes.OutlierSection(recording=name, **content)


def _mean_section(mean: RandomEffects) -> shapes.MeanSection:
    return shapes.MeanSection(
        value=to_plain(mean.value), ci95=_plain_pair(mean.ci95), std_within_day=to_plain(mean.within_day),
        std_between_days=to_plain(mean.between_days), recordings=mean.recordings, days=mean.days)


def _change_section(trend: Trend, change: Change) -> shapes.ChangeSection:
    series, content = trend.series, to_plain(asdict(change))
    place = content.pop("place")
    began = None if series.starts is None else tuple(
        datetime.fromtimestamp(float(series.starts[i]), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        for i in (place - 1, place))
    return shapes.ChangeSection(last_before=series.recordings[place - 1], first_after=series.recordings[place],
                                began=began, **content)


def _plain_pair(pair: tuple[float, float] | None) -> tuple[float | None, float | None] | None:
    return None if pair is None else (to_plain(pair[0]), to_plain(pair[1]))
