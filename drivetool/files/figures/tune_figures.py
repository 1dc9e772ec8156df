"""How the pictures of a tuned loop are drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from drivetool.tune import Frequencies, GainTimeMap, LimitCyclePlotData, LoadStep, SpreadPicture

from drivetool.files.figures.plot_style import BLUE, CYCLE, GREEN, GREY, INK, ORANGE, RED

# dB of |S| in a Nichols chart. A choice: 3 and 6 dB are the usual limits of Ms, the others show the margin to them.
SENSITIVITY_LEVELS = (-6.0, -3.0, 0.0, 1.0, 3.0, 6.0, 12.0, 20.0)


def plane(picture: GainTimeMap) -> Figure:
    """Iso-lines of a figure and of Ms; where the loop is unstable, grey."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    n = len(picture.panels)
    drawn = Figure(figsize=(4.6 * n + 2.2, 5.2), layout="constrained")
    axes = drawn.subplots(1, n, squeeze=False, sharey=True)[0]
    every = np.concatenate([v[np.isfinite(v)] for v in picture.panels.values()])
    least, most = every.min(), min(every.max(), every.min() * 64.0)
    levels = np.geomspace(least * 1.02, most, 16)
    for axis, (name, values) in zip(axes, picture.panels.items(), strict=True):
        _log_axes(axis, picture)  # before any label is placed along a line
        inside = np.ma.masked_invalid(values)
        shade = axis.contourf(picture.times, picture.gains, inside, levels=np.geomspace(least * 0.999, most, 40),
                              norm=LogNorm(least, most), cmap="YlGnBu", extend="max")
        lines = axis.contour(picture.times, picture.gains, inside, levels=levels, colors=INK, linewidths=0.5)
        axis.clabel(lines, lines.levels[::2], fmt=lambda v: f"{v:.2g}", fontsize=7, inline_spacing=2)
        _sensitivity_lines(axis, picture)
        axis.plot(*picture.optimum, "o", color=INK, markeredgecolor="white", markersize=8, zorder=5)
        axis.annotate(f"  Ti {1e3 * picture.optimum[0]:.3g} ms\n  Kp {picture.optimum[1]:.4g}", picture.optimum,
                      fontsize=8, color=INK, fontweight="bold", zorder=6,
                      bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.75, "linewidth": 0},
                      xytext=(6, -26), textcoords="offset points")
        axis.set_title(picture.title if n == 1 else name)
    axes[0].set_ylabel(f"gain Kp [{picture.gain_unit}]")
    if n > 1:
        drawn.suptitle(picture.title, x=0.01, ha="left", fontsize=10.5, fontweight="bold")
    drawn.colorbar(shade, ax=list(axes), format=lambda v, _: f"{v:.2g}", ticks=levels[::3], pad=0.01)
    return drawn


