"""How each kind of plot data is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from drivetool.files.figures import report_figures
from drivetool.files.figures.inspect_picture import panels
from drivetool.files.figures.plot_style import BLUE, CYCLE, GREY, INK, ORANGE, RED
from drivetool.files.figures.thinning import decimated
from drivetool.files.figures.tune_figures import KINDS
from drivetool.identify.estimate import PlotData
from drivetool.identify.several import MIN_SIGNIFICANT_RATIO

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


    Curve = tuple[np.ndarray, np.ndarray]

MAX_TITLE_CHARACTERS = 74  # A choice: what fits into the width of the picture in this font.
# In usual distances of the spectral lines. Between 1, no line left out, and 2, one left out; spacings are uneven.
MIN_GAP_RATIO = 1.6


def figure(plot: PlotData) -> Figure:
    """The picture of plot data; an unknown kind is drawn as lines."""
    if plot.kind.startswith("diagnosis-"):
        return report_figures.figure(plot)
    if hasattr(plot, "figure"):
        return plot.figure()
    if not hasattr(plot, "curves") or plot.kind.endswith(("nichols", "sensitivity")):
        return next(draw for kind, draw in KINDS.items() if plot.kind.endswith(kind))(plot)
    return _DRAWERS.get(plot.kind, _lines)(plot)


def _record(plot: PlotData) -> Figure:
    """Measured over simulated, below it the residual, below that the torque, on one time axis."""
    curves = dict(plot.curves)
    lower = {label: curves.pop(label) for label in list(curves)
             if label.startswith(("residual", "torque", "voltage"))}
    drawn, axes = _stacked_axes(len(lower) + 1, [3.0] + [1.2] * len(lower))
    top = axes[0]
    top.set_title(plot.title)
    top.set_ylabel(plot.y)
    for label, curve in curves.items():
        _draw_line(top, label, curve, **_line_style(label))
    _legend_above(top)
    unit = plot.y[plot.y.rfind("["):] if "[" in plot.y else ""
    for axis, (label, curve) in zip(axes[1:], lower.items(), strict=True):
        residual = label.startswith("residual")
        if residual:
            axis.axhline(0.0, color="#5c6269", linewidth=0.8)
        _draw_line(axis, label, curve, color=RED if residual else INK, linewidth=0.7 if residual else 0.9,
              drawstyle="default" if residual else "steps-post")
        axis.set_ylabel(label if "[" in label or not residual else f"{label}\n{unit}")
    axes[-1].set_xlabel(plot.x)
    _limit_time(axes, plot.curves)
    return drawn


def _recording(plot: PlotData) -> Figure:
    """One panel per signal."""
    n = max(1, len(plot.curves))
    drawn, axes = _stacked_axes(n, [1.0] * n)
    axes[0].set_title(plot.title)
    for axis, (label, curve) in zip(axes, plot.curves.items(), strict=False):
        _draw_line(axis, label, curve, color=INK, linewidth=0.9,
              drawstyle="steps-post" if "torque" in label else "default")
        axis.set_ylabel(label)
    axes[-1].set_xlabel(plot.x)
    _limit_time(axes, plot.curves)
    return drawn


def _steady(plot: PlotData) -> Figure:
    """Plateaus as points with error bars, and the line through them."""
    drawn, axis = _single_axes(plot)
    curves = dict(plot.curves)
    errors = next((curves.pop(label) for label in list(curves) if label.startswith(("error", "std"))), None)
    for label, (x, y) in curves.items():
        if label.startswith(("point", "plateau", "mean", "measured")):
            bars = None if errors is None or len(errors[1]) != len(y) else 2 * np.abs(errors[1])
            name = label if bars is None else f"{label} (bars: 2 std)"
            axis.errorbar(x, y, bars, fmt="o", markersize=4.5, color=INK, ecolor=GREY, capsize=3, label=name,
                          zorder=3)
        else:
            _draw_line(axis, label, (x, y), color=BLUE)
    _legend_above(axis)
    return drawn


def _correlation(plot: PlotData) -> Figure:
    """Stems over the lag inside or outside their band; limits as dashed lines."""
    drawn, axis = _single_axes(plot)
    for label, (x, y) in plot.curves.items():
        x, y = np.asarray(x, float), np.asarray(y, float)
        if label.startswith(("band", "97")):
            axis.fill_between(x, -np.abs(y), np.abs(y), color=BLUE, alpha=0.15, linewidth=0, label=label)
        elif label.startswith(("limit", "bar")):
            for sign in (1, -1):
                axis.plot(x, sign * np.abs(y), color=RED, linestyle="--", linewidth=1.0,
                          label=label if sign > 0 else None)
        elif len(x) > 120:
            _draw_line(axis, label, (x, y), color=INK, linewidth=1.0)
        else:
            axis.vlines(x, 0.0, y, color=INK, linewidth=1.1)
            axis.plot(x, y, "o", color=INK, markersize=2.6, label=label)
    axis.axhline(0.0, color="#5c6269", linewidth=0.8)
    _legend_above(axis)
    return drawn


def _profile(plot: PlotData) -> Figure:
    """Loss over one parameter with the level that bounds the 95 % interval."""
    drawn, axis = _single_axes(plot)
    for label, curve in plot.curves.items():
        if "level" in label or "95" in label:
            _draw_line(axis, label, curve, color=RED, linestyle="--", linewidth=1.0)
        else:
            few = len(curve[0]) <= 60
            _draw_line(axis, label, curve, color=BLUE, marker="o" if few else None, markersize=3)
    _legend_above(axis)
    return drawn


def _starts(plot: PlotData) -> Figure:
    """Where each start ended."""
    drawn, axis = _single_axes(plot)
    for (label, (x, y)), colour in zip(plot.curves.items(), CYCLE, strict=False):
        axis.plot(x, y, "o", color=colour, markersize=5, alpha=0.8, label=label)
    _legend_above(axis)
    return drawn


def _bode(plot: PlotData) -> Figure:
    """Magnitude over frequency, both logarithmic."""
    drawn, axis = _single_axes(plot)
    several = len(plot.curves) > 1 and not any(_line_style(label)["color"] != ORANGE for label in plot.curves)
    for (label, (x, y)), colour in zip(plot.curves.items(), CYCLE * 9, strict=False):
        x, y = np.asarray(x, float), np.asarray(y, float)
        good = (x > 0) & (y > 0)
        look = {"color": colour, "linewidth": 1.1} if several else _line_style(label)
        axis.plot(x[good], y[good], label=label, **look)
    _log_frequency_axis(axis)
    axis.set_yscale("log")
    axis.grid(True, which="minor", linewidth=0.4)
    _legend_above(axis)
    return drawn


def _response(plot: PlotData) -> Figure:
    """Magnitude with its band, phase, and coherence where there is one, over a logarithmic frequency."""
    curves = dict(plot.curves)
    below = [(word, {k: curves.pop(k) for k in list(curves) if k.startswith(word)}) for word in ("phase",
        "coherence")]
    below = [(word, group) for word, group in below if group]
    drawn, axes = _stacked_axes(1 + len(below), [3.0] + [1.3] * len(below))
    top = axes[0]
    top.set_title("\n".join(wrap(plot.title, MAX_TITLE_CHARACTERS)))
    top.set_ylabel(plot.y)
    low, high = curves.pop("band low", None), curves.pop("band high", None)
    if low is not None and high is not None:
        (x, bottom), (_, top_edge) = _with_gaps(*low), _with_gaps(*high)
        top.fill_between(x, bottom, top_edge, color=BLUE, alpha=0.25, linewidth=0, label="95 %")
    for label, (x, y) in curves.items():
        lines = label.startswith("measured")
        x, y = (x, y) if lines else _with_gaps(x, y)
        look = _line_style("model" if label == "magnitude" else label)
        top.plot(x, y, label=label, **(look | {"linestyle": "", "marker": ".", "markersize": 3} if lines else look))
    _log_frequency_axis(top)
    top.set_yscale("log")
    measured = len(below) > 1 or any(label.startswith("measured") for label in curves)
    for axis, (word, group) in zip(axes[1:], below, strict=True):
        for label, (x, y) in group.items():
            look = {"linestyle": "", "marker": ".", "markersize": 2.5} if measured else {"linewidth": 1.1}
            axis.plot(x, y, color=INK if "model" not in label and measured else BLUE, label=label, **look)
        axis.set_ylabel("phase [deg]" if word == "phase" else word)
        if word == "coherence":
            axis.set_ylim(-0.02, 1.02)
    axes[-1].set_xlabel(plot.x)
    _legend_above(top)
    return drawn


def _with_gaps(x: np.ndarray, y: np.ndarray) -> Curve:
    """A curve with a gap wherever spectral lines were left out: nothing is known in between."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    # Lines are evenly spaced, a model's curve evenly on the logarithmic axis: neither has gaps.
    steps = [np.diff(x), np.diff(np.log(np.maximum(x, 1e-300)))]
    if len(x) < 3:
        return x, y
    holes = np.flatnonzero(np.all([s > MIN_GAP_RATIO * np.median(s) for s in steps], axis=0)) + 1
    return np.insert(x, holes, np.nan), np.insert(y, holes, np.nan)


