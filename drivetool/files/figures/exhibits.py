"""How each kind of exhibit is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from drivetool.files.figures import report_figures
from drivetool.files.figures.inspect_picture import panels
from drivetool.files.figures.look import BLUE, CYCLE, GREY, INK, ORANGE, RED
from drivetool.files.figures.thinning import decimated
from drivetool.files.figures.tune_figures import KINDS
from drivetool.identify.estimate import Exhibit
from drivetool.identify.several import BEYOND

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


    Curve = tuple[np.ndarray, np.ndarray]

WIDEST = 74  # characters of a title in one line
HOLE = 1.6  # usual distances of lines from which on some were left out


def figure(exhibit: Exhibit) -> Figure:
    """The picture of an exhibit; a kind nobody knows is drawn as lines."""
    if exhibit.kind.startswith("diagnosis-"):
        return report_figures.figure(exhibit)
    if hasattr(exhibit, "figure"):  # it knows best
        return exhibit.figure()
    if not hasattr(exhibit, "curves") or exhibit.kind.endswith(("nichols", "sensitivity")):
        return next(draw for kind, draw in KINDS.items() if exhibit.kind.endswith(kind))(exhibit)
    return _KINDS.get(exhibit.kind, _lines)(exhibit)


def _record(exhibit: Exhibit) -> Figure:
    """Measured over simulated, below it the residual, below that the torque, on one time axis."""
    curves = dict(exhibit.curves)
    lower = {label: curves.pop(label) for label in list(curves)
             if label.startswith(("residual", "torque", "voltage"))}
    drawn, axes = _stack(len(lower) + 1, [3.0] + [1.2] * len(lower))
    top = axes[0]
    top.set_title(exhibit.title)
    top.set_ylabel(exhibit.y)
    for label, curve in curves.items():
        _line(top, label, curve, **_look(label))
    _legend(top)
    unit = exhibit.y[exhibit.y.rfind("["):] if "[" in exhibit.y else ""
    for axis, (label, curve) in zip(axes[1:], lower.items(), strict=True):
        residual = label.startswith("residual")
        if residual:
            axis.axhline(0.0, color="#5c6269", linewidth=0.8)
        _line(axis, label, curve, color=RED if residual else INK, linewidth=0.7 if residual else 0.9,
              drawstyle="default" if residual else "steps-post")
        axis.set_ylabel(label if "[" in label or not residual else f"{label}\n{unit}")
    axes[-1].set_xlabel(exhibit.x)
    _tight(axes, exhibit.curves)
    return drawn


def _recording(exhibit: Exhibit) -> Figure:
    """One panel per signal."""
    n = max(1, len(exhibit.curves))
    drawn, axes = _stack(n, [1.0] * n)
    axes[0].set_title(exhibit.title)
    for axis, (label, curve) in zip(axes, exhibit.curves.items(), strict=False):
        _line(axis, label, curve, color=INK, linewidth=0.9,
              drawstyle="steps-post" if "torque" in label else "default")
        axis.set_ylabel(label)
    axes[-1].set_xlabel(exhibit.x)
    _tight(axes, exhibit.curves)
    return drawn


def _steady(exhibit: Exhibit) -> Figure:
    """Plateaus as points with error bars, and the line through them."""
    drawn, axis = _one(exhibit)
    curves = dict(exhibit.curves)
    errors = next((curves.pop(label) for label in list(curves) if label.startswith(("error", "std"))), None)
    for label, (x, y) in curves.items():
        if label.startswith(("point", "plateau", "mean", "measured")):
            bars = None if errors is None or len(errors[1]) != len(y) else 2 * np.abs(errors[1])
            name = label if bars is None else f"{label} (bars: 2 std)"
            axis.errorbar(x, y, bars, fmt="o", markersize=4.5, color=INK, ecolor=GREY, capsize=3, label=name,
                          zorder=3)
        else:
            _line(axis, label, (x, y), color=BLUE)
    _legend(axis)
    return drawn


def _correlation(exhibit: Exhibit) -> Figure:
    """Stems over the lag inside or outside their band; limits as dashed lines."""
    drawn, axis = _one(exhibit)
    for label, (x, y) in exhibit.curves.items():
        x, y = np.asarray(x, float), np.asarray(y, float)
        if label.startswith(("band", "97")):
            axis.fill_between(x, -np.abs(y), np.abs(y), color=BLUE, alpha=0.15, linewidth=0, label=label)
        elif label.startswith(("limit", "bar")):
            for sign in (1, -1):
                axis.plot(x, sign * np.abs(y), color=RED, linestyle="--", linewidth=1.0,
                          label=label if sign > 0 else None)
        elif len(x) > 120:
            _line(axis, label, (x, y), color=INK, linewidth=1.0)
        else:
            axis.vlines(x, 0.0, y, color=INK, linewidth=1.1)
            axis.plot(x, y, "o", color=INK, markersize=2.6, label=label)
    axis.axhline(0.0, color="#5c6269", linewidth=0.8)
    _legend(axis)
    return drawn


def _profile(exhibit: Exhibit) -> Figure:
    """Loss over one parameter with the level that bounds the 95 % interval."""
    drawn, axis = _one(exhibit)
    for label, curve in exhibit.curves.items():
        if "level" in label or "95" in label:
            _line(axis, label, curve, color=RED, linestyle="--", linewidth=1.0)
        else:
            few = len(curve[0]) <= 60
            _line(axis, label, curve, color=BLUE, marker="o" if few else None, markersize=3)
    _legend(axis)
    return drawn


def _starts(exhibit: Exhibit) -> Figure:
    """Where each start ended."""
    drawn, axis = _one(exhibit)
    for (label, (x, y)), colour in zip(exhibit.curves.items(), CYCLE, strict=False):
        axis.plot(x, y, "o", color=colour, markersize=5, alpha=0.8, label=label)
    _legend(axis)
    return drawn


def _bode(exhibit: Exhibit) -> Figure:
    """Magnitude over frequency, both logarithmic."""
    drawn, axis = _one(exhibit)
    several = len(exhibit.curves) > 1 and not any(_look(label)["color"] != ORANGE for label in exhibit.curves)
    for (label, (x, y)), colour in zip(exhibit.curves.items(), CYCLE * 9, strict=False):
        x, y = np.asarray(x, float), np.asarray(y, float)
        good = (x > 0) & (y > 0)
        look = {"color": colour, "linewidth": 1.1} if several else _look(label)
        axis.plot(x[good], y[good], label=label, **look)
    _logarithmic(axis)
    axis.set_yscale("log")
    axis.grid(True, which="minor", linewidth=0.4)
    _legend(axis)
    return drawn


def _response(exhibit: Exhibit) -> Figure:
    """Magnitude with its band, phase, and coherence where there is one, over a logarithmic frequency."""
    curves = dict(exhibit.curves)
    below = [(word, {k: curves.pop(k) for k in list(curves) if k.startswith(word)}) for word in ("phase",
        "coherence")]
    below = [(word, group) for word, group in below if group]
    drawn, axes = _stack(1 + len(below), [3.0] + [1.3] * len(below))
    top = axes[0]
    top.set_title("\n".join(wrap(exhibit.title, WIDEST)))
    top.set_ylabel(exhibit.y)
    low, high = curves.pop("band low", None), curves.pop("band high", None)
    if low is not None and high is not None:
        (x, bottom), (_, ceiling) = _parted(*low), _parted(*high)
        top.fill_between(x, bottom, ceiling, color=BLUE, alpha=0.25, linewidth=0, label="95 %")
    for label, (x, y) in curves.items():
        lines = label.startswith("measured")
        x, y = (x, y) if lines else _parted(x, y)
        look = _look("model" if label == "magnitude" else label)
        top.plot(x, y, label=label, **(look | {"linestyle": "", "marker": ".", "markersize": 3} if lines else look))
    _logarithmic(top)
    top.set_yscale("log")
    measured = len(below) > 1 or any(label.startswith("measured") for label in curves)
    for axis, (word, group) in zip(axes[1:], below, strict=True):
        for label, (x, y) in group.items():
            look = {"linestyle": "", "marker": ".", "markersize": 2.5} if measured else {"linewidth": 1.1}
            axis.plot(x, y, color=INK if "model" not in label and measured else BLUE, label=label, **look)
        axis.set_ylabel("phase [deg]" if word == "phase" else word)
        if word == "coherence":
            axis.set_ylim(-0.02, 1.02)
    axes[-1].set_xlabel(exhibit.x)
    _legend(top)
    return drawn


def _parted(x: np.ndarray, y: np.ndarray) -> Curve:
    """A curve with a hole wherever lines were left out: nothing is known in between."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    # Lines are evenly spaced, a model's curve evenly on the logarithmic axis: either is no hole.
    steps = [np.diff(x), np.diff(np.log(np.maximum(x, 1e-300)))]
    if len(x) < 3:
        return x, y
    holes = np.flatnonzero(np.all([s > HOLE * np.median(s) for s in steps], axis=0)) + 1
    return np.insert(x, holes, np.nan), np.insert(y, holes, np.nan)


