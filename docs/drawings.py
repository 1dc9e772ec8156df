"""The drawings of the explanation pages: `python docs/drawings.py docs/images`. Curves are computed."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle

matplotlib.rcParams.update({"svg.hashsalt": "drivetool", "svg.fonttype": "none", "font.size": 9,
                            "axes.spines.top": False, "axes.spines.right": False, "font.family": "sans-serif"})
BLUE, ORANGE, GREEN, GREY = "#1f5fa8", "#d9660a", "#2b8a3e", "#666666"
FILL = "#eef3f9"


def blank(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure in inches whose axes have the same units and no frame."""
    figure = Figure((width, height))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.axis("off")
    return figure, axes


def box(axes: Axes, x: float, y: float, text: str, width: float = 1.25, height: float = 0.5,
        fill: str = FILL) -> None:
    """A box about a centre with its text."""
    axes.add_patch(FancyBboxPatch((x - width / 2, y - height / 2), width, height, boxstyle="round,pad=0.02",
                                  facecolor=fill, edgecolor=BLUE))
    axes.text(x, y, text, ha="center", va="center")


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], text: str = "") -> None:
    """An arrow, with a text over its middle."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": GREY})
    axes.text((start[0] + end[0]) / 2, (start[1] + end[1]) / 2 + 0.09, text, ha="center", fontsize=8, color=GREY)


def chain() -> Figure:
    """Torque path, bodies and shafts of a two-mass drive, with their symbols."""
    figure, axes = blank(7.6, 2.4)
    box(axes, 0.8, 1.4, "torque path\n$\\omega_0,\\ \\zeta,\\ t_d$", 1.2, 0.7)
    for x, name, i in ((3.0, "motor", 1), (5.9, "load", 2)):
        axes.add_patch(Rectangle((x - 0.45, 0.8), 0.9, 1.2, facecolor=FILL, edgecolor=BLUE, linewidth=1.5))
        axes.text(x, 1.4, name, ha="center", va="center")
        axes.text(x, 0.5, f"$J_{i},\\ c_{i},\\ T_{{c{i}}},\\ T_{{0{i}}}$", ha="center", fontsize=8)
    x = np.linspace(3.45, 4.5, 200)
    phase = (x - 3.6) / 0.75  # five periods of a zigzag between the straight ends
    wave = 1.62 + 0.18 / np.pi * np.arcsin(np.sin(10 * np.pi * phase)) * ((phase > 0) & (phase < 1))
    axes.plot(x, wave, color=BLUE)
    axes.plot([3.45, 3.9, 3.9], [1.18, 1.18, 1.18], color=BLUE)
    axes.add_patch(Rectangle((3.85, 1.08), 0.25, 0.2, facecolor="white", edgecolor=BLUE))
    axes.plot([4.1, 4.5], [1.18, 1.18], color=BLUE)
    axes.plot([4.5, 4.5], [1.18, 1.62], color=BLUE)
    axes.plot([4.5, 4.72], [1.4, 1.4], color=BLUE)
    axes.plot([4.72, 4.72], [1.3, 1.5], color=BLUE)
    axes.plot([5.1, 5.1], [1.3, 1.5], color=BLUE)
    axes.plot([5.1, 5.45], [1.4, 1.4], color=BLUE)
    axes.text(4.0, 1.8, "$k_s$", ha="center")
    axes.text(4.0, 0.82, "$c_s$", ha="center")
    axes.annotate("", (5.1, 1.62), (4.72, 1.62), arrowprops={"arrowstyle": "<->", "color": ORANGE})
    axes.text(4.91, 1.7, "$2\\alpha$", ha="center", color=ORANGE)
    arrow(axes, (0.02, 1.4), (0.17, 1.4))
    axes.text(0.05, 1.95, "logged torque $u$", fontsize=8, color=GREY)
    arrow(axes, (1.43, 1.4), (2.53, 1.4), "torque $T$")
    arrow(axes, (3.0, 2.02), (3.0, 2.3))
    axes.text(3.1, 2.15, "angle $\\varphi_1$, speed $\\omega_1$", fontsize=8, color=GREY)
    axes.text(5.1, 2.15, "angle $\\varphi_2$, speed $\\omega_2$", fontsize=8, color=GREY)
    axes.text(4.4, 0.2, "ratio $n$:  twist $= \\varphi_1/n - \\varphi_2$", ha="center", fontsize=8)
    return figure


def files() -> Figure:
    """Which command reads and writes what."""
    figure, axes = blank(7.6, 2.9)
    box(axes, 0.8, 2.3, "recordings\nMCAP, Parquet", 1.3)
    box(axes, 0.8, 0.9, "channel map\nstart values", 1.3)
    for i, (name, y) in enumerate((("steady", 2.5), ("blackbox", 1.9), ("greybox", 1.3), ("backlash", 0.7))):
        box(axes, 2.9, y, name, 1.0, 0.36, "white")
        if i:
            arrow(axes, (2.9, y + 0.43), (2.9, y + 0.19))
    for y in (2.3, 0.9):
        arrow(axes, (1.47, y), (2.3, 1.6 + (y - 1.6) * 0.4))
    axes.add_patch(Rectangle((2.32, 0.42), 1.16, 2.36, facecolor="none", edgecolor=GREY, linestyle=":"))
    box(axes, 4.75, 1.6, "parameter file\nvalues, intervals,\ncovariance, findings", 1.5, 0.8)
    arrow(axes, (3.49, 1.6), (3.98, 1.6), "YAML")
    for name, y, out in (("validate", 2.55, "figures of fit"), ("diagnose", 1.95, "cause, gain,\nextended drive"),
                         ("tune", 1.3, "controller\nsettings"), ("simulate", 0.65, "simulated\nrecording")):
        box(axes, 6.2, y, name, 0.8, 0.36, "white")
        axes.text(6.7, y, out, va="center", fontsize=8, color=GREY)
        arrow(axes, (5.52, 1.6), (5.78, y))
    axes.text(3.8, 0.15, "Commands read recordings and the YAML files of earlier ones; each writes one of its own.",
              ha="center", fontsize=8, color=GREY)
    return figure


def innovations() -> Figure:
    """One-step predictions and a free run of the same model, whose Coulomb friction is 36 % too low."""
    rng = np.random.default_rng(4)
    step, n = 0.02, 300
    time = step * np.arange(n)
    torque = np.where((time // 1.5) % 2 == 0, 1.0, -1.0)
    true, free, predicted = np.zeros(n), np.zeros(n), np.zeros(n)
    for k in range(n - 1):
        true[k + 1] = true[k] + step * (torque[k] - 0.55 * np.sign(true[k]) - 0.25 * true[k])
    measured = true + 0.012 * rng.standard_normal(n)
    estimate = 0.0
    for k in range(n - 1):
        free[k + 1] = free[k] + step * (torque[k] - 0.35 * np.sign(free[k]) - 0.25 * free[k])
        ahead = estimate + step * (torque[k] - 0.35 * np.sign(estimate) - 0.25 * estimate)
        predicted[k + 1] = ahead
        estimate = ahead + 0.5 * (measured[k + 1] - ahead)
    figure = Figure((7.0, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, curve, title in ((left, predicted, "one-step prediction: close, whatever is missing"),
                               (right, free, "free run: the missing friction adds up")):
        axes.plot(time, measured, color=GREY, linewidth=1, label="measured")
        axes.plot(time, curve, color=ORANGE, linewidth=1, label="model")
        axes.set(xlabel="time in s", title=title)
        axes.title.set_fontsize(9)
    left.set_ylabel("speed")
    right.legend(frameon=False)
    return figure


def contact() -> Figure:
    """Torque over twist with a gap, and what passes through it over time."""
    figure = Figure((7.0, 2.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    twist = np.linspace(-2, 2, 401)
    left.plot(twist, np.sign(twist) * np.maximum(np.abs(twist) - 0.7, 0), color=BLUE)
    left.axvspan(-0.7, 0.7, color=FILL)
    left.text(0, 0.75, "open:\nno torque", ha="center", fontsize=8)
    left.text(1.4, 0.35, "slope $k_s$", color=BLUE)
    left.annotate("", (0.7, -0.35), (-0.7, -0.35), arrowprops={"arrowstyle": "<->", "color": ORANGE})
    left.text(0, -0.6, "$2\\alpha$", ha="center", color=ORANGE)
    left.set(xlabel="twist", ylabel="shaft torque", title="contact law")
    time = np.linspace(0, 3, 601)
    relative = 1.15 * np.cos(2.2 * time) + 0.03
    right.plot(time, relative, color=BLUE, label="twist")
    torque = np.sign(relative) * np.maximum(np.abs(relative) - 0.7, 0)
    right.plot(time, torque, color=GREEN, label="shaft torque")
    right.axhspan(-0.7, 0.7, color=FILL)
    right.set(xlabel="time", title="a torque reversal crosses the gap", yticks=[-0.7, 0, 0.7],
              yticklabels=["$-\\alpha$", "0", "$\\alpha$"])
    right.legend(frameon=False, fontsize=8)
    for axes in (left, right):
        axes.title.set_fontsize(9)
    return figure


def coast_down() -> Figure:
    """Speed over time of three frictions, and the deceleration over speed that separates them."""
    figure = Figure((7.0, 2.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for color, name, dry, viscous, drag in (
            (BLUE, "viscous", 0.0, 1.0, 0.0), (ORANGE, "with Coulomb friction", 0.25, 0.75, 0.0),
            (GREEN, "with drag", 0.0, 0.4, 0.6)):
        speed = [1.0]
        for _ in range(4000):
            w = speed[-1]
            speed.append(max(0.0, w - 1e-3 * (dry + viscous * w + drag * w * w)) if w > 0 else 0.0)
        left.plot(1e-3 * np.arange(4001), speed, color=color, label=name)
        w = np.linspace(0, 1, 101)
        right.plot(w, dry + viscous * w + drag * w * w, color=color)
    left.set(xlabel="time", ylabel="speed", title="coast-down without torque")
    right.set(xlabel="speed", ylabel="deceleration = friction / inertia", ylim=(0, None),
              title="offset: Coulomb / J, slope: viscous / J")
    left.legend(frameon=False, fontsize=8)
    for axes in (left, right):
        axes.title.set_fontsize(9)
    return figure


def verdict() -> Figure:
    """From records to one of four verdicts."""
    figure, axes = blank(7.6, 3.0)
    steps = ("correct faults\nof the record", "screen causes by\na score test", "fit the best\ncandidates",
             "score on held-out\nsamples", "compare with\nits rivals")
    for i, text in enumerate(steps):
        box(axes, 0.8 + 1.5 * i, 2.4, text, 1.25, 0.6)
        if i:
            arrow(axes, (0.8 + 1.5 * i - 0.84, 2.4), (0.8 + 1.5 * i - 0.66, 2.4))
    axes.annotate("", (2.3, 2.06), (6.8, 2.06), arrowprops={
        "arrowstyle": "-|>", "color": GREY, "connectionstyle": "bar,fraction=-0.07"})
    axes.text(4.55, 1.83, "next round, on top of the cause", ha="center", va="bottom", fontsize=8, color=GREY)
    outcomes = (("named", "one cause gains on held-out\nsamples, no rival is close"),
                ("undetermined", "several explain the record:\ndo the stated experiment"),
                ("unexplained", "the residual holds more\nthan any cause explains"),
                ("nothing-found", "no cause is significant"))
    for i, (name, text) in enumerate(outcomes):
        x = 1.0 + 1.87 * i
        box(axes, x, 0.85, name, 1.25, 0.36, "white")
        axes.text(x, 0.32, text, ha="center", va="center", fontsize=8, color=GREY)
        arrow(axes, (3.8, 1.55), (x, 1.07))
    axes.text(3.8, 1.6, "no further cause: table of rules, the first that holds decides", ha="center", fontsize=8)
    return figure


def intervals() -> Figure:
    """Two candidates that disagree by more than noise, and the interval that covers both."""
    figure = Figure((6.4, 2.0), layout="constrained")
    axes = figure.subplots()
    for y, value, std, color, name in (
            (3, 1.00, 0.01, BLUE, "innovations: noise only"), (2, 1.09, 0.02, GREEN, "free runs: noise only"),
            (1, 1.00, 0.09, ORANGE, "reported: noise and structure")):
        axes.errorbar(value, y, xerr=2 * std, color=color, fmt="o", capsize=3)
        axes.text(0.56, y, name, va="center", fontsize=8, color=color)
    axes.axvline(1.06, color=GREY, linestyle="--", linewidth=1)
    axes.text(1.065, 3.45, "true value", fontsize=8, color=GREY)
    axes.set(xlim=(0.55, 1.25), ylim=(0.5, 3.7), yticks=[], xlabel="estimate of one parameter")
    return figure


DRAWINGS = {"chain": chain, "files": files, "innovations": innovations, "contact": contact,
            "coast-down": coast_down, "verdict": verdict, "intervals": intervals}


def main(folder: str) -> None:
    """Write every drawing as SVG, without a date."""
    for name, draw in DRAWINGS.items():
        figure = draw()
        figure.savefig(Path(folder) / f"{name}.svg", metadata={"Date": None}, facecolor="white")


if __name__ == "__main__":
    main(*sys.argv[1:])
