"""Which panels each kind of plot data has."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from drivetool.files.figures import record_figures, report_figures, tune_figures
from drivetool.files.figures.panels import Panel, mark, picture, zero
from drivetool.files.figures.plot_style import AXIS_COLOUR, BLUE, CYCLE, GREY, INK, ORANGE, RED
from drivetool.files.figures.record_figures import Curve, line_style
from drivetool.identify.estimate import PlotData
from drivetool.identify.several import MIN_SIGNIFICANT_RATIO

# In usual distances of the spectral lines. Between 1, no line left out, and 2, one left out; spacings are uneven.
MIN_GAP_RATIO = 1.6
MAX_STEMS = 120  # a choice: more stand too close together to be told apart


def figure(plot: PlotData) -> Figure:
    """The picture of plot data; an unknown kind is drawn as lines."""
    if hasattr(plot, "figure"):
        return plot.figure()
    if not hasattr(plot, "curves") or plot.kind.endswith(("nichols", "sensitivity")):
        return tune_figures.figure(plot)
    panels = (_PANELS | report_figures.PANELS).get(plot.kind, _lines)(plot)
    return picture(plot.title, panels or [Panel([])])


def _steady(plot: PlotData) -> list[Panel]:
    """Plateaus as points with error bars, and the line through them."""
    curves = dict(plot.curves)
    errors = next((curves.pop(label) for label in list(curves) if label.startswith(("error", "std"))), None)
    marks = []
    for label, (x, y) in curves.items():
        if label.startswith(("point", "plateau", "mean", "measured")):
            bars = None if errors is None or len(errors[1]) != len(y) else 2 * np.abs(errors[1])
            marks.append(mark("errorbar", x, y, bars, fmt="o", markersize=4.5, color=INK, ecolor=GREY, capsize=3,
                              zorder=3, label=label if bars is None else f"{label} (bars: 2 std)"))
        else:
            marks.append(mark("line", x, y, label=label, color=BLUE))
    return [Panel(marks, {"xlabel": plot.x, "ylabel": plot.y}, 3.4)]


def _correlation(plot: PlotData) -> list[Panel]:
    """Stems over the lag inside or outside their band; limits as dashed lines."""
    marks = [zero()]
    for label, (x, y) in plot.curves.items():
        if label.startswith(("band", "97")):
            marks.append(mark("fill_between", x, -np.abs(y), np.abs(y), color=BLUE, alpha=0.15, linewidth=0,
                              label=label))
        elif label.startswith(("limit", "bar")):
            marks += [mark("plot", x, sign * np.abs(y), color=RED, linestyle="--", linewidth=1.0,
                           label=label if sign > 0 else None) for sign in (1, -1)]
        else:
            marks.append(mark("line" if len(x) > MAX_STEMS else "stems", x, y, color=INK, label=label))
    return [Panel(marks, {"xlabel": plot.x, "ylabel": plot.y}, 3.4)]


def _profile(plot: PlotData) -> list[Panel]:
    """Loss over one parameter with the level that bounds the 95 % interval."""
    return [Panel([mark("line", *curve, label=label, **(
        {"color": RED, "linestyle": "--", "linewidth": 1.0} if "level" in label or "95" in label else
        {"color": BLUE, "marker": "o" if len(curve[0]) <= 60 else None, "markersize": 3}))
        for label, curve in plot.curves.items()], {"xlabel": plot.x, "ylabel": plot.y}, 3.4)]


def _bode(plot: PlotData) -> list[Panel]:
    """Magnitude over frequency, both logarithmic."""
    records = len(plot.curves) > 1 and all(line_style(label)["color"] == ORANGE for label in plot.curves)
    positive = {label: (x > 0) & (y > 0) for label, (x, y) in plot.curves.items()}
    marks = [mark("plot", x[positive[label]], y[positive[label]], label=label, **(
        {"color": colour, "linewidth": 1.1} if records else line_style(label)))
        for (label, (x, y)), colour in zip(plot.curves.items(), CYCLE * 9, strict=False)]
    return [Panel(marks, {"xlabel": plot.x, "ylabel": plot.y, "xscale": "log", "yscale": "log"}, 3.4,
                  adjust=_plain_frequencies)]


def _response(plot: PlotData) -> list[Panel]:
    """Magnitude with its band, phase, and coherence where there is one, over a logarithmic frequency."""
    curves = dict(plot.curves)
    low, high = curves.pop("band low", None), curves.pop("band high", None)
    below = {word: {label: curves.pop(label) for label in list(curves) if label.startswith(word)}
             for word in ("phase", "coherence")}
    below = {word: group for word, group in below.items() if group}
    dots = {"linestyle": "", "marker": ".", "markersize": 3}
    top = [] if low is None or high is None else [mark(
        "fill_between", *_with_gaps(*low), _with_gaps(*high)[1], color=BLUE, alpha=0.25, linewidth=0, label="95 %")]
    top += [mark("plot", x, y, label=label, **dots, color=GREY) if label.startswith("measured") else
            mark("plot", *_with_gaps(x, y), label=label, **line_style("model" if label == "magnitude" else label))
            for label, (x, y) in curves.items()]
    measured = len(below) > 1 or any(label.startswith("measured") for label in curves)
    return [Panel(top, {"ylabel": plot.y, "xlabel": plot.x, "xscale": "log", "yscale": "log"}, 3.0,
                  adjust=_plain_frequencies)] + [
        Panel([mark("plot", x, y, **(dots if measured else {}),
                    color=INK if "model" not in label and measured else BLUE) for label, (x, y) in group.items()],
              {"xlabel": plot.x, **({"ylabel": "phase [deg]"} if word == "phase" else
                                    {"ylabel": word, "ylim": (-0.02, 1.02)})}, 1.4, shared=True)
        for word, group in below.items()]


def _with_gaps(x: np.ndarray, y: np.ndarray) -> Curve:
    """A curve with a gap wherever spectral lines were left out: nothing is known in between."""
    # Lines are evenly spaced, a model's curve evenly on the logarithmic axis: neither has gaps.
    steps = [np.diff(x), np.diff(np.log(np.maximum(x, 1e-300)))]
    if len(x) < 3:
        return x, y
    holes = np.flatnonzero(np.all([s > MIN_GAP_RATIO * np.median(s) for s in steps], axis=0)) + 1
    return np.insert(x, holes, np.nan), np.insert(y, holes, np.nan)


def _plain_frequencies(axis: Axes) -> None:
    """Plain numbers, 2 or 30, instead of powers of ten."""
    low, high = axis.get_xlim()
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high > 30.0 * low else (1, 2, 3, 4, 5, 7)))
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.grid(True, which="minor", linewidth=0.4)


def _ratios(plot: PlotData) -> list[Panel]:
    """One dot per figure beside its name; beyond the band it stands out."""
    places = [float(y[0]) for _, y in plot.curves.values()]
    return [Panel([
        mark("axvspan", -MIN_SIGNIFICANT_RATIO, MIN_SIGNIFICANT_RATIO, color=BLUE, alpha=0.12, linewidth=0),
        mark("axvline", 0.0, color=AXIS_COLOUR, linewidth=0.8),
        *(mark("stems", x, y, size=4.5, sideways=True, color=INK if abs(x[0]) <= MIN_SIGNIFICANT_RATIO else RED)
          for x, y in plot.curves.values())],
        {"xlabel": plot.x, "ymargin": 0.5 / max(len(places), 1)}, 0.6 + 0.27 * len(places),
        adjust=lambda axis: axis.set_yticks(places, list(plot.curves)))]


def _lines(plot: PlotData) -> list[Panel]:
    """Every curve as a line."""
    return [Panel([mark("line", *curve, label=label, color=colour)
                   for (label, curve), colour in zip(plot.curves.items(), CYCLE * 9, strict=False)],
                  {"xlabel": plot.x, "ylabel": plot.y}, 3.4)]


_PANELS = {"record": record_figures.record, "recording": record_figures.recording,
           "channels": record_figures.channels, "steady": _steady, "correlation": _correlation,
           "profile": _profile, "bode": _bode, "response": _response, "ratios": _ratios}
