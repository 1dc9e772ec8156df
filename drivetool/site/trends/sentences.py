"""Trends in words: the change, its machine, the values before and after, and the dates."""

from __future__ import annotations

import math
from datetime import UTC, datetime

from drivetool.files.shapes import trend_shapes as shapes
from drivetool.site.trends.outliers import Outlier
from drivetool.site.trends.series import Series
from drivetool.site.trends.trend import Change

# strftime depends on the locale.
MONTHS = ("January", "February", "March", "April", "May", "June", "July", "August", "September", "October",
          "November", "December")
# Last parts of names that need a second word.
PARAMETER_WORDS = {"viscous": "viscous friction", "coulomb": "Coulomb friction", "stribeck": "Stribeck friction",
                   "sum": "half sum", "difference": "half difference"}
OMITTED_PREFIXES = ("derived", "shaft")  # first parts of names that are left out
UNITS_WITH_PREFIX = ("rad", "m", "s", "A", "V", "N", "Nm", "Hz")  # units that are written with a prefix
UNIT_PREFIXES = ((1e-4, 1e6, "u"), (0.1, 1e3, "m"))  # below this size, this factor and this prefix


def series_subject(series: Series, step: bool = False) -> str:
    """'Half gap of press 3'; step: name step and kind too, where the machine has the parameter several times."""
    first, _, last = series.parameter.partition(".")
    if not last:
        first, last = "", first
    words = PARAMETER_WORDS.get(last, last.replace("_", " ").replace(".", " "))
    owner = "" if first in ("", *OMITTED_PREFIXES) else f"{first} "
    by = f", by {series.step}{f' of {series.kind}' if series.kind else ''}," if step else ""
    text = f"{owner}{words} of {series.machine}{by}"
    return text[:1].upper() + text[1:]


def step_text(series: Series, change: Change, step: bool = False) -> str:
    """The change at a step, its time, and its size in standard deviations of the runs before."""
    factor, unit = display_scale(series.unit, change.before, change.after)
    before, after, std = rounded_to_std(factor, change.std, change.before, change.after)
    verb = "grew" if change.after > change.before else "fell"
    size = "the recordings before have equal values" if math.isinf(change.ratio) else (
        f"that is {change.ratio:.1f} times the standard deviation of the {change.runs} recordings before, "
        f"{std}{unit}")
    return (f"{series_subject(series, step)} {verb} from {before} to {after}{unit} "
            f"{time_span(series, change.place - 1, change.place)}; {size}.")


def drift_text(series: Series, drift: shapes.DriftSection, step: bool = False) -> str:
    """The change by a drift over all recordings, and its slope."""
    factor, unit = display_scale(series.unit, drift.before, drift.after)
    before, after, _ = rounded_to_std(factor, drift.std, drift.before, drift.after)
    verb = "grew" if drift.after > drift.before else "fell"
    slope, per = (drift.per_recording, "recording") if drift.per_day is None else (drift.per_day, "day")
    low, high = (f"{factor * end:.3g}" for end in slope.ci95)
    size = "no value deviates from the line" if math.isinf(drift.ratio) else (
        f"the total drift is {drift.ratio:.1f} times the standard deviation about the line")
    return (f"{series_subject(series, step)} {verb} slowly from {before} to {after}{unit} "
            f"{time_span(series, 0, len(series.values) - 1)}. The slope is {factor * slope.value:.3g}{unit} "
            f"per {per} (95 % interval {low} to {high}); {size}.")


def outlier_text(series: Series, outlier: Outlier) -> str:
    """The value of an outlying recording and that of the others."""
    factor, unit = display_scale(series.unit, outlier.value, outlier.expected)
    value, expected, std = rounded_to_std(factor, outlier.std, outlier.value, outlier.expected)
    return (
        f"{outlier.recording} is an outlier: {lower_first_letter(series_subject(series))} is {value}{unit}, in the "
            f"others {expected}{unit}; that is {outlier.ratio:.1f} times their standard deviation, {std}{unit}.")


def lower_first_letter(text: str) -> str:
    """A subject inside a sentence; 'Coulomb' keeps its capital."""
    return text if text.startswith("Coulomb") else text[:1].lower() + text[1:]


def time_span(series: Series, first: int, second: int) -> str:
    """'between 12 March and 2 April 2026', or between two recordings where no dates are known."""
    if series.starts is None:
        return f"between the recordings {series.recordings[first]} and {series.recordings[second]}"
    a, b = (datetime.fromtimestamp(float(series.starts[i]), UTC) for i in (first, second))
    if a.date() == b.date():
        return f"on {_day(a)} {a.year} between {a:%H:%M} and {b:%H:%M} UTC"
    return f"between {_day(a)}{f' {a.year}' if a.year != b.year else ''} and {_day(b)} {b.year}"


def _day(time: datetime) -> str:
    return f"{time.day} {MONTHS[time.month - 1]}"


def display_scale(unit: str, *values: float) -> tuple[float, str]:
    """(factor, unit with a prefix and a blank before it) that make small values readable."""
    size = max(map(abs, values))
    if unit in UNITS_WITH_PREFIX and size > 0.0:
        for below, factor, prefix in UNIT_PREFIXES:
            if size < below:
                return factor, f" {prefix}{unit}"
    return 1.0, f" {unit}" if unit else ""


def rounded_to_std(factor: float, std: float, *values: float) -> tuple[str, ...]:
    """Scaled values, and last the standard deviation, rounded to its second significant digit."""
    if not std > 0.0:
        return (*(f"{factor * value:.4g}" for value in values), "0")
    last = math.floor(math.log10(factor * std)) - 1
    if not -6 <= last <= 3:
        return tuple(f"{factor * value:.4g}" for value in (*values, std))
    digits = max(0, -last)
    return tuple(f"{round(factor * value, -last):.{digits}f}" for value in (*values, std))