def _log_axes(axis: Axes, picture: GainTimeMap) -> None:
    """Equal ratios on both axes, ticks at 1, 2 and 5."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    for one, values in ((axis.xaxis, picture.times), (axis.yaxis, picture.gains)):
        one.axes.set(**{f"{one.axis_name}scale": "log", f"{one.axis_name}lim": (values[0], values[-1])})
        one.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        one.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        one.set_minor_locator(NullLocator())
    axis.set_facecolor("#d4d7da")
    axis.grid(False)
    axis.set_xlabel("integral time Ti [s]")


def _sensitivity_lines(axis: Axes, picture: GainTimeMap) -> None:
    """The limit, 6 and 12 dB; unstable loops have none."""
    ms = np.where(np.isfinite(picture.ms), picture.ms, 1e6)
    wanted = sorted({picture.limit, 10 ** (6.0 / 20.0), 10 ** (12.0 / 20.0)})
    wanted = [w for k, w in enumerate(wanted) if k == 0 or w > wanted[k - 1] * 1.01]
    lines = axis.contour(picture.times, picture.gains, ms, levels=wanted, colors=RED,
                         linewidths=[2.0 if abs(w / picture.limit - 1.0) < 0.01 else 1.2 for w in wanted],
                         linestyles="--")
    axis.clabel(lines, fmt=lambda v: f"Ms {20 * np.log10(v):.3g} dB", fontsize=7.5, inline_spacing=2)
    unstable = ~np.isfinite(picture.ms)
    if unstable.any():
        rows = np.flatnonzero(unstable[:, len(picture.times) // 2])
        where = np.argwhere(unstable)
        row, column = (rows[len(rows) // 2], len(picture.times) // 2) if len(rows) else where[len(where) // 2]
        axis.text(picture.times[column], picture.gains[row], "unstable", color="#5c6269", ha="center", fontsize=9)


def load_step(picture: LoadStep) -> Figure:
    """Speeds above, torques below."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(8.0, 5.6), layout="constrained")
    upper, lower = drawn.subplots(2, 1, sharex=True, height_ratios=[1.4, 1.0])
    for label, (time, low, high) in picture.bands.items():
        upper.fill_between(1e3 * time, low, high, color=BLUE, alpha=0.22, linewidth=0, zorder=1,
                           label=f"{label}, 90 % of the drives that the uncertainty allows")
    for (label, (time, speed)), colour in zip(picture.speeds.items(), _curve_colours(picture.speeds), strict=False):
        upper.plot(1e3 * time, speed, color=colour, label=label, zorder=2 + (label == "load speed"))
    for (label, (time, torque)), colour in zip(picture.torques.items(), _curve_colours(picture.torques),
                                               strict=False):
        lower.plot(1e3 * time, torque, color=colour, label=label)
    upper.axhline(0.0, color="#5c6269", linewidth=0.8)
    upper.set_title(picture.title)
    upper.set_ylabel(picture.speed_label)
    lower.set_ylabel(picture.torque_label)
    lower.set_xlabel("time after the step [ms]")
    lower.set_xlim(0.0, 1e3 * next(iter(picture.speeds.values()))[0][-1])
    for axis in (upper, lower):
        axis.legend(loc="best")
    return drawn


def _curve_colours(curves) -> tuple[str, ...]:
    return (GREY, BLUE) if list(curves) == ["motor speed", "load speed"] else CYCLE


def nichols(picture: Frequencies) -> Figure:
    """Loop gain over phase with lines of equal |S|."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(8.0, 6.2), layout="constrained")
    axis = drawn.subplots()
    low, high = -32.0, 32.0
    first = next(iter(picture.curves.values()))[1]
    phases = [_phase_degrees(loop) for _, loop in picture.curves.values()]
    left = max(-720.0, min(p[_in_picture(c[1])].min()
                           for p, c in zip(phases, picture.curves.values(), strict=True)))
    left = 90.0 * np.floor(left / 90.0)
    _equal_sensitivity(axis, left, picture.limit, low, high)
    for k, (label, (_, loop)) in enumerate(picture.curves.items()):
        axis.plot(phases[k], 20.0 * np.log10(np.abs(loop)), label=label, zorder=4 if k == 0 else 3,
                  **_variation_style(k, label))
    for turn in range(-3, 1):
        axis.plot(-180.0 + 360.0 * turn, 0.0, "+", color=RED, markersize=11, markeredgewidth=2, zorder=5)
    axis.set_xlim(left, max(-60.0, float(np.ceil(_phase_degrees(first)[_in_picture(first)].max() / 30.0)) * 30.0))
    axis.set_ylim(low, high)
    axis.set_xlabel("phase of the loop [deg]")
    axis.set_ylabel("gain of the loop [dB]")
    axis.set_title(picture.title)
    axis.legend(loc="upper left", fontsize=7.5, frameon=True, framealpha=0.85, edgecolor="none")
    return drawn


def _in_picture(loop: np.ndarray) -> np.ndarray:
    """Where the gain is in the picture."""
    return np.abs(20.0 * np.log10(np.abs(loop))) < 30.0


def _phase_degrees(loop: np.ndarray) -> np.ndarray:
    """Unwrapped, beginning between -360 and 0 degrees."""
    phase = np.rad2deg(np.unwrap(np.angle(loop)))
    return phase - 360.0 * np.ceil(phase[0] / 360.0)


def _equal_sensitivity(axis: Axes, left: float, limit: float, low: float, high: float) -> None:
    """Lines |1/(1 + L)| = const; inside the limit's line, shaded."""
    phase, gain = np.meshgrid(np.linspace(left, 0.0, 721), np.linspace(low, high, 401))
    loop = 10.0 ** (gain / 20.0) * np.exp(1j * np.deg2rad(phase))
    size = -20.0 * np.log10(np.maximum(np.abs(1.0 + loop), 1e-6))
    lines = axis.contour(phase, gain, size, levels=SENSITIVITY_LEVELS, colors="#b9bec4", linewidths=0.8)
    axis.clabel(lines, fmt=lambda v: f"{v:g} dB", fontsize=7)
    bound = 20.0 * np.log10(limit)
    axis.contourf(phase, gain, size, levels=[bound, 200.0], colors=[RED], alpha=0.13)
    axis.contour(phase, gain, size, levels=[bound], colors=RED, linewidths=1.2)


