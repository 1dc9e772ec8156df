"""The picture of a machine's trends: values with intervals, means between the steps, alarms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from drivetool.files.figures import BLUE, GREY, INK, ORANGE, RED, Mark, Panel, mark, picture
from drivetool.identify.estimate import Z95
from drivetool.site.trends.outliers import Outlier
from drivetool.site.trends.sentences import time_span
from drivetool.site.trends.trend import Change, Trend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANEL_HEIGHT = 1.9  # inches. A choice: readable panels
ANNOTATION_HEADROOM = 0.3  # of the range of the values: room for two lines of text
MAX_NAME_LENGTH = 60  # characters of a machine's name that fit the width of the picture


@dataclass(frozen=True)
class TrendPlotData:
    """The data of the picture of one machine: a panel per series."""

    title: str
    trends: tuple[Trend, ...]
    kind: str = "trend"

    def figure(self) -> Figure:
        """The picture: a panel per series over the number of the recording."""
        return picture(f"Trends of {shorten(self.title, MAX_NAME_LENGTH)}",
                       [_panel(trend, trend is self.trends[-1]) for trend in self.trends])


def trend_plots(found: Sequence[Trend]) -> tuple[list[TrendPlotData], list[str]]:
    """(a picture per machine, names of the machines); a series of equal values has no panel."""
    drawn = [each for each in found if not each.series.constant]
    machines = list(dict.fromkeys(each.series.machine for each in drawn))
    return [TrendPlotData(name, tuple(each for each in drawn if each.series.machine == name))
            for name in machines], machines


def _panel(trend: Trend, last: bool) -> Panel:
    """Values with their 95 % intervals, the means or the drift, and the steps; the last has the axis label."""
    series, drift = trend.series, trend.drift
    place = np.arange(1, len(series.values) + 1)
    marks = [mark("errorbar", place, series.values, Z95 * np.nan_to_num(series.stds), fmt="o", markersize=3.0,
                  color=INK, ecolor=GREY, elinewidth=0.8, zorder=3)]
    if drift is not None and drift.significant:
        marks.append(mark("plot", place[[0, -1]], [drift.before, drift.after], color=RED if drift.alarm else ORANGE,
                          zorder=4))
    else:
        marks += _means(trend)
    marks += [part for change in trend.changes for part in _step(trend, change)]
    marks += [part for outlier in trend.outliers for part in _outlier(trend, outlier)]
    unit = f" [{series.unit}]" if series.unit else ""
    return Panel(marks, {"ylabel": f"{series.parameter}\n{series.step}{unit}", "xlim": (0.5, len(place) + 0.5),
                         **({"ymargin": ANNOTATION_HEADROOM} if trend.changes else {}),
                         **({"xlabel": "recording"} if last else {})}, PANEL_HEIGHT)


def _means(trend: Trend) -> list[Mark]:
    """The mean of every part and its 95 % interval."""
    ends = [0, *(change.place for change in trend.changes), len(trend.series.values)]
    parts = list(zip(ends[:-1], ends[1:], trend.parts or (trend.mean,), strict=True))
    return [mark("plot", [a + 0.5, b + 0.5], [mean.value] * 2, color=BLUE, zorder=4) for a, b, mean in parts] + [
        mark("fill_between", [a + 0.5, b + 0.5], *mean.ci95, color=BLUE, alpha=0.2, linewidth=0)
        for a, b, mean in parts if mean.ci95 is not None]


def _outlier(trend: Trend, outlier: Outlier) -> list[Mark]:
    """A cross at the edge: at its true height it would compress all other values."""
    before = outlier.place - sum(other.place < outlier.place for other in trend.outliers)
    at = before + 0.5, 0.96 if outlier.value > outlier.expected else 0.04
    right = before > 0.6 * len(trend.series.values)
    look = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "color": RED, "va": "center"}
    return [mark("annotate", f"{Path(outlier.recording).stem}: {outlier.value:.4g}", at,
                 xytext=(-6 if right else 6, 0), fontsize=7, ha="right" if right else "left", **look),
            mark("annotate", "\u00d7", at, xytext=(0, 0), ha="center", **look)]


def _step(trend: Trend, change: Change) -> list[Mark]:
    """A line at the step, red with its figures for an alarm."""
    colour = RED if change.alarm else ORANGE
    size = "" if np.isinf(change.ratio) else f", {change.ratio:.1f} sd"
    words = time_span(trend.series, change.place - 1, change.place).removeprefix("between ")
    left = change.place < 0.6 * len(trend.series.values)
    at = change.place + 0.5
    return [mark("axvline", at, color=colour, linewidth=1.2, linestyle="-" if change.alarm else "--"),
            mark("annotate", f"{'alarm' if change.alarm else 'small step'}{size}\n{words}", (at, 1.0),
                 xycoords=("data", "axes fraction"), xytext=(4 if left else -4, -2), textcoords="offset points",
                 fontsize=7, color=colour, va="top", ha="left" if left else "right")]
