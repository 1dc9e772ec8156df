"""Colours and style that all pictures share."""

from __future__ import annotations

from typing import Any

GREY, BLUE, ORANGE, RED, GREEN, INK = "#8d939b", "#1763a6", "#d9730d", "#b3362d", "#3a7d44", "#2b2f33"
AXIS_COLOUR, GRID_COLOUR, MEASURED_COLOUR = "#5c6269", "#e3e6e9", "#b9bec4"
CYCLE = (BLUE, ORANGE, GREEN, RED, "#6b4c9a", GREY)
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans", "font.size": 9.5, "figure.titlesize": 11, "figure.titleweight": "bold",
    "axes.titlesize": 9.5, "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False,
    "axes.grid": True,
    "axes.edgecolor": AXIS_COLOUR, "axes.labelcolor": INK, "text.color": INK, "grid.color": GRID_COLOUR,
    "grid.linewidth": 0.7, "axes.axisbelow": True, "xtick.color": AXIS_COLOUR, "ytick.color": AXIS_COLOUR,
    "legend.frameon": False, "legend.fontsize": 9, "lines.linewidth": 1.2, "figure.dpi": 140,
    "savefig.dpi": 140, "axes.formatter.useoffset": False, "path.simplify": False,
    "svg.fonttype": "path", "svg.hashsalt": "drivetool", "hatch.linewidth": 0.6,
}
