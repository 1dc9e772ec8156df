"""A picture is a list of panels, a panel a list of marks: data, and the kind in which they are drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from drivetool.files.figures.plot_style import AXIS_COLOUR, INK
from drivetool.files.figures.thinning import decimated

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 7.0  # inches. A choice: letters that can be read on a phone and on paper
TITLE_CHARACTERS, LEGEND_CHARACTERS = 72, 84  # a choice: what fits into that width in the fonts of the two


@dataclass(frozen=True)
class Mark:
    """Data that are drawn in one way.

    kind  line, stems, ticks, contours or heat; else a method of Matplotlib's axes (plot, errorbar ...)
    look  its label in the legend, colour, width ...
    """

    kind: str
    data: tuple[Any, ...]
    look: Mapping[str, Any]


@dataclass(frozen=True)
class Panel:
    """Marks on the same axes.

    settings  of the axes, as Matplotlib names them: xlabel, ylim, yscale ...
    height    in inches; title: above it; shared: the x axis is that of the panel above
    adjust    what settings do not express, as the places of ticks
    """

    marks: Sequence[Mark]
    settings: Mapping[str, Any] = field(default_factory=dict)
    height: float = 3.0
    title: str = ""
    shared: bool = False
    adjust: Callable[[Axes], Any] | None = None


def mark(kind: str, *data: Any, **look: Any) -> Mark:
    """A mark by the words that Matplotlib uses."""
    return Mark(kind, data, look)


def zero(direction: str = "h") -> Mark:
    """The line at zero."""
    return mark(f"ax{direction}line", 0.0, color=AXIS_COLOUR, linewidth=0.8)


def picture(title: str, panels: Sequence[Panel], columns: int = 1, width: float = WIDTH) -> Figure:
    """The panels row by row under one title."""
    from matplotlib.figure import Figure

    rows = [panel.height for panel in panels[::columns]]
    drawn = Figure(figsize=(width, 1.0 + sum(rows)), layout="constrained")
    grid = drawn.add_gridspec(len(rows), columns, height_ratios=rows)
    axes: list[Axes] = []
    for k, panel in enumerate(panels):
        axes.append(drawn.add_subplot(grid[k], sharex=axes[k - columns] if panel.shared else None))
    rooms = np.zeros(len(panels))
    drawn.suptitle(fill(title, int(TITLE_CHARACTERS * width / WIDTH)), x=0.01, ha="left")
    for k, (axis, panel) in enumerate(zip(axes, panels, strict=True)):
        _draw(axis, panel)
        if panel.shared:
            axes[k - columns].tick_params(labelbottom=False)
            axes[k - columns].set_xlabel("")
        rooms[k] = _legend_above(axis, LEGEND_CHARACTERS * width / WIDTH / columns)
        if panel.title:
            axis.set_title(panel.title, pad=rooms[k])
    drawn.set_figheight(1.0 + sum(rows) + rooms[::columns].sum() / 72.0)
    drawn.align_ylabels(axes)
    return drawn


def _draw(axis: Axes, panel: Panel) -> None:
    """The marks of a panel and its settings; limits that the marks do not move are set before them."""
    axis.set(**{name: value for name, value in panel.settings.items() if name.endswith("scale")
                or (name.endswith("lim") and None not in value)})
    for each in panel.marks:
        draw = _KINDS.get(each.kind) or getattr(type(axis), each.kind)
        draw(axis, *each.data, **each.look)
    axis.set(**panel.settings)
    if panel.adjust is not None:
        panel.adjust(axis)


def _legend_above(axis: Axes, characters: float) -> float:
    """The legend between title and panel, where it covers nothing; the room that it takes, in points."""
    labels = axis.get_legend_handles_labels()[1]
    if not labels:
        return 6.0  # of a title alone
    columns = int(np.clip(characters // (max(map(len, labels)) + 5), 1, 4))
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.2)
    return 12.0 + 14.0 * -(-len(labels) // columns)


def _line(axis: Axes, x: np.ndarray, y: np.ndarray, **look: Any) -> None:
    """A curve, thinned to what the picture can show."""
    axis.plot(*decimated(x, y), **look)


def _stems(axis: Axes, x: np.ndarray, y: np.ndarray, label: str | None = None, size: float = 2.6,
           sideways: bool = False, color: str = INK) -> None:
    """Points, each with a line to zero."""
    (axis.hlines if sideways else axis.vlines)(y if sideways else x, 0.0, x if sideways else y, color=color,
                                               linewidth=1.1)
    axis.plot(x, y, "o", color=color, markersize=size, label=label)


def _ticks(axis: Axes, x: np.ndarray, **look: Any) -> None:
    """Short lines on the x axis."""
    axis.plot(x, np.zeros(len(x)), "|", markersize=9, clip_on=False, transform=axis.get_xaxis_transform(), **look)


def _contours(axis: Axes, *data: np.ndarray, text: Callable[[float], str] | None = None, every: int = 1,
              **look: Any) -> None:
    """Lines of equal value with their values."""
    lines = axis.contour(*data, **look)
    if text is not None:
        axis.clabel(lines, lines.levels[::every], fmt=text, fontsize=7.5, inline_spacing=2)


def _heat(axis: Axes, *data: np.ndarray, bar: Mapping[str, Any] | None, filled: bool = False, **look: Any) -> None:
    """Colours over two axes; with a bar that explains those of all panels."""
    shade = (axis.contourf if filled else axis.pcolormesh)(*data, **look)
    axis.grid(False)
    if bar is not None:
        axis.figure.colorbar(shade, ax=axis.figure.axes, pad=0.01, **bar)


_KINDS: Mapping[str, Callable[..., None]] = {"line": _line, "stems": _stems, "ticks": _ticks,
                                             "contours": _contours, "heat": _heat}
