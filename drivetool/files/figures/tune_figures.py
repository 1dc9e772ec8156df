"""Which panels the pictures of a tuned loop have."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drivetool.files.figures.panels import WIDTH, Mark, Panel, mark, picture, zero
from drivetool.files.figures.plot_style import (
    AXIS_COLOUR,
    BLUE,
    CYCLE,
    GREEN,
    GREY,
    INK,
    MEASURED_COLOUR,
    ORANGE,
    RED,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from drivetool.tune import Frequencies, GainTimeMap, LimitCyclePlotData, LoadStep, SpreadPicture

# dB of |S| in a Nichols chart. A choice: 3 and 6 dB are the usual limits of Ms, the others show the margin to them.
SENSITIVITY_LEVELS = (-6.0, -3.0, 0.0, 1.0, 3.0, 6.0, 12.0, 20.0)
NICHOLS_GAINS = (-32.0, 32.0)  # dB
UNSTABLE_COLOUR = "#d4d7da"


def figure(plot: GainTimeMap | LoadStep | Frequencies | SpreadPicture | LimitCyclePlotData) -> Figure:
    """The picture of a loop; beside each other stand the panels of one figure for several signals or situations."""
    panels = next(panels for kind, panels in _PANELS.items() if plot.kind.endswith(kind))(plot)
    columns = len(panels) if plot.kind.endswith(("plane", "spread")) else (
        len(plot.watches) if plot.kind.endswith("hunting") else 1)
    return picture(plot.title, panels, columns, WIDTH if columns == 1 else 3.0 * columns + 1.5)


def plane(plot: GainTimeMap) -> list[Panel]:
    """Iso-lines of a figure and of Ms; where the loop is unstable, grey."""
    from matplotlib.colors import LogNorm

    every = np.concatenate([v[np.isfinite(v)] for v in plot.panels.values()])
    least, most = every.min(), min(every.max(), every.min() * 64.0)
    levels = np.geomspace(least * 1.02, most, 16)
    bar = {"format": lambda v, _: f"{v:.2g}", "ticks": levels[::3]}
    settings = {"xscale": "log", "yscale": "log", "xlim": tuple(plot.times[[0, -1]]),
                "ylim": tuple(plot.gains[[0, -1]]), "facecolor": UNSTABLE_COLOUR, "xlabel": "integral time Ti [s]"}
    found = []
    for k, (name, values) in enumerate(plot.panels.items(), 1):
        data = plot.times, plot.gains, np.ma.masked_invalid(values)
        marks = [
            mark("heat", *data, filled=True, levels=np.geomspace(least * 0.999, most, 40), cmap="YlGnBu",
                 norm=LogNorm(least, most), extend="max", bar=bar if k == len(plot.panels) else None),
            mark("contours", *data, levels=levels, colors=INK, linewidths=0.5, text=lambda v: f"{v:.2g}", every=2),
            *_sensitivity_lines(plot),
            mark("plot", *plot.optimum, "o", color=INK, markeredgecolor="white", markersize=8, zorder=5),
            mark("annotate", f"  Ti {1e3 * plot.optimum[0]:.3g} ms\n  Kp {plot.optimum[1]:.4g}", plot.optimum,
                 fontsize=8, fontweight="bold", zorder=6, xytext=(6, -26), textcoords="offset points",
                 bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.75, "linewidth": 0})]
        found.append(Panel(marks, settings | ({"ylabel": f"gain Kp [{plot.gain_unit}]"} if k == 1 else {}), 3.6,
                           name if len(plot.panels) > 1 else "", adjust=_plain_ticks))
    return found


def _plain_ticks(axis: Axes) -> None:
    """Ticks at 1, 2 and 5."""
    from matplotlib.ticker import LogLocator, NullLocator

    for one in (axis.xaxis, axis.yaxis):
        one.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        one.set_major_formatter("{x:g}")
        one.set_minor_locator(NullLocator())


def _sensitivity_lines(plot: GainTimeMap) -> list[Mark]:
    """The limit, 6 and 12 dB; unstable loops have none."""
    wanted = sorted({plot.limit, 10 ** (6.0 / 20.0), 10 ** (12.0 / 20.0)})
    wanted = [w for k, w in enumerate(wanted) if k == 0 or w > wanted[k - 1] * 1.01]
    unstable = ~np.isfinite(plot.ms)
    marks = [mark("contours", plot.times, plot.gains, np.where(unstable, 1e6, plot.ms), levels=wanted, colors=RED,
                  linewidths=[2.0 if abs(w / plot.limit - 1.0) < 0.01 else 1.2 for w in wanted], linestyles="--",
                  text=lambda v: f"Ms {20 * np.log10(v):.3g} dB")]
    if unstable.any():
        rows = np.flatnonzero(unstable[:, len(plot.times) // 2])
        where = np.argwhere(unstable)
        row, column = (rows[len(rows) // 2], len(plot.times) // 2) if len(rows) else where[len(where) // 2]
        marks.append(mark("text", plot.times[column], plot.gains[row], "unstable", color=AXIS_COLOUR, ha="center"))
    return marks


def load_step(plot: LoadStep) -> list[Panel]:
    """Speeds above, torques below."""
    bands = [mark("fill_between", 1e3 * time, low, high, color=BLUE, alpha=0.22, linewidth=0, zorder=1,
                  label=f"{label}, 90 % of the drives that the uncertainty allows")
             for label, (time, low, high) in plot.bands.items()]
    speeds, torques = ([mark("plot", 1e3 * time, y, label=label, color=colour, zorder=2 + (label == "load speed"))
                        for (label, (time, y)), colour in zip(curves.items(), colours, strict=False)]
                       for curves in (plot.speeds, plot.torques)
                       for colours in [(GREY, BLUE) if list(curves) == ["motor speed", "load speed"] else CYCLE])
    end = 1e3 * next(iter(plot.speeds.values()))[0][-1]
    return [Panel([*speeds, *bands, zero()], {"ylabel": plot.speed_label, "xlim": (0.0, end)}, 2.8),
            Panel(torques, {"ylabel": plot.torque_label, "xlabel": "time after the step [ms]"}, 1.9, shared=True)]


def nichols(plot: Frequencies) -> list[Panel]:
    """Loop gain over phase with lines of equal |S|."""
    loops = {label: loop for label, (_, loop) in plot.curves.items()}
    seen = {label: _phase_degrees(loop)[np.abs(_decibels(loop)) < 30.0] for label, loop in loops.items()}
    left = 90.0 * np.floor(max(-720.0, min(phase.min() for phase in seen.values())) / 90.0)
    right = max(-60.0, float(np.ceil(next(iter(seen.values())).max() / 30.0)) * 30.0)
    curves = [mark("plot", _phase_degrees(loop), _decibels(loop), label=label, zorder=3 + (k == 0),
                   **_variation_style(k, label)) for k, (label, loop) in enumerate(loops.items())]
    critical = mark("plot", -180.0 + 360.0 * np.arange(-3, 1), np.zeros(4), "+", color=RED, markersize=11,
                    markeredgewidth=2, zorder=5)
    return [Panel([*_equal_sensitivity(left, plot.limit), *curves, critical], {
        "xlim": (left, right), "ylim": NICHOLS_GAINS, "xlabel": "phase of the loop [deg]",
        "ylabel": "gain of the loop [dB]"}, 4.6)]


def _decibels(values: np.ndarray) -> np.ndarray:
    return 20.0 * np.log10(np.abs(values))


def _phase_degrees(loop: np.ndarray) -> np.ndarray:
    """Unwrapped, beginning between -360 and 0 degrees."""
    phase = np.rad2deg(np.unwrap(np.angle(loop)))
    return phase - 360.0 * np.ceil(phase[0] / 360.0)


def _equal_sensitivity(left: float, limit: float) -> list[Mark]:
    """Lines |1/(1 + L)| = const; inside the limit's line, shaded."""
    phase, gain = np.meshgrid(np.linspace(left, 0.0, 721), np.linspace(*NICHOLS_GAINS, 401))
    loop = 10.0 ** (gain / 20.0) * np.exp(1j * np.deg2rad(phase))
    grid = phase, gain, -_decibels(np.maximum(np.abs(1.0 + loop), 1e-6))
    bound = _decibels(limit)
    return [mark("contours", *grid, levels=SENSITIVITY_LEVELS, colors=MEASURED_COLOUR, linewidths=0.8,
                 text=lambda v: f"{v:g} dB"),
            mark("contourf", *grid, levels=[bound, 200.0], colors=[RED], alpha=0.13),
            mark("contours", *grid, levels=[bound], colors=RED, linewidths=1.2)]


