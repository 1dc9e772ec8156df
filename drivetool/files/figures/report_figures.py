"""How the plot data of a diagnosis are drawn: narrow and in large letters, for a phone and for paper."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from drivetool.files.figures.plot_style import drawing_style, without_math_text
from drivetool.files.figures.thinning import decimated

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from drivetool.identify.estimate import PlotData

INK, GREY, AXIS_COLOUR, GRID_COLOUR = "#2b2f33", "#8d939b", "#5c6269", "#e3e6e9"
BEFORE, AFTER, GREEN = "#d9730d", "#1763a6", "#3a7d44"
WIDTH_INCHES = 6.4  # A choice: about the text width of an A4 page.
MAX_BINS = 500  # least and greatest value each: about 1000 points, more than the 700 pixels of the width
# A colour and a hatch each, so that they remain distinguishable in a grey print.
STATE_FILLS = {"named": (GREEN, ""), "possible": (AFTER, "//"), "worse": (GREY, ".."), "no-gain": (GRID_COLOUR, "")}
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans", "font.size": 10.5, "axes.titlesize": 11.5, "axes.titleweight": "bold",
    "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "axes.edgecolor": AXIS_COLOUR, "axes.labelcolor": INK, "text.color": INK, "grid.color": GRID_COLOUR,
    "grid.linewidth": 0.7, "axes.axisbelow": True, "xtick.color": AXIS_COLOUR, "ytick.color": AXIS_COLOUR,
    "legend.frameon": False, "legend.fontsize": 9.5, "lines.linewidth": 1.3, "figure.dpi": 110,
    "savefig.dpi": 110, "axes.formatter.useoffset": False, "path.simplify": False,
    "svg.fonttype": "path", "svg.hashsalt": "drivetool", "hatch.linewidth": 0.6,
}
_BEFORE_AFTER = {"before": {"color": BEFORE}, "after": {"color": AFTER}}


def figure(plot: PlotData) -> Figure:
    """The picture of one plot of a diagnosis."""
    from matplotlib import rc_context

    with rc_context(STYLE):
        return _DRAWERS[plot.kind](plot)


def svg(plot: PlotData) -> str:
    """The picture as an SVG element without anything that changes from run to run."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    with drawing_style(STYLE):
        drawn = without_math_text(_DRAWERS[plot.kind](plot))
        buffer = BytesIO()
        FigureCanvasSVG(drawn).print_svg(buffer, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue().decode("utf-8")
    return text[text.index("<svg"):].strip()


def _record(plot: PlotData) -> Figure:
    """All of the record, its error, its torque; and close up where the base errs most."""
    curves = dict(plot.curves)
    low, high = curves.pop("close-up")[0]
    drawn = _new_figure(6.9)
    panels = drawn.subplots(4, 1, height_ratios=[2.2, 1.3, 0.9, 2.2])
    whole, error, torque, close = panels
    whole.set_title(plot.title, pad=26)
    for axis in (whole, close):
        axis.set_ylabel(plot.y)
        for label, look in (("measured", {"color": GREY, "linewidth": 2.2}),
                            ("simulated before", {"color": BEFORE, "linewidth": 1.2}),
                            ("simulated after", {"color": AFTER, "linewidth": 1.2})):
            _draw_line(axis, label, _detrended_part(curves, label, low, high) if axis is close else curves[label],
                       **look)
    _legend_above(whole)
    for which in ("before", "after"):
        _draw_line(error, which, curves[f"residual {which}"], linewidth=0.8, **_BEFORE_AFTER[which])
    error.set_ylabel(f"error\n{_unit_of_label(plot.y)}")
    label = next(label for label in curves if label.endswith("]"))
    _draw_line(torque, label, curves[label], color=INK, linewidth=0.8)
    torque.set_ylabel(label.replace(" ", "\n", 1))
    for axis in (whole, error, torque):
        axis.set_xlim(*curves["measured"][0][[0, -1]])
        axis.axvspan(low, high, color=GRID_COLOUR, zorder=0)
    close.set_xlim(low, high)
    close.set_title("close up, less the straight line, where the model before errs most", fontsize=10.5,
                    fontweight="normal")
    close.set_xlabel(plot.x)
    drawn.align_ylabels(list(panels))
    return drawn


def _over_time(plot: PlotData) -> Figure:
    """The error as it is, and its running size on a logarithmic scale."""
    from matplotlib.ticker import LogLocator, NullLocator

    curves = plot.curves
    drawn = _new_figure(4.6)
    error, size = drawn.subplots(2, 1, sharex=True, height_ratios=[1.2, 1.0])
    error.set_title(plot.title, pad=26)
    for which in ("before", "after"):
        _draw_line(error, which, curves[f"error {which}"], linewidth=0.8, **_BEFORE_AFTER[which])
        x, y = decimated(*curves[f"size {which}"], MAX_BINS)
        size.plot(x, np.where(y > 0.0, y, np.nan), linewidth=1.2, **_BEFORE_AFTER[which])
    error.set_ylabel(_two_line_label(plot.y))
    size.set_yscale("log")
    size.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    size.yaxis.set_minor_locator(NullLocator())
    size.set_ylabel(f"rms over 0.1 s\n{_unit_of_label(plot.y)}")
    size.set_xlabel(plot.x)
    size.set_xlim(*curves["error before"][0][[0, -1]])
    if "noise of the sensor" in curves:
        level = float(curves["noise of the sensor"][1][0])
        size.axhline(level, color=GREEN, linestyle="--", linewidth=1.2, label="noise of the sensor")
    marks = curves.get("reversals of the speed", (np.empty(0),))[0]
    if 0 < len(marks) <= 80:
        size.plot(marks, np.zeros(len(marks)), "|", color=INK, markersize=9, markeredgewidth=1.0, clip_on=False,
                  transform=size.get_xaxis_transform(), label="reversal of the speed")
    low, high = size.get_ylim()
    size.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)))
    if size.get_legend_handles_labels()[0]:
        size.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1)
    _legend_above(error)
    drawn.align_ylabels([error, size])
    return drawn


