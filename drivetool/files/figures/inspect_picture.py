"""The picture of a recording: a panel per channel, gaps shaded, spikes marked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drivetool.files.figures.thinning import decimated

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from drivetool.identify.estimate import Exhibit

INK, RED, SHADE = "#2b2f33", "#b3362d", "#f3d9b8"
# Share of the width below which a stretch is drawn with dots.
NARROW = 0.003


def _base(values: np.ndarray) -> float:
    """What is taken off values that hardly differ, so that they can be told apart at the axis; else 0."""
    seen = values[np.isfinite(values)]
    low, span = float(seen.min()), float(np.ptp(seen))
    if not 0 < span < 1e-3 * abs(low):
        return 0.0
    round_to = 10.0 ** np.floor(np.log10(span))
    return float(np.floor(low / round_to) * round_to)


def panels(exhibit: Exhibit) -> Figure:
    """One small panel per channel; labels that begin with `spikes` or `gaps` belong to the one before."""
    from matplotlib.figure import Figure

    main = [label for label in exhibit.curves if not label.startswith(("spikes ", "gaps "))]
    n = max(1, len(main))
    drawn = Figure(figsize=(8.0, 0.9 + 0.95 * n), layout="constrained")
    axes = drawn.subplots(n, 1, sharex=True, squeeze=False)[:, 0]
    axes[0].set_title(exhibit.title, pad=18)
    for axis, label in zip(axes, main, strict=False):
        time, values = exhibit.curves[label]
        base = _base(values)
        # Stretch by stretch, or the thinned line would run across the gaps.
        begins = exhibit.curves.get(f"gaps {label}", np.zeros((2, 0)))[1]
        for stretch in np.split(np.arange(len(time)), np.searchsorted(time, begins)):
            # One that is narrower than a line would not be seen.
            dot = "." if np.ptp(time[stretch]) < NARROW * np.ptp(time) else None
            axis.plot(*decimated(time[stretch], values[stretch] - base), color=INK, linewidth=0.8, marker=dot,
                      markersize=2)
        # A name can be long and the panel is low: it stands above its panel.
        name = label.strip() + (f", less {base:.15g}" if base else "")
        axis.text(0.0, 1.03, name, transform=axis.transAxes, fontsize=8, va="bottom")
        axis.locator_params(axis="y", nbins=3)
        axis.yaxis.set_major_formatter("{x:.4g}")
        axis.margins(x=0.01)
        if (spikes := exhibit.curves.get(f"spikes {label}")) is not None:
            axis.plot(spikes[0], spikes[1] - base, "o", color=RED, markersize=3, label=f"{len(spikes[0])} spikes")
        for begin, end in np.transpose(exhibit.curves.get(f"gaps {label}", np.zeros((2, 0)))):
            axis.axvspan(begin, end, color=SHADE, linewidth=0, zorder=0,
                         label="no samples" if begin == exhibit.curves[f"gaps {label}"][0][0] else None)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, borderaxespad=0.1, fontsize=7.5)
    axes[-1].set_xlabel(exhibit.x)
    drawn.align_ylabels(list(axes))
    return drawn
