"""Trends in words: what changed on which machine, from what to what, and between which dates."""

from __future__ import annotations

import math
from datetime import UTC, datetime

from drivetool.site.trends.outliers import Outlier
from drivetool.site.trends.series import Series
from drivetool.site.trends.trend import Change, Drift

# strftime would follow the language of the machine.
MONTHS = ("January", "February", "March", "April", "May", "June", "July", "August", "September", "October",
          "November", "December")
# Last parts of names that are no words by themselves.
WORDS = {"viscous": "viscous friction", "coulomb": "Coulomb friction", "stribeck": "Stribeck friction",
         "sum": "half sum", "difference": "half difference"}
UNSAID = ("derived", "shaft")  # first parts of names that no one says
PREFIXED = ("rad", "m", "s", "A", "V", "N", "Nm", "Hz")  # units that are written with a prefix
PREFIXES = ((1e-4, 1e6, "u"), (0.1, 1e3, "m"))  # below this size, this factor and this prefix


def subject(series: Series, step: bool = False) -> str:
    """'Half gap of press 3'; step: name step and kind too, where the machine has the parameter several times."""
    first, _, last = series.parameter.partition(".")
    if not last:
        first, last = "", first
    words = WORDS.get(last, last.replace("_", " ").replace(".", " "))
    owner = "" if first in ("", *UNSAID) else f"{first} "
    by = f", by {series.step}{f' of {series.kind}' if series.kind else ''}," if step else ""
    text = f"{owner}{words} of {series.machine}{by}"
    return text[:1].upper() + text[1:]


def step_text(series: Series, change: Change, step: bool = False) -> str:
    """What a step did, when, and how large that is beside the runs before."""
    factor, unit = scaled(series.unit, change.before, change.after)
    before, after, std = shown(factor, change.std, change.before, change.after)
    verb = "grew" if change.after > change.before else "fell"
    size = "the runs before are all equal" if math.isinf(change.ratio) else (
        f"that is {change.ratio:.1f} times the standard deviation of the {change.runs} runs before, {std}{unit}")
    return (f"{subject(series, step)} {verb} from {before} to {after}{unit} "
            f"{between(series, change.place - 1, change.place)}; {size}.")


def drift_text(series: Series, drift: Drift, step: bool = False) -> str:
    """What a drift did over all recordings, and how fast."""
    factor, unit = scaled(series.unit, drift.before, drift.after)
    before, after, _ = shown(factor, drift.std, drift.before, drift.after)
    verb = "grew" if drift.after > drift.before else "fell"
    slope, per = (drift.per_recording, "recording") if drift.per_day is None else (drift.per_day, "day")
    low, high = (f"{factor * end:.3g}" for end in slope.ci95)
    size = "nothing scatters about it" if math.isinf(drift.ratio) else (
        f"in all that is {drift.ratio:.1f} times the standard deviation about it")
    return (f"{subject(series, step)} {verb} slowly from {before} to {after}{unit} "
            f"{between(series, 0, len(series.values) - 1)}. The slope is {factor * slope.value:.3g}{unit} "
            f"per {per} (95 % interval {low} to {high}); {size}.")


def outlier_text(series: Series, recording: str, outlier: Outlier) -> str:
    """What a recording says where all others of the machine say something else."""
    factor, unit = scaled(series.unit, outlier.value, outlier.expected)
    value, expected, std = shown(factor, outlier.std, outlier.value, outlier.expected)
    return (f"{recording} lies far from the others: by it {lowered(subject(series))} is {value}{unit}, by them "
            f"{expected}{unit}; that is {outlier.ratio:.1f} times their standard deviation, {std}{unit}.")


def lowered(text: str) -> str:
    """A subject inside a sentence; 'Coulomb' is a name."""
    return text if text.startswith("Coulomb") else text[:1].lower() + text[1:]


def between(series: Series, first: int, second: int) -> str:
    """'between 12 March and 2 April 2026', or between two recordings where no dates are known."""
    if series.starts is None:
        return f"between the recordings {series.recordings[first]} and {series.recordings[second]}"
    a, b = (datetime.fromtimestamp(float(series.starts[i]), UTC) for i in (first, second))
    if a.date() == b.date():
        return f"on {_day(a)} {a.year} between {a:%H:%M} and {b:%H:%M} UTC"
    return f"between {_day(a)}{f' {a.year}' if a.year != b.year else ''} and {_day(b)} {b.year}"


def _day(time: datetime) -> str:
    return f"{time.day} {MONTHS[time.month - 1]}"


def scaled(unit: str, *values: float) -> tuple[float, str]:
    """(factor, unit with a prefix and a blank before it) in which values below 0.1 are read well."""
    size = max(map(abs, values))
    if unit in PREFIXED and size > 0.0:
        for below, factor, prefix in PREFIXES:
            if size < below:
                return factor, f" {prefix}{unit}"
    return 1.0, f" {unit}" if unit else ""


def shown(factor: float, std: float, *values: float) -> tuple[str, ...]:
    """Values times a factor, to the second digit of a standard deviation, and that one last."""
    if not std > 0.0:
        return (*(f"{factor * value:.4g}" for value in values), "0")
    last = math.floor(math.log10(factor * std)) - 1
    if not -6 <= last <= 3:
        return tuple(f"{factor * value:.4g}" for value in (*values, std))
    digits = max(0, -last)
    return tuple(f"{round(factor * value, -last):.{digits}f}" for value in (*values, std))
