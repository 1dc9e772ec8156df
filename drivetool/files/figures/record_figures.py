"""Records: what was measured, what the model gives, and where the two differ most."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from drivetool.files.figures.panels import Mark, Panel, mark, zero
from drivetool.files.figures.plot_style import BLUE, GRID_COLOUR, INK, MEASURED_COLOUR, ORANGE, RED
from drivetool.identify.estimate import PlotData

Curve = tuple[np.ndarray, np.ndarray]

# S of the close-up, and the least and greatest share of the record. A choice: a second shows the ringing of usual
# drives; of a record of minutes it would be a dot.
CLOSE_UP_TIME, LEAST_SHARE, GREATEST_SHARE = 1.0, 0.02, 0.25
GAP_COLOUR = "#f3d9b8"
# Share of the width below which a stretch is drawn with dots: under three pixels, too short a line to be visible.
MIN_LINE_SHARE = 0.003


def line_style(label: str) -> dict[str, Any]:
    """Measured curves grey and broad, so that they remain visible under the simulated ones in colour."""
    if label.startswith("measured"):
        return {"color": MEASURED_COLOUR, "linewidth": 3.0}
    if not label.startswith(("simulat", "model", "fit", "residual")):
        return {"color": ORANGE, "linewidth": 1.0, "linestyle": "--"}
    return {"color": ORANGE if label.endswith(("before", "alone")) else BLUE,
            "linewidth": 0.7 if label.startswith("residual") else 1.0}


def two_line_label(label: str) -> str:
    """'motor speed' over '[rad/s]'."""
    return label.replace(" [", "\n[", 1)


def unit_of_label(label: str) -> str:
    """'[rad/s]' of 'motor speed [rad/s]'."""
    return label[label.rfind("["):] if "[" in label else ""


def record(plot: PlotData) -> list[Panel]:
    """Each sensor with the error below it, the inputs, and a close-up of each sensor where its error is largest.

    The curves of the first sensor are named measured, simulated ..., those of a further one 'measured load speed
    [rad/s]' and so on; all else with a unit is an input. 'close-up' has the ends of an interval.
    """
    curves = dict(plot.curves)
    given = curves.pop("close-up", None)
    compared = ("measured", "simulated", "residual")
    inputs = {label: curves.pop(label) for label in list(curves)
              if label.endswith("]") and not label.startswith(compared)}
    sensors = [label.removeprefix("measured") for label in curves if label.startswith("measured")] or [""]
    found: list[Panel] = []
    details: list[Panel] = []
    ends = [(x[0], x[-1]) for x, _ in (*curves.values(), *inputs.values()) if len(x) > 1 and x[-1] > x[0]]
    limits = {"xlim": (min(low for low, _ in ends), max(high for _, high in ends))} if ends else {}
    span: list[Mark] = []
    for sensor in sensors:
        own = {label.removesuffix(sensor): curve for label, curve in curves.items() if sensor == max(
            (s for s in sensors if label.endswith(s)), key=len, default=sensors[0])}
        errors = {label: own.pop(label) for label in list(own) if label.startswith("residual")}
        name = sensor.strip() if found else plot.y
        if errors:
            low, high = given[0] if given else worst_interval(*next(iter(errors.values())))
            span = [mark("axvspan", low, high, color=GRID_COLOUR, linewidth=0, zorder=0)]
            details.append(Panel(
                _lines(detail(own, low, high), named=False), {"ylabel": name, "xlim": (low, high)}, 2.0,
                "detail, linear trend removed, at the largest error" + (" of the base model" if given else "")))
        found.append(Panel([*_lines(own, named=not found), *span], {"ylabel": name, **limits},
                           1.8 if found else 2.6, shared=bool(found)))
        if errors:
            found.append(Panel([*_lines(errors, unit_of_label(name)), zero(), *span],
                               {"ylabel": f"error\n{unit_of_label(name)}"}, 1.3, shared=True))
    found += [Panel([mark("line", *curve, color=INK, linewidth=0.8, drawstyle="steps-post"), *span],
                    {"ylabel": two_line_label(label)}, 1.1, shared=True) for label, curve in inputs.items()]
    for last in [found, details]:
        last[-1:] = [replace(panel, settings={**panel.settings, "xlabel": plot.x}) for panel in last[-1:]]
    return found + details


def _lines(curves: Mapping[str, Curve], unit: str | None = None, named: bool = True) -> list[Mark]:
    """A line per curve, named in the legend; with a unit each is an error, whose rms is stated."""
    return [mark("line", *curve, **line_style(label), label=None if not named else label if unit is None
                 else _rms_words(label, curve[1], unit)) for label, curve in curves.items()]


def _rms_words(label: str, error: np.ndarray, unit: str) -> str:
    """'before: rms 0.021 rad/s'."""
    known = error[np.isfinite(error)]
    rms = np.sqrt(np.mean(known**2)) if len(known) else np.nan
    name = label.removeprefix("residual").strip()
    return f"{name}: rms {rms:.3g} {unit.strip('[]')}".removeprefix(": ").strip()


def worst_interval(time: np.ndarray, error: np.ndarray) -> tuple[float, float]:
    """Begin and end of the time with the largest sum of squared errors."""
    length = np.clip(CLOSE_UP_TIME, *(np.array([LEAST_SHARE, GREATEST_SHARE]) * (time[-1] - time[0])))
    sums = np.cumsum(np.concatenate([[0.0], np.nan_to_num(error) ** 2]))
    end = time[np.argmax(sums[1:] - sums[np.searchsorted(time, time - length)])]
    low = max(end - length, time[0])
    return low, low + length


def detail(curves: Mapping[str, Curve], low: float, high: float) -> dict[str, Curve]:
    """The curves between two times, less the line through the measured one: a slope hides detail."""
    inside = {label: np.array([x, y])[:, (x >= low) & (x <= high)] for label, (x, y) in curves.items()}
    time, values = next(iter(inside.values()))
    known = np.isfinite(values)
    line = np.polyfit(time[known] - low, values[known], 1) if known.sum() > 2 else (0.0, 0.0)
    return {label: (x, y - np.polyval(line, x - low)) for label, (x, y) in inside.items()}


def recording(plot: PlotData) -> list[Panel]:
    """One panel per signal."""
    return [Panel([mark("line", *curve, color=INK, linewidth=0.9,
                        drawstyle="steps-post" if "torque" in label else "default")],
                  {"ylabel": two_line_label(label), "xlabel": plot.x, "xmargin": 0.0}, 1.2, shared=k > 0)
            for k, (label, curve) in enumerate(plot.curves.items())]


def channels(plot: PlotData) -> list[Panel]:
    """One low panel per channel; labels that begin with `spikes` or `gaps` belong to the one before."""
    main = [label for label in plot.curves if not label.startswith(("spikes ", "gaps "))]
    return [_channel(plot, label, k > 0) for k, label in enumerate(main)]


def _channel(plot: PlotData, label: str, shared: bool) -> Panel:
    """A channel with gaps shaded and spikes marked."""
    time, values = plot.curves[label]
    base = _display_offset(values)
    gaps = np.array(plot.curves.get(f"gaps {label}", np.zeros((2, 0))))
    marks = []
    # Stretch by stretch, or the thinned line would run across the gaps.
    for stretch in np.split(np.arange(len(time)), np.searchsorted(time, gaps[1])):
        # A line this short would not be visible.
        dot = "." if np.ptp(time[stretch]) < MIN_LINE_SHARE * np.ptp(time) else None
        marks.append(mark("line", time[stretch], values[stretch] - base, color=INK, linewidth=0.8, marker=dot,
                          markersize=2))
    if (spikes := plot.curves.get(f"spikes {label}")) is not None:
        marks.append(mark("plot", spikes[0], spikes[1] - base, "o", color=RED, markersize=3,
                          label=f"{len(spikes[0])} spikes"))
    marks += [mark("axvspan", *ends, color=GAP_COLOUR, linewidth=0, zorder=0, label=None if k else "no samples")
              for k, ends in enumerate(gaps.T)]
    # A name can be long and the panel is low: it stands above its panel.
    name = label.strip() + (f", less {base:.15g}" if base else "")
    return Panel(marks, {"xmargin": 0.01, "xlabel": plot.x}, 0.95, name, shared, _few_ticks)


def _few_ticks(axis: Axes) -> None:
    axis.locator_params(axis="y", nbins=3)
    axis.yaxis.set_major_formatter("{x:.4g}")


def _display_offset(values: np.ndarray) -> float:
    """Offset subtracted from values that hardly differ, so that the axis resolves them; else 0."""
    finite = values[np.isfinite(values)]
    low, span = float(finite.min()), float(np.ptp(finite))
    if not 0 < span < 1e-3 * abs(low):
        return 0.0
    round_to = 10.0 ** np.floor(np.log10(span))
    return float(np.floor(low / round_to) * round_to)