def _binned(plot: PlotData) -> Figure:
    """Mean with two standard errors above, size below."""
    curves = plot.curves
    drawn = _new_figure(4.8)
    mean, size = drawn.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
    mean.set_title(plot.title, pad=26)
    mean.axhline(0.0, color=AXIS_COLOUR, linewidth=0.8)
    for which, marker in (("before", "o"), ("after", "s")):
        x, y = curves[which]
        mean.errorbar(x, y, 2.0 * curves[f"std {which}"][1], fmt=f"{marker}-", markersize=3.5, linewidth=1.1,
                      capsize=2.0, label=f"{which} (bars: 2 std)", **_BEFORE_AFTER[which])
        size.plot(x, curves[f"rms {which}"][1], marker=marker, markersize=3.0, **_BEFORE_AFTER[which])
    mean.set_ylabel(f"mean\n{plot.y}")
    size.set_ylabel(f"rms\n{_unit_of_label(plot.y)}")
    size.set_ylim(bottom=0.0)
    size.set_xlabel(plot.x)
    _legend_above(mean)
    drawn.align_ylabels([mean, size])
    return drawn


def _order(plot: PlotData) -> Figure:
    """Amplitude over order; what stands out is labelled."""
    drawn = _new_figure(3.4)
    axis = drawn.subplots()
    axis.set_title(plot.title, pad=26)
    for which in ("before", "after"):
        x, y = plot.curves[which]
        axis.plot(x, y, linewidth=1.2, label=which, **_BEFORE_AFTER[which])
    x, y = plot.curves["before"]
    around = np.array([np.median(y[max(0, k - 20):k + 21]) for k in range(len(y))])
    peak = int(np.argmax(np.where(np.arange(len(x)) > 5, y / around, 0.0)))
    if y[peak] > 4.0 * around[peak]:
        axis.annotate(f"{x[peak]:.3g}", (x[peak], y[peak]), xytext=(6, -2), textcoords="offset points",
                      fontsize=9.5)
    axis.set_xlim(0.0, x[-1])
    axis.set_ylim(bottom=0.0)
    axis.set_xlabel(plot.x)
    axis.set_ylabel(plot.y)
    _legend_above(axis)
    return drawn


def _order_map(plot: PlotData) -> Figure:
    """Amplitude in colours over order and speed; a line at each order that belongs to a cause."""
    from matplotlib.colors import LogNorm

    drawn = _new_figure(4.2)
    axis = drawn.subplots()
    axis.set_title(plot.title, pad=26)
    axis.grid(False)
    heat = plot.heat
    if heat is not None:
        # At an anti-resonance little noise requires a hundredfold torque: linear colours would show nothing else.
        shown = heat.values[heat.values > 0.0]
        ends = (float(shown.min()), float(shown.max())) if len(shown) else (0.1, 1.0)
        norm = LogNorm(ends[0], max(ends[1], 1.01 * ends[0]))
        mesh = axis.pcolormesh(heat.x, heat.y, heat.values, cmap="viridis_r", norm=norm, rasterized=True)
        drawn.colorbar(mesh, ax=axis, label=heat.label)
        axis.set_xlim(0.0, heat.x[-1])
    for label, (x, y) in plot.curves.items():
        axis.plot(x, y, color=BEFORE, linewidth=1.0, linestyle=(0, (1, 4)))
        axis.annotate(f"cause: {label}", (x[0], 1.0), xycoords=("data", "axes fraction"), xytext=(0, 4),
                      textcoords="offset points", ha="center", color=BEFORE, fontsize=9.5)
    axis.set_xlabel(plot.x)
    axis.set_ylabel(plot.y)
    return drawn


