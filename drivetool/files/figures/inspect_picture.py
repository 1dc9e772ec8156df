"""The picture of a recording: a panel per channel, gaps shaded, spikes marked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drivetool.files.figures.thinning import decimated

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from drivetool.identify.estimate import PlotData

INK, RED, GAP_COLOUR = "#2b2f33", "#b3362d", "#f3d9b8"
# Share of the width below which a stretch is drawn with dots: under three pixels, too short a line to be visible.
MIN_LINE_SHARE = 0.003


def _display_offset(values: np.ndarray) -> float:
    """Offset subtracted from values that hardly differ, so that the axis resolves them; else 0."""
    finite = values[np.isfinite(values)]
    low, span = float(finite.min()), float(np.ptp(finite))
    if not 0 < span < 1e-3 * abs(low):
        return 0.0
    round_to = 10.0 ** np.floor(np.log10(span))
    return float(np.floor(low / round_to) * round_to)


def panels(plot: PlotData) -> Figure:
    """One small panel per channel; labels that begin with `spikes` or `gaps` belong to the one before."""
    from matplotlib.figure import Figure

    main = [label for label in plot.curves if not label.startswith(("spikes ", "gaps "))]
    n = max(1, len(main))
    drawn = Figure(figsize=(8.0, 0.9 + 0.95 * n), layout="constrained")
    axes = drawn.subplots(n, 1, sharex=True, squeeze=False)[:, 0]
    axes[0].set_title(plot.title, pad=18)
    for axis, label in zip(axes, main, strict=False):
        time, values = plot.curves[label]
        base = _display_offset(values)
        # Stretch by stretch, or the thinned line would run across the gaps.
        begins = plot.curves.get(f"gaps {label}", np.zeros((2, 0)))[1]
        for stretch in np.split(np.arange(len(time)), np.searchsorted(time, begins)):
            # A line this short would not be visible.
            dot = "." if np.ptp(time[stretch]) < MIN_LINE_SHARE * np.ptp(time) else None
            axis.plot(*decimated(time[stretch], values[stretch] - base), color=INK, linewidth=0.8, marker=dot,
                      markersize=2)
        # A name can be long and the panel is low: it stands above its panel.
        name = label.strip() + (f", less {base:.15g}" if base else "")
        axis.text(0.0, 1.03, name, transform=axis.transAxes, fontsize=8, va="bottom")
        axis.locator_params(axis="y", nbins=3)
        axis.yaxis.set_major_formatter("{x:.4g}")
        axis.margins(x=0.01)
        if (spikes := plot.curves.get(f"spikes {label}")) is not None:
            axis.plot(spikes[0], spikes[1] - base, "o", color=RED, markersize=3, label=f"{len(spikes[0])} spikes")
        for begin, end in np.transpose(plot.curves.get(f"gaps {label}", np.zeros((2, 0)))):
            axis.axvspan(begin, end, color=GAP_COLOUR, linewidth=0, zorder=0,
                         label="no samples" if begin == plot.curves[f"gaps {label}"][0][0] else None)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, borderaxespad=0.1, fontsize=7.5)
    axes[-1].set_xlabel(plot.x)
    drawn.align_ylabels(list(axes))
    return drawn
