"""The trends of a site as findings, and the one entry: rows of a summary in, findings and trends out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from drivetool.files.shapes import trend_shapes as shapes
from drivetool.files.yaml import first_of
from drivetool.finding import Finding
from drivetool.logs.formats import Row
from drivetool.site.trends.alarm import DEFAULT_ALARM_RATIO
from drivetool.site.trends.change_points import MIN_SERIES_LENGTH
from drivetool.site.trends.outliers import Outlier
from drivetool.site.trends.sentences import drift_text, lower_first_letter, outlier_text, series_subject, step_text
from drivetool.site.trends.series import Series, series_of, without_copies
from drivetool.site.trends.trend import Change, Trend, trends

# Times 1 / sqrt(n), the standard deviation of the correlation of n independent recordings: one in 700 exceeds it.
CORRELATION_SIGNIFICANCE = 3.0
ALARM_ADVICE = ("Look for what changed at the machine at that time: wear, lubrication, load, temperature or a "
                "repair.")
OUTLIER_ADVICE = ("Check that its machine, its channels and their units are named correctly, then what else was "
                  "recorded.")
NEWEST_OUTLIER_ADVICE = "It is the newest recording: if the next one agrees with it, the trend has a step."
SMALL_CHANGE_ADVICE = "Watch it; --alarm sets the alarm threshold."


def trends_of(rows: Sequence[Row], alarm: float = DEFAULT_ALARM_RATIO) -> tuple[tuple[Finding, ...],
                                                                                tuple[Trend, ...]]:
    """Drifts, steps and outliers of the parameters of every machine of a site over its recordings.

    rows     of a summary, in any order
    alarm    size of a change, in standard deviations of the runs before, from which it is an alarm
    returns  (findings, one Trend per machine, parameter and step). Alarms come first, then smaller changes, each in
             the order of the series, then outlying recordings, then remarks on the recordings.
    """
    original_rows, copies = without_copies(rows)
    found_trends = trends(series_of(original_rows), alarm)
    return (*_change_findings(found_trends), *_outlier_findings(found_trends),
            *_recording_remarks(original_rows, copies, found_trends)), found_trends


def _change_findings(found: Sequence[Trend]) -> list[Finding]:
    """A finding per step and per drift."""
    series_counts = Counter((t.series.machine, t.series.parameter) for t in found)
    alarms, small = [], []
    for trend in found:
        series, drift = trend.series, trend.drift
        step = series_counts[series.machine, series.parameter] > 1
        seen: list[tuple[Change | shapes.DriftSection, str, dict[str, Any]]] = [
            (each, step_text(series, each, step),
             {"last_before": each.last_before, "first_after": each.first_after, "before": each.before,
              "after": each.after}) for each in trend.changes]
        if drift is not None and drift.significant:
            seen.insert(0, (drift, drift_text(series, drift, step), {
                "first": series.recordings[0], "last": series.recordings[-1], "before": drift.before,
                "after": drift.after, "slope_per_recording": drift.per_recording.value}))
        for change, text, own in seen:
            evidence = {
                "machine": series.machine, "parameter": series.parameter, "step": series.step, "unit": series.unit,
                **own, "std": change.std, "ratio": change.ratio, "chance": change.chance}
            if change.alarm:
                alarms.append(Finding("warning", "trend-alarm", text, evidence, ALARM_ADVICE))
            else:
                small.append(Finding("note", "small-change", text, evidence, SMALL_CHANGE_ADVICE))
    return [*alarms, *small]


def _outlier_findings(found: Sequence[Trend]) -> list[Finding]:
    """A finding per recording that is an outlier of its machine in any parameter."""
    by_recording: dict[tuple[str, str], list[tuple[Trend, Outlier]]] = {}
    for trend in found:
        for outlier in trend.outliers:
            by_recording.setdefault((trend.series.machine, outlier.recording), []).append((trend, outlier))
    return [_outlier_finding(sorted(places, key=lambda pair: -pair[1].ratio)) for places in by_recording.values()]


def _outlier_finding(outliers: Sequence[tuple[Trend, Outlier]]) -> Finding:
    trend, outlier = outliers[0]
    newest = outlier.place == len(trend.series.values) + len(trend.outliers) - 1
    other_subjects = [lower_first_letter(series_subject(other.series)) for other, _ in outliers[1:]]
    return Finding(
        "warning", "outlying-recording",
        f"{outlier_text(trend.series, outlier)} It is left out of this trend"
        f"{f' and of those of {first_of(other_subjects)}' if other_subjects else ''}.",
        {"machine": trend.series.machine, "recording": outlier.recording, "parameter": trend.series.parameter,
         "step": trend.series.step, "unit": trend.series.unit, "value": outlier.value, "expected": outlier.expected,
         "std": outlier.std, "ratio": outlier.ratio, "chance": outlier.chance, "parameters": len(outliers)},
        (f"{NEWEST_OUTLIER_ADVICE} " if newest else "") + OUTLIER_ADVICE)


def _recording_remarks(rows: Sequence[Row], copies: Mapping[str, str], found: Sequence[Trend]) -> list[Finding]:
    """The limits of what the recordings show."""
    remarks = []
    if copies:
        remarks.append(Finding(
            "note", "copied-recordings",
            f"{first_of([f'{copy} repeats {first}' for copy, first in copies.items()])}: all values and standard "
            "deviations are equal. The copies are left out.", {"copies": len(copies)},
            "Take the copies out of the site."))
    longest_series = dict.fromkeys((row.machine for row in rows if row.recording and row.machine), 0)
    for trend in found:
        longest_series[trend.series.machine] = max(longest_series[trend.series.machine], trend.sample_count)
    short_series = {machine: count for machine, count in longest_series.items() if count < MIN_SERIES_LENGTH}
    if short_series:
        remarks.append(Finding(
            "note", "few-recordings",
            f"A trend needs {MIN_SERIES_LENGTH} recordings of one kind with a value, or days where a day has "
            f"several; too few: {first_of([f'{m} has {n}' for m, n in short_series.items()])}. For such a "
            "machine only means are stated, if any.",
            dict(short_series), "Record it again on further days."))
    remarks += _unit_findings(found)
    dateless = list(dict.fromkeys(t.series.machine for t in found if t.series.starts is None))
    if dateless:
        remarks.append(Finding(
            "note", "undated-recordings",
            f"Not all recordings of {first_of(dateless)} have a date. Only their order is "
            "used; days are not distinguished.", {"machines": len(dateless)},
            "Log absolute times, or name recordings by date."))
    missing = {series_subject(t.series): t.series.left_out for t in found if t.series.left_out}
    if missing:
        remarks.append(Finding(
            "note", "values-missing",
            f"Recordings without a fitted value are left out: "
            f"{first_of([f'{n} of {what}' for what, n in missing.items()])}.", {"series": len(missing)},
            "See in the files of these recordings why they have none."))
    return [*remarks, *_correlation_findings(found)]


def _unit_findings(found: Sequence[Trend]) -> list[Finding]:
    """Series that differ only in their units."""
    units: dict[tuple[str, str, str, str], list[Series]] = {}
    for series in (trend.series for trend in found):
        units.setdefault((series.machine, series.parameter, series.step, series.kind), []).append(series)
    several = [f"{series_subject(each[0])} in {' and '.join(s.unit or 'none' for s in each)}"
               for each in units.values() if len(each) > 1]
    if not several:
        return []
    return [Finding(
        "note", "units-mixed",
        f"Recordings state one parameter in several units: {first_of(several)}. Each unit is a separate series, "
        "and changes from one to the other are not tested.", {"parameters": len(several)},
        "Give the recordings of a machine one unit of torque, by a channel map or a torque constant.")]


def _correlation_findings(found: Sequence[Trend]) -> list[Finding]:
    """Series whose neighbouring recordings are correlated."""
    correlated = sorted((t for t in found if t.correlation > CORRELATION_SIGNIFICANCE / t.sample_count ** 0.5),
                        key=lambda t: -t.correlation)
    if not correlated:
        return []
    return [Finding(
        "note", "recordings-correlated",
        f"Apart from steps and drift, neighbouring recordings are correlated: "
        f"{first_of([f'{series_subject(t.series)} by {t.correlation:.2f}' for t in correlated])} (correlation). "
        "Intervals and tests include it.", {"series": len(correlated), "largest": correlated[0].correlation},
        "Look for what varies slowly, such as the temperature. Small steps of this "
        "series may be parts of such a slow variation.")]