def _reversal(plot: PlotData) -> Figure:
    """Mean error around reversals above, size below."""
    drawn = _new_figure(4.4)
    mean, size = drawn.subplots(2, 1, sharex=True, height_ratios=[1.4, 1.0])
    mean.set_title(plot.title, pad=26)
    for which in ("before", "after"):
        _draw_line(mean, which, plot.curves[f"mean {which}"], **_BEFORE_AFTER[which])
        _draw_line(size, which, plot.curves[f"size {which}"], **_BEFORE_AFTER[which])
    for axis in (mean, size):
        axis.axvline(0.0, color=AXIS_COLOUR, linewidth=0.8)
    mean.axhline(0.0, color=AXIS_COLOUR, linewidth=0.8)
    mean.set_ylabel(f"mean\n{_two_line_label(plot.y)}")
    size.set_ylabel(f"rms\n{_unit_of_label(plot.y)}")
    size.set_ylim(bottom=0.0)
    size.set_xlabel(plot.x)
    size.set_xlim(*plot.curves["mean before"][0][[0, -1]])
    _legend_above(mean)
    drawn.align_ylabels([mean, size])
    return drawn


def _candidates(plot: PlotData) -> Figure:
    """A bar per candidate with two standard errors; a scale that shows both 3 and 3000."""
    from matplotlib.patches import Patch

    rows = list(plot.curves.items())
    drawn = _new_figure(1.5 + 0.29 * len(rows))
    axis = drawn.subplots()
    axis.set_title(plot.title, pad=26)
    used = []
    for place, (label, (gain, std)) in enumerate(rows):
        state = label.rpartition(": ")[2]
        colour, hatch = STATE_FILLS.get(state, (GREY, ""))
        used += [state] if state in STATE_FILLS and state not in used else []
        axis.barh(place, gain, height=0.66, color=colour, hatch=hatch, edgecolor="white", zorder=2)
        if np.isfinite(std[0]):
            axis.errorbar(gain, [place], xerr=2.0 * std, fmt="none", ecolor=INK, capsize=3.0, linewidth=1.1,
                          zorder=3)
    largest = max((abs(float(g[0])) for _, (g, _) in rows), default=1.0)
    if largest > 100.0:
        axis.set_xscale("symlog", linthresh=10.0, linscale=1.0)
        axis.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.axvline(0.0, color=AXIS_COLOUR, linewidth=0.9, zorder=4)
    axis.set_yticks(range(len(rows)), [label.rpartition(": ")[0] for label, _ in rows])
    axis.invert_yaxis()
    axis.grid(False, axis="y")
    axis.set_xlabel(f"{plot.x} (bars: 2 std)")
    handles = [Patch(facecolor=STATE_FILLS[s][0], hatch=STATE_FILLS[s][1], edgecolor="white", label=_STATE_WORDS[s])
               for s in STATE_FILLS if s in used]
    axis.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2)
    return drawn


_STATE_WORDS = {"named": "named", "possible": "as good", "worse": "worse", "no-gain": "no gain"}
_DRAWERS = {"diagnosis-record": _record, "diagnosis-residual-time": _over_time,
          "diagnosis-residual-speed": _binned, "diagnosis-residual-torque": _binned,
          "diagnosis-residual-order": _order, "diagnosis-order-map": _order_map,
          "diagnosis-residual-reversal": _reversal, "diagnosis-candidates": _candidates}


def _new_figure(height: float) -> Figure:
    """An empty picture."""
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH_INCHES, height), layout="constrained")


def _draw_line(axis: Axes, label: str, curve: tuple[np.ndarray, np.ndarray], **look: Any) -> None:
    """A curve, thinned to what the picture can show."""
    axis.plot(*decimated(*curve, MAX_BINS), label=label, **look)


def _detrended_part(curves: Mapping[str, tuple[np.ndarray, np.ndarray]], label: str, low: float,
           high: float) -> tuple[np.ndarray, np.ndarray]:
    """The part of a curve between two times, less the line through the measured one: a slope hides detail."""
    x, y = (np.asarray(each) for each in curves["measured"])
    inside = (x >= low) & (x <= high)
    known = inside & np.isfinite(y)
    line = np.polyfit(x[known] - low, y[known], 1) if known.sum() > 2 else (0.0, 0.0)
    return x[inside], np.asarray(curves[label][1])[inside] - np.polyval(line, x[inside] - low)


def _legend_above(axis: Axes) -> None:
    """Between title and panel, where it covers nothing."""
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2)


def _unit_of_label(label: str) -> str:
    """'[rad/s]' of 'motor speed [rad/s]'."""
    return label[label.rfind("["):] if "[" in label else ""


def _two_line_label(label: str) -> str:
    """A long label on two lines."""
    head, bracket, unit = label.rpartition(" [")
    return f"{head}\n[{unit}" if bracket else label


def kinds() -> Mapping[str, object]:
    """The kinds of plot data that are drawn here."""
    return _DRAWERS