def sensitivity(picture: Frequencies) -> Figure:
    """|S| over frequency with the limit."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(8.0, 4.8), layout="constrained")
    axis = drawn.subplots()
    edges = []
    for k, (label, (frequency, loop)) in enumerate(picture.curves.items()):
        size = 1.0 / np.abs(1.0 + loop)
        axis.plot(frequency, 20.0 * np.log10(size), label=f"{label}: Ms {size.max():.3g}",
                  zorder=4 if k == 0 else 3, **_variation_style(k, label))
        edges.append(frequency[np.argmax(size > 0.03)])
    axis.axhline(20.0 * np.log10(picture.limit), color=RED, linestyle="--", linewidth=1.1)
    axis.text(0.005, 20.0 * np.log10(picture.limit) + 0.4, f"limit {picture.limit:g}", color=RED, fontsize=8,
              transform=axis.get_yaxis_transform())
    first = next(iter(picture.curves.values()))
    above = first[0][np.argmax(1.0 / np.abs(1.0 + first[1]))]
    axis.set_xscale("log")
    axis.set_xlim(min(edges), max(15.0 * above, 20.0 * min(edges)))
    axis.set_ylim(-30.0, None)
    axis.set_xlabel("frequency [Hz]")
    axis.set_ylabel("|S| [dB]")
    axis.set_title(picture.title)
    axis.legend(loc="lower right", fontsize=7.5)
    axis.grid(True, which="minor", linewidth=0.4)
    return drawn


def _variation_style(k: int, label: str) -> dict[str, object]:
    """The nominal loop stands out; loops with a lowered parameter are dashed."""
    if k == 0:
        return {"color": INK, "linewidth": 2.0}
    colours = {"stiffness": BLUE, "inertia": GREEN, "dead_time": ORANGE}
    colour = next((c for word, c in colours.items() if word in label), GREY)
    if "to 80 %" in label:
        colour = RED
    return {"color": colour, "linewidth": 1.0, "linestyle": "--" if " -" in label else "-"}


def spread(picture: SpreadPicture) -> Figure:
    """Histograms of sensitivity, impact drop and overshoot over the draws."""
    from matplotlib.figure import Figure

    names = list(picture.spread.samples)
    drawn = Figure(figsize=(9.0, 3.6), layout="constrained")
    axes = drawn.subplots(1, len(names))
    for axis, name in zip(axes, names, strict=True):
        power = int(np.floor(np.log10(abs(picture.nominal[name])))) if picture.nominal[name] else 0
        scale = 1.0 if -2 <= power <= 3 else 10.0 ** -power  # in the label, where an offset would be overlooked
        values = picture.spread.samples[name] * scale
        values = values[np.isfinite(values)]
        if np.ptp(values) > 0.0:
            axis.hist(values, bins=min(30, max(8, len(values) // 8)), color=BLUE, alpha=0.55)
        axis.axvline(picture.nominal[name] * scale, color=INK, linewidth=1.6, label="nominal")
        axis.axvline(picture.spread.quantiles[name]["0.95"] * scale, color=ORANGE, linewidth=1.4, linestyle="--",
                     label="95 % stay below")
        if name == "max_sensitivity":
            axis.axvline(picture.limit, color=RED, linewidth=1.4, linestyle=":", label="limit")
        axis.set_xlabel(picture.units[name] if scale == 1.0 else picture.units[name].replace("[", f"[1e{power} "))
        axis.grid(False, axis="x")
        axis.locator_params(axis="x", nbins=4)
    axes[0].set_ylabel(f"draws, of {len(picture.spread.samples[names[0]])}")
    drawn.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    varied = ", ".join(picture.spread.parameters)
    drawn.suptitle(picture.title, x=0.01, ha="left", fontsize=10.5, fontweight="bold")
    if len(varied) > 90:
        varied = f"{len(picture.spread.parameters)} parameters"
    axes[1].set_title(f"varied: {varied}", fontsize=7.5, fontweight="normal", loc="center")
    return drawn


def limit_cycle(picture: LimitCyclePlotData) -> Figure:
    """Speeds and torque after the disturbance of the load, one column per situation."""
    from matplotlib.figure import Figure

    n = len(picture.watches)
    drawn = Figure(figsize=(3.6 * n + 2.4, 6.0), layout="constrained")
    axes = drawn.subplots(3, n, squeeze=False, sharex="col", height_ratios=[1.5, 1.0, 1.0])
    for column, watch in enumerate(picture.watches):
        upper, middle, lower = axes[:, column]
        centre = watch.motor_speed[-len(watch.motor_speed) // 4:].mean()
        upper.plot(watch.time, watch.load_speed - centre, color=ORANGE, label="load")
        upper.plot(watch.time, watch.motor_speed - centre, color=BLUE, linewidth=1.0, label="motor")
        middle.plot(watch.time, watch.motor_torque, color=INK, linewidth=1.0)
        lower.plot(watch.time, 1e3 * watch.twist, color=GREEN, linewidth=1.0)
        for side in (1e3, -1e3) if picture.half_gap else ():
            lower.axhline(side * picture.half_gap, color=GREY, linestyle="--", linewidth=0.9)
        cycle = watch.cycle
        caption = (f"hunts: +-{cycle.amplitude:.3g} {picture.speed_unit} at {cycle.frequency:.3g} Hz"
                   if cycle.hunts else "comes to rest")
        upper.set_title(f"{cycle.situation}\n{caption}", fontsize=8.5, color=RED if cycle.hunts else INK)
        lower.set_xlabel("time after the kick [s]")
        lower.set_xlim(0.0, watch.time[-1])
    axes[0, 0].set_ylabel(f"speed less its mean [{picture.speed_unit}]")
    axes[1, 0].set_ylabel(f"motor torque [{picture.torque_unit}]")
    axes[2, 0].set_ylabel("twist of the shaft [mrad]" if picture.speed_unit == "rad/s" else "stretch [mm]")
    axes[0, 0].legend(loc="upper right")
    drawn.suptitle(picture.title, x=0.01, ha="left", fontsize=10.5, fontweight="bold")
    return drawn


KINDS = {"criterion-plane": plane, "impact-drop-plane": plane, "load-step": load_step, "nichols": nichols,
         "sensitivity": sensitivity, "spread": spread, "hunting": limit_cycle}
