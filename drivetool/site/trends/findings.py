"""The trends of a site as findings, and the one entry: rows of a summary in, findings and trends out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from drivetool.errors import Finding
from drivetool.logs.formats import Row
from drivetool.site.trends.change_points import FEWEST
from drivetool.site.trends.outliers import Outlier
from drivetool.site.trends.sentences import drift_text, lowered, outlier_text, step_text, subject
from drivetool.site.trends.series import Series, series_of, without_copies
from drivetool.site.trends.trend import ALARM, Change, Drift, Trend, trends

LISTED = 5  # names in one sentence; the rest is counted
# Times 1 / root n, the standard deviation of a correlation of independent recordings. One of 700 is beyond.
CORRELATED = 3.0
SEE = "Look for what changed at the machine at that time: wear, lubrication, load, temperature or a repair."
LABEL = "See whether its machine, its channels and their units are named rightly, then what else was recorded."
NEXT = "It is the newest: with the next one like it this is a step."
WATCH = "Watch it; a change from which on it counts is set with --alarm."


def trends_of(rows: Sequence[Row], alarm: float = ALARM) -> tuple[tuple[Finding, ...], tuple[Trend, ...]]:
    """What the parameters of every machine of a site do over its recordings.

    rows     of a summary, in any order
    alarm    size of a change, in standard deviations of the runs before, from which on it is an alarm
    returns  (findings, one Trend per machine, parameter and step). Alarms come first, then what is smaller, each in
             the order of the series, then recordings far from all others, then remarks on the recordings.
    """
    left, copies = without_copies(rows)
    found = trends(series_of(left), alarm)
    return (*_changed(found), *_outlying(found), *_remarks(left, copies, found)), found


def _changed(found: Sequence[Trend]) -> list[Finding]:
    """A finding per step and per drift."""
    many = Counter((t.series.machine, t.series.parameter) for t in found)
    alarms, small = [], []
    for trend in found:
        series = trend.series
        step = many[series.machine, series.parameter] > 1
        if trend.drift is not None and trend.drift.told:
            text, evidence = drift_text(series, trend.drift, step), _drift_evidence(trend, trend.drift)
            if trend.drift.alarm:
                alarms.append(Finding("warning", "trend-alarm", text, evidence, SEE))
            else:
                small.append(Finding("note", "small-change", text, evidence, WATCH))
        for change in trend.changes:
            text, evidence = step_text(series, change, step), _step_evidence(trend, change)
            if change.alarm:
                alarms.append(Finding("warning", "trend-alarm", text, evidence, SEE))
            else:
                small.append(Finding("note", "small-change", text, evidence, WATCH))
    return [*alarms, *small]


def _step_evidence(trend: Trend, change: Change) -> dict[str, float | int | str]:
    series = trend.series
    return {"machine": series.machine, "parameter": series.parameter, "step": series.step, "unit": series.unit,
            "last_before": series.recordings[change.place - 1], "first_after": series.recordings[change.place],
            "before": change.before, "after": change.after, "std": change.std, "ratio": change.ratio,
            "chance": change.chance}


def _drift_evidence(trend: Trend, drift: Drift) -> dict[str, float | int | str]:
    series = trend.series
    return {"machine": series.machine, "parameter": series.parameter, "step": series.step, "unit": series.unit,
            "first": series.recordings[0], "last": series.recordings[-1], "before": drift.before,
            "after": drift.after, "slope_per_recording": drift.per_recording.value, "std": drift.std,
            "ratio": drift.ratio, "chance": drift.chance}


def _outlying(found: Sequence[Trend]) -> list[Finding]:
    """A finding per recording that lies far from the others of its machine, in whatever parameters."""
    by: dict[tuple[str, str], list[tuple[Trend, Outlier]]] = {}
    for trend in found:
        for name, outlier in trend.outliers:
            by.setdefault((trend.series.machine, name), []).append((trend, outlier))
    return [_outlier(machine, name, sorted(places, key=lambda pair: -pair[1].ratio))
            for (machine, name), places in by.items()]


def _outlier(machine: str, name: str, places: Sequence[tuple[Trend, Outlier]]) -> Finding:
    trend, outlier = places[0]
    newest = outlier.place == len(trend.series.values) + len(trend.outliers) - 1
    more = [lowered(subject(other.series)) for other, _ in places[1:]]
    return Finding(
        "warning", "outlying-recording",
        f"{outlier_text(trend.series, name, outlier)} It is left out of this trend"
        f"{f' and of those of {_listed(more)}' if more else ''}.",
        {"machine": machine, "recording": name, "parameter": trend.series.parameter, "step": trend.series.step,
         "unit": trend.series.unit, "value": outlier.value, "expected": outlier.expected, "std": outlier.std,
         "ratio": outlier.ratio, "chance": outlier.chance, "parameters": len(places)},
        (f"{NEXT} " if newest else "") + LABEL)


def _remarks(rows: Sequence[Row], copies: Mapping[str, str], found: Sequence[Trend]) -> list[Finding]:
    """What the recordings do not allow to say."""
    remarks = []
    if copies:
        remarks.append(Finding(
            "note", "copied-recordings",
            f"{_listed([f'{copy} repeats {first}' for copy, first in copies.items()])}: all values and standard "
            "deviations are equal. The copies are left out.", {"copies": len(copies)},
            "Take the copies out of the site."))
    longest = dict.fromkeys((row.machine for row in rows if row.recording and row.machine), 0)
    for trend in found:
        longest[trend.series.machine] = max(longest[trend.series.machine], trend.units)
    few = {machine: count for machine, count in longest.items() if count < FEWEST}
    if few:
        remarks.append(Finding(
            "note", "few-recordings",
            f"Fewer than {FEWEST} recordings of one kind with a value, or days where one has several, tell no "
            f"trend: {_listed([f'{m} has {n}' for m, n in few.items()])}. Such a machine has means at most.",
            dict(few), "Record it again on further days."))
    remarks += _units(found)
    dateless = list(dict.fromkeys(t.series.machine for t in found if t.series.starts is None))
    if dateless:
        remarks.append(Finding(
            "note", "undated-recordings",
            f"Not all recordings of {_listed(dateless)} say when they were made. They count in their order; days "
            "are not told apart.", {"machines": len(dateless)}, "Log absolute times, or name recordings by date."))
    missing = {subject(t.series): t.series.left_out for t in found if t.series.left_out}
    if missing:
        remarks.append(Finding(
            "note", "values-missing",
            f"Recordings without a fitted value are left out: "
            f"{_listed([f'{n} of {what}' for what, n in missing.items()])}.", {"series": len(missing)},
            "See in the files of these recordings why they have none."))
    return [*remarks, *_correlated(found)]


def _units(found: Sequence[Trend]) -> list[Finding]:
    """Series that would be one, were it not for their units."""
    units: dict[tuple[str, str, str, str], list[Series]] = {}
    for series in (trend.series for trend in found):
        units.setdefault((series.machine, series.parameter, series.step, series.kind), []).append(series)
    several = [f"{subject(each[0])} in {' and '.join(s.unit or 'none' for s in each)}"
               for each in units.values() if len(each) > 1]
    if not several:
        return []
    return [Finding(
        "note", "units-changed",
        f"Recordings state one parameter in several units: {_listed(several)}. Each unit is a series of its own, "
        "and a change from one to the other is not looked for.", {"parameters": len(several)},
        "Give the recordings of a machine one unit of torque, by a channel map or a torque constant.")]


def _correlated(found: Sequence[Trend]) -> list[Finding]:
    """Series whose neighbours are alike."""
    alike = sorted((t for t in found if t.correlation > CORRELATED / t.units ** 0.5),
                   key=lambda t: -t.correlation)
    if not alike:
        return []
    return [Finding(
        "note", "recordings-correlated",
        f"Beside steps and drift, neighbouring recordings are alike: "
        f"{_listed([f'{subject(t.series)} by {t.correlation:.2f}' for t in alike])} (correlation). Intervals and "
        "tests have it in them.", {"series": len(alike), "largest": alike[0].correlation},
        "Look for what varies slowly, such as the temperature. Small steps listed there may be parts of it.")]


def _listed(names: Sequence[str]) -> str:
    more = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f" and {more} more" if more > 0 else "")
