"""Colours and style that all pictures share."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY, BLUE, ORANGE, RED, GREEN, INK = "#8d939b", "#1763a6", "#d9730d", "#b3362d", "#3a7d44", "#2b2f33"
CYCLE = (BLUE, ORANGE, GREEN, RED, "#6b4c9a", GREY)
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans", "font.size": 9, "axes.titlesize": 10.5, "axes.titleweight": "bold",
    "axes.titlelocation": "left", "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "axes.edgecolor": "#5c6269", "axes.labelcolor": INK, "text.color": INK, "grid.color": "#e3e6e9",
    "grid.linewidth": 0.7, "axes.axisbelow": True, "xtick.color": "#5c6269", "ytick.color": "#5c6269",
    "legend.frameon": False, "legend.fontsize": 8.5, "lines.linewidth": 1.3, "figure.dpi": 120,
    "savefig.dpi": 120, "axes.formatter.useoffset": False, "path.simplify": False,
}


def stacked_panels(n: int, width: float, height: float) -> tuple[Figure, list[Axes]]:
    """n panels above each other, each with an x axis of its own; width, height: of the whole picture [inches]."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(width, height), layout="constrained")
    return drawn, list(drawn.subplots(n, 1, squeeze=False)[:, 0])


@contextmanager
def drawing_style(style: Mapping[str, Any]) -> Iterator[None]:
    """Draw with a style; a letter that the font lacks is a box in the picture, without a warning."""
    from matplotlib import rc_context

    with rc_context(dict(style)), warnings.catch_warnings():
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
