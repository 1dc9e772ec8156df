"""Which panels the plot data of a diagnosis have: the base model, before, beside the extended one, after."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.ticker import LogLocator, NullLocator

from drivetool.files.figures.panels import Mark, Panel, mark, zero
from drivetool.files.figures.plot_style import BLUE, GREEN, GREY, GRID_COLOUR, INK, ORANGE
from drivetool.files.figures.record_figures import record, two_line_label, unit_of_label
from drivetool.identify.estimate import PlotData

# A colour and a hatch each, so that they remain distinguishable in a grey print.
STATE_FILLS = {"named": ("named", GREEN, ""), "possible": ("as good", BLUE, "//"), "worse": ("worse", GREY, ".."),
               "no-gain": ("no gain", GRID_COLOUR, "")}
MAX_MARKED_REVERSALS = 80  # a choice: more would be a bar


def _both(plot: PlotData, part: str = "", kind: str = "line", label: str | None = "", **look: Any) -> list[Mark]:
    """A curve of either model; label: after its name in the legend, None without one."""
    return [mark(kind, *plot.curves[f"{part} {which}".strip()], color=colour,
                 label=None if label is None else which + label, **look)
            for which, colour in (("before", ORANGE), ("after", BLUE))]


def _over_time(plot: PlotData) -> list[Panel]:
    """The error as it is, and its running size on a logarithmic scale."""
    unit, curves = unit_of_label(plot.y), plot.curves
    size = [mark("line", x, np.where(y > 0.0, y, np.nan), **each.look)
            for each in _both(plot, "size", label=None) for x, y in [each.data]]
    if "noise of the sensor" in curves:
        size.append(mark("axhline", float(curves["noise of the sensor"][1][0]), color=GREEN, linestyle="--",
                         label="noise of the sensor"))
    reversals = curves.get("reversals of the speed", (np.empty(0),))[0]
    if 0 < len(reversals) <= MAX_MARKED_REVERSALS:
        size.append(mark("ticks", reversals, color=INK, label="reversal of the speed"))
    return [Panel(_both(plot, "error", linewidth=0.8), {
        "ylabel": two_line_label(plot.y), "xlim": tuple(curves["error before"][0][[0, -1]])}, 2.0),
        Panel(size, {"ylabel": f"rms over 0.1 s\n{unit}", "xlabel": plot.x, "yscale": "log"}, 1.8, shared=True,
              adjust=_plain_decades)]


def _plain_decades(axis: Axes) -> None:
    low, high = axis.get_ylim()
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)))
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_locator(NullLocator())


def _mean_and_size(plot: PlotData, mean: list[Mark], size: list[Mark], **limits: Any) -> list[Panel]:
    """The mean above, the rms below."""
    return [Panel([zero(), *mean], {"ylabel": f"mean\n{two_line_label(plot.y)}", **limits}, 2.4),
            Panel(size, {"ylabel": f"rms\n{unit_of_label(plot.y)}", "ylim": (0.0, None), "xlabel": plot.x}, 1.5,
                  shared=True)]


def _binned(plot: PlotData) -> list[Panel]:
    """Mean with two standard errors above, size below."""
    bars = [mark("errorbar", *each.data, 2.0 * plot.curves[f"std {which}"][1], **each.look, fmt=f"{sign}-")
            for each, which, sign in zip(_both(plot, label=" (bars: 2 std)", markersize=3.5, linewidth=1.1,
                                               capsize=2.0), ("before", "after"), "os", strict=True)]
    return _mean_and_size(plot, bars, _both(plot, "rms", label=None, marker=".", markersize=6.0))


def _reversal(plot: PlotData) -> list[Panel]:
    """Mean error around reversals above, size below."""
    return _mean_and_size(plot, [*_both(plot, "mean"), zero("v")], [*_both(plot, "size", label=None), zero("v")],
                          xlim=tuple(plot.curves["mean before"][0][[0, -1]]))


def _order(plot: PlotData) -> list[Panel]:
    """Amplitude over order; what stands out is labelled."""
    x, y = plot.curves["before"]
    around = np.array([np.median(y[max(0, k - 20):k + 21]) for k in range(len(y))])
    peak = int(np.argmax(np.where(np.arange(len(x)) > 5, y / around, 0.0)))
    marks = _both(plot, kind="plot")
    if y[peak] > 4.0 * around[peak]:
        marks.append(mark("annotate", f"{x[peak]:.3g}", (x[peak], y[peak]), xytext=(6, -2),
                          textcoords="offset points"))
    return [Panel(marks, {"xlabel": plot.x, "ylabel": plot.y, "xlim": (0.0, x[-1]), "ylim": (0.0, None)}, 2.6)]


def _order_map(plot: PlotData) -> list[Panel]:
    """Amplitude in colours over order and speed; a line at each order that belongs to a cause."""
    marks, limits, heat = [], {}, plot.heat
    if heat is not None:
        # At an anti-resonance little noise requires a hundredfold torque: linear colours would show nothing else.
        shown = heat.values[heat.values > 0.0]
        low, high = (float(shown.min()), float(shown.max())) if len(shown) else (0.1, 1.0)
        marks.append(mark("heat", heat.x, heat.y, heat.values, bar={"label": heat.label}, cmap="viridis_r",
                          rasterized=True, norm=LogNorm(low, max(high, 1.01 * low))))
        limits = {"xlim": (0.0, heat.x[-1])}
    for label, (x, y) in plot.curves.items():
        marks += [mark("plot", x, y, color=ORANGE, linewidth=1.0, linestyle=(0, (1, 4))),
                  mark("annotate", f"cause: {label}", (x[0], 1.0), xycoords=("data", "axes fraction"),
                       xytext=(0, 4), textcoords="offset points", ha="center", color=ORANGE)]
    return [Panel(marks, {"xlabel": plot.x, "ylabel": plot.y, **limits}, 3.4)]


def _candidates(plot: PlotData) -> list[Panel]:
    """A bar per candidate with two standard errors; a scale that shows both 3 and 3000."""
    names, states = zip(*(label.rpartition(": ")[::2] for label in plot.curves), strict=True)
    gains, stds = (np.array([curve[k][0] for curve in plot.curves.values()]) for k in (0, 1))
    marks = [zero("v")]
    for state in dict.fromkeys((*STATE_FILLS, *states)):
        word, colour, hatch = STATE_FILLS.get(state, (None, GREY, ""))
        if (places := np.flatnonzero([each == state for each in states])).size:
            marks.append(mark("barh", places, gains[places], height=0.66, color=colour, hatch=hatch,
                              edgecolor="white", zorder=2, label=word))
    known = np.flatnonzero(np.isfinite(stds))
    marks.append(mark("errorbar", gains[known], known, xerr=2.0 * stds[known], fmt="none", ecolor=INK, capsize=3.0,
                      linewidth=1.1, zorder=3))

    def adjust(axis: Axes) -> None:
        if np.abs(gains).max() > 100.0:
            axis.set_xscale("symlog", linthresh=10.0, linscale=1.0)
            axis.xaxis.set_major_formatter("{x:g}")
        axis.set_yticks(range(len(names)), names)
        axis.invert_yaxis()
        axis.grid(False, axis="y")

    return [Panel(marks, {"xlabel": f"{plot.x} (bars: 2 std)"}, 0.7 + 0.29 * len(names), adjust=adjust)]


PANELS: Mapping[str, Callable[[PlotData], list[Panel]]] = {
    "diagnosis-record": record, "diagnosis-residual-time": _over_time, "diagnosis-residual-speed": _binned,
    "diagnosis-residual-torque": _binned, "diagnosis-residual-order": _order, "diagnosis-order-map": _order_map,
    "diagnosis-residual-reversal": _reversal, "diagnosis-candidates": _candidates}
