"""Colours and style that all pictures share."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


@contextmanager
def drawing_style() -> Iterator[None]:
    """Draw with the style; a letter that the font lacks is a box in the picture, without a warning."""
    from matplotlib import rc_context

    with rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        yield


def without_math_text(drawn: Figure) -> Figure:
    """The picture with its texts as they are: a name with two dollar signs is no formula."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    for parent in (drawn, *drawn.axes):
        for child in parent.get_children():
            if isinstance(child, Axis):  # its numbers may have powers
                child.label.set_parse_math(False)
            elif child not in drawn.axes:
                for text in child.findobj(Text):
                    text.set_parse_math(False)
    return drawn