def sensitivity(plot: Frequencies) -> list[Panel]:
    """|S| over frequency with the limit."""
    sizes = {label: (frequency, 1.0 / np.abs(1.0 + loop)) for label, (frequency, loop) in plot.curves.items()}
    marks = [mark("plot", frequency, _decibels(size), label=f"{label}: Ms {size.max():.3g}", zorder=3 + (k == 0),
                  **_variation_style(k, label)) for k, (label, (frequency, size)) in enumerate(sizes.items())]
    edge = min(frequency[np.argmax(size > 0.03)] for frequency, size in sizes.values())
    first, size = next(iter(sizes.values()))
    bound = _decibels(plot.limit)
    return [Panel([
        *marks, mark("axhline", bound, color=RED, linestyle="--", linewidth=1.1),
        mark("annotate", f"limit {plot.limit:g}", (0.005, bound), xycoords=("axes fraction", "data"),
             xytext=(0, 3), textcoords="offset points", color=RED)], {
        "xscale": "log", "xlim": (edge, max(15.0 * first[np.argmax(size)], 20.0 * edge)), "ylim": (-30.0, None),
        "xlabel": "frequency [Hz]", "ylabel": "|S| [dB]"}, 3.4,
        adjust=lambda axis: axis.grid(True, which="minor", linewidth=0.4))]


