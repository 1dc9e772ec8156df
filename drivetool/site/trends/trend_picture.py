"""The picture of a machine's trends: values with intervals, means between the steps, alarms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from drivetool.files.figures import BLUE, GREY, INK, ORANGE, RED, stacked_panels
from drivetool.identify.estimate import Z95
from drivetool.site.trends.outliers import Outlier
from drivetool.site.trends.sentences import time_span
from drivetool.site.trends.trend import Change, Trend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL_HEIGHT, PICTURE_WIDTH = 1.9, 8.0  # inches. A choice: readable panels, as wide as a page.
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
        n = len(self.trends)
        drawn, axes = stacked_panels(n, PICTURE_WIDTH, 1.0 + PANEL_HEIGHT * n)
        for axis, trend in zip(axes, self.trends, strict=True):
            _draw_panel(axis, trend)
        axes[0].set_title(f"Trends of {shorten(self.title, MAX_NAME_LENGTH)}")
        axes[-1].set_xlabel("recording")
        drawn.align_ylabels(axes)
        return drawn


def trend_plots(found: Sequence[Trend]) -> tuple[list[TrendPlotData], list[str]]:
    """(a picture per machine, names of the machines); a series of equal values has no panel."""
    drawn = [each for each in found if not each.series.constant]
    machines = list(dict.fromkeys(each.series.machine for each in drawn))
    return [TrendPlotData(name, tuple(each for each in drawn if each.series.machine == name))
            for name in machines], machines


def _draw_panel(axis: Axes, trend: Trend) -> None:
    """Values with their 95 % intervals, the means, the drift and the steps."""
    series = trend.series
    place = np.arange(1, len(series.values) + 1)
    axis.errorbar(place, series.values, Z95 * np.nan_to_num(series.stds), fmt="o", markersize=3.0, color=INK,
                  ecolor=GREY, elinewidth=0.8, zorder=3)
    drift = trend.drift
    if drift is not None and drift.significant:
        axis.plot(place[[0, -1]], [drift.before, drift.after], color=RED if drift.alarm else ORANGE, zorder=4)
    else:
        _draw_means(axis, trend)
    if trend.changes:
        axis.margins(y=ANNOTATION_HEADROOM)
    for change in trend.changes:
        _draw_step(axis, trend, change)
    for name, outlier in trend.outliers:
        _draw_outlier(axis, trend, name, outlier)
    axis.set_xlim(0.5, len(place) + 0.5)
    unit = f" [{series.unit}]" if series.unit else ""
    axis.set_ylabel(f"{series.parameter}\n{series.step}{unit}", fontsize=8)


def _draw_means(axis: Axes, trend: Trend) -> None:
    """The mean of every part and its 95 % interval."""
    ends = [0, *(change.place for change in trend.changes), len(trend.series.values)]
    for a, b, mean in zip(ends[:-1], ends[1:], trend.parts or (trend.mean,), strict=True):
        across = [a + 0.5, b + 0.5]
        axis.plot(across, [mean.value] * 2, color=BLUE, zorder=4)
        if mean.ci95 is not None:
            axis.fill_between(across, *mean.ci95, color=BLUE, alpha=0.2, linewidth=0)


def _draw_outlier(axis: Axes, trend: Trend, name: str, outlier: Outlier) -> None:
    """A cross at the edge: at its true height it would compress all other values."""
    before = outlier.place - sum(other.place < outlier.place for _, other in trend.outliers)
    up = outlier.value > outlier.expected
    right = before > 0.6 * len(trend.series.values)
    axis.annotate(f"{Path(name).stem}: {outlier.value:.4g}", (before + 0.5, 0.96 if up else 0.04),
                  xycoords=("data", "axes fraction"), xytext=(-6 if right else 6, 0), textcoords="offset points",
                  fontsize=7, color=RED, va="center", ha="right" if right else "left")
    axis.plot(before + 0.5, 0.96 if up else 0.04, "x", color=RED, markersize=5.0, clip_on=False,
              transform=axis.get_xaxis_transform())


def _draw_step(axis: Axes, trend: Trend, change: Change) -> None:
    """A line at the step, red with its figures for an alarm."""
    colour = RED if change.alarm else ORANGE
    axis.axvline(change.place + 0.5, color=colour, linewidth=1.2, linestyle="-" if change.alarm else "--")
    size = "" if np.isinf(change.ratio) else f", {change.ratio:.1f} sd"
    words = time_span(trend.series, change.place - 1, change.place).removeprefix("between ")
    left = change.place < 0.6 * len(trend.series.values)
    axis.annotate(f"{'alarm' if change.alarm else 'small step'}{size}\n{words}", (change.place + 0.5, 1.0),
                  xycoords=("data", "axes fraction"), xytext=(4 if left else -4, -2), textcoords="offset points",
                  fontsize=7, color=colour, va="top", ha="left" if left else "right")