def _logarithmic(axis: Axes) -> None:
    """A logarithmic frequency axis with numbers that people read: 2, 30, not powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_xscale("log")
    low, high = axis.get_xlim()
    wide = high > 30.0 * low
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if wide else (1.0, 2.0, 3.0, 4.0, 5.0, 7.0)))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


def _ratios(exhibit: Exhibit) -> Figure:
    """One dot per figure beside its name; beyond the band it stands out."""
    from matplotlib.figure import Figure

    places = [float(y[0]) for _, y in exhibit.curves.values()]
    drawn = Figure(figsize=(8.0, 1.6 + 0.27 * len(places)), layout="constrained")
    axis = drawn.subplots()
    axis.set_title(exhibit.title)
    axis.set_xlabel(exhibit.x)
    axis.axvspan(-BEYOND, BEYOND, color=BLUE, alpha=0.12, linewidth=0)
    axis.axvline(0.0, color="#5c6269", linewidth=0.8)
    for x, y in exhibit.curves.values():
        colour = INK if abs(x[0]) <= BEYOND else RED
        axis.hlines(y, 0.0, x, color=colour, linewidth=1.1)
        axis.plot(x, y, "o", color=colour, markersize=4.5)
    axis.set_yticks(places, list(exhibit.curves))
    axis.margins(y=0.5 / max(len(places), 1))
    return drawn


def _lines(exhibit: Exhibit) -> Figure:
    """Every curve as a line."""
    drawn, axis = _one(exhibit)
    for (label, curve), colour in zip(exhibit.curves.items(), CYCLE * 9, strict=False):
        _line(axis, label, curve, color=colour)
    _legend(axis)
    return drawn


_KINDS = {"record": _record, "recording": _recording, "steady": _steady, "correlation": _correlation,
          "profile": _profile, "starts": _starts, "bode": _bode, "channels": panels, "response": _response,
          "ratios": _ratios}


def _stack(n: int, heights: list[float]) -> tuple[Figure, list[Axes]]:
    """n panels above each other on one x axis."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(8.0, 1.6 + 1.05 * sum(heights)), layout="constrained")
    axes = drawn.subplots(n, 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    drawn.align_ylabels(list(axes))
    return drawn, list(axes)


def _one(exhibit: Exhibit) -> tuple[Figure, Axes]:
    """One panel with title and labels."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(8.0, 4.5), layout="constrained")
    axis = drawn.subplots()
    axis.set_title(exhibit.title)
    axis.set_xlabel(exhibit.x)
    axis.set_ylabel(exhibit.y)
    return drawn, axis


def _line(axis: Axes, label: str, curve: Curve, **look: Any) -> None:
    """A curve, thinned to what the picture can show."""
    axis.plot(*decimated(*curve), label=label, **look)


def _look(label: str) -> dict[str, Any]:
    """Measured steps back in grey, what is simulated stands out."""
    if label.startswith("measured"):
        return {"color": GREY, "linewidth": 1.8}
    if label.startswith(("simulat", "model", "fit")):
        return {"color": BLUE, "linewidth": 1.1}
    return {"color": ORANGE, "linewidth": 1.0, "linestyle": "--"}


def _legend(axis: Axes) -> None:
    """Between title and panel, where it covers nothing; only if there is something to tell apart."""
    if len(axis.get_legend_handles_labels()[0]) > 1:
        axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2)
        axis.set_title(axis.get_title(loc="left"), loc="left", pad=24)


def _tight(axes: list[Axes], curves: Mapping[str, Curve]) -> None:
    """The time axis from the first to the last sample."""
    ends = [np.asarray(x, float)[[0, -1]] for x, _ in curves.values() if len(x) > 1]
    if ends:
        low, high = min(e[0] for e in ends), max(e[1] for e in ends)
        if high > low:
            axes[0].set_xlim(low, high)