def _log_frequency_axis(axis: Axes) -> None:
    """A logarithmic frequency axis with plain numbers, 2 or 30, instead of powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_xscale("log")
    low, high = axis.get_xlim()
    wide = high > 30.0 * low
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if wide else (1.0, 2.0, 3.0, 4.0, 5.0, 7.0)))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


def _ratios(plot: PlotData) -> Figure:
    """One dot per figure beside its name; beyond the band it stands out."""
    from matplotlib.figure import Figure

    places = [float(y[0]) for _, y in plot.curves.values()]
    drawn = Figure(figsize=(8.0, 1.6 + 0.27 * len(places)), layout="constrained")
    axis = drawn.subplots()
    axis.set_title(plot.title)
    axis.set_xlabel(plot.x)
    axis.axvspan(-MIN_SIGNIFICANT_RATIO, MIN_SIGNIFICANT_RATIO, color=BLUE, alpha=0.12, linewidth=0)
    axis.axvline(0.0, color="#5c6269", linewidth=0.8)
    for x, y in plot.curves.values():
        colour = INK if abs(x[0]) <= MIN_SIGNIFICANT_RATIO else RED
        axis.hlines(y, 0.0, x, color=colour, linewidth=1.1)
        axis.plot(x, y, "o", color=colour, markersize=4.5)
    axis.set_yticks(places, list(plot.curves))
    axis.margins(y=0.5 / max(len(places), 1))
    return drawn


def _lines(plot: PlotData) -> Figure:
    """Every curve as a line."""
    drawn, axis = _single_axes(plot)
    for (label, curve), colour in zip(plot.curves.items(), CYCLE * 9, strict=False):
        _draw_line(axis, label, curve, color=colour)
    _legend_above(axis)
    return drawn


_DRAWERS = {"record": _record, "recording": _recording, "steady": _steady, "correlation": _correlation,
          "profile": _profile, "starts": _starts, "bode": _bode, "channels": panels, "response": _response,
          "ratios": _ratios}


def _stacked_axes(n: int, heights: list[float]) -> tuple[Figure, list[Axes]]:
    """n panels above each other on one x axis."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(8.0, 1.6 + 1.05 * sum(heights)), layout="constrained")
    axes = drawn.subplots(n, 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    drawn.align_ylabels(list(axes))
    return drawn, list(axes)


def _single_axes(plot: PlotData) -> tuple[Figure, Axes]:
    """One panel with title and labels."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(8.0, 4.5), layout="constrained")
    axis = drawn.subplots()
    axis.set_title(plot.title)
    axis.set_xlabel(plot.x)
    axis.set_ylabel(plot.y)
    return drawn, axis


def _draw_line(axis: Axes, label: str, curve: Curve, **look: Any) -> None:
    """A curve, thinned to what the picture can show."""
    axis.plot(*decimated(*curve), label=label, **look)


def _line_style(label: str) -> dict[str, Any]:
    """Measured curves in grey, simulated ones in colour."""
    if label.startswith("measured"):
        return {"color": GREY, "linewidth": 1.8}
    if label.startswith(("simulat", "model", "fit")):
        return {"color": BLUE, "linewidth": 1.1}
    return {"color": ORANGE, "linewidth": 1.0, "linestyle": "--"}


def _legend_above(axis: Axes) -> None:
    """Between title and panel, where it covers nothing; only for two or more curves."""
    if len(axis.get_legend_handles_labels()[0]) > 1:
        axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2)
        axis.set_title(axis.get_title(loc="left"), loc="left", pad=24)


def _limit_time(axes: list[Axes], curves: Mapping[str, Curve]) -> None:
    """The time axis from the first to the last sample."""
    ends = [np.asarray(x, float)[[0, -1]] for x, _ in curves.values() if len(x) > 1]
    if ends:
        low, high = min(e[0] for e in ends), max(e[1] for e in ends)
        if high > low:
            axes[0].set_xlim(low, high)