def _variation_style(k: int, label: str) -> dict[str, object]:
    """The nominal loop stands out; loops with a lowered parameter are dashed."""
    if k == 0:
        return {"color": INK, "linewidth": 2.0}
    colours = {"to 80 %": RED, "stiffness": BLUE, "inertia": GREEN, "dead_time": ORANGE}
    return {"color": next((c for word, c in colours.items() if word in label), GREY), "linewidth": 1.0,
            "linestyle": "--" if " -" in label else "-"}


def spread(plot: SpreadPicture) -> list[Panel]:
    """Histograms of sensitivity, impact drop and overshoot over the draws."""
    found = []
    for name, draws in plot.spread.samples.items():
        power = int(np.floor(np.log10(abs(plot.nominal[name])))) if plot.nominal[name] else 0
        scale = 1.0 if -2 <= power <= 3 else 10.0 ** -power  # in the label, where an offset would be overlooked
        values = draws[np.isfinite(draws)] * scale
        marks = [mark("hist", values, bins=min(30, max(8, len(values) // 8)), color=BLUE, alpha=0.55)] * bool(
            np.ptp(values) > 0.0)
        lines = {"nominal": (plot.nominal[name] * scale, INK, "-"),
                 "95 % quantile": (plot.spread.quantiles[name]["0.95"] * scale, ORANGE, "--"),
                 **({"limit": (plot.limit, RED, ":")} if name == "max_sensitivity" else {})}
        marks += [mark("axvline", x, color=colour, linewidth=1.5, linestyle=style, label=None if found else label)
                  for label, (x, colour, style) in lines.items()]
        unit = plot.units[name] if scale == 1.0 else plot.units[name].replace("[", f"[1e{power} ")
        found.append(Panel(marks, {"xlabel": unit.replace(" [", "\n["), **(
            {} if found else {"ylabel": f"draws, of {len(draws)}"})}, 2.6,
            adjust=lambda axis: axis.locator_params(axis="x", nbins=4)))
    return found


def limit_cycle(plot: LimitCyclePlotData) -> list[Panel]:
    """Speeds, torque and twist after the disturbance of the load, one column per situation."""
    columns = [_watch(plot, watch, k == 0) for k, watch in enumerate(plot.watches)]
    return [panel for row in zip(*columns, strict=True) for panel in row]


def _watch(plot: LimitCyclePlotData, watch, first: bool) -> list[Panel]:
    """The panels of one situation; the first has the labels."""
    time = watch.time
    centre = watch.motor_speed[-len(watch.motor_speed) // 4:].mean()
    caption = (f"limit cycle: +-{watch.amplitude:.3g} {plot.speed_unit} at {watch.frequency_hz:.3g} Hz"
               if watch.hunts else "no limit cycle")
    speeds = [mark("plot", time, speed - centre, color=colour, label=name if first else None)
              for name, speed, colour in (("load", watch.load_speed, ORANGE), ("motor", watch.motor_speed, BLUE))]
    gap = [mark("axhline", side * plot.half_gap, color=GREY, linestyle="--", linewidth=0.9)
           for side in (1e3, -1e3) if plot.half_gap]
    labels = (f"speed minus mean [{plot.speed_unit}]", f"motor torque [{plot.torque_unit}]",
              "twist of the shaft [mrad]" if plot.speed_unit == "rad/s" else "stretch [mm]")
    rows = (speeds, [mark("plot", time, watch.motor_torque, color=INK)],
            [mark("plot", time, 1e3 * watch.twist, color=GREEN), *gap])
    return [Panel(marks, {"xlim": (0.0, time[-1]), "xlabel": "time after the kick [s]",
                          **({"ylabel": label.replace(" [", "\n[")} if first else {})},
                  height, "" if k else f"{watch.situation}\n{caption}", shared=k > 0)
            for k, (marks, label, height) in enumerate(zip(rows, labels, (2.3, 1.4, 1.4), strict=True))]


_PANELS = {"criterion-plane": plane, "impact-drop-plane": plane, "load-step": load_step, "nichols": nichols,
           "sensitivity": sensitivity, "spread": spread, "hunting": limit_cycle}
