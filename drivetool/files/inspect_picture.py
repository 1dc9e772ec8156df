"""The picture of a recording: a panel per channel, gaps shaded, spikes marked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drivetool.files.plots import decimated

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from drivetool.identify.estimate import Exhibit

INK, RED, SHADE = "#2b2f33", "#b3362d", "#f3d9b8"


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
        # Stretch by stretch, or the thinned line would run across the gaps.
        begins = exhibit.curves.get(f"gaps {label}", np.zeros((2, 0)))[1]
        for stretch in np.split(np.arange(len(time)), np.searchsorted(time, begins)):
            axis.plot(*decimated(time[stretch], values[stretch]), color=INK, linewidth=0.8)
        # A name can be long and the panel is low: it stands above its panel.
        axis.text(0.0, 1.03, label.strip(), transform=axis.transAxes, fontsize=8, va="bottom")
        axis.locator_params(axis="y", nbins=3)
        axis.yaxis.set_major_formatter("{x:.4g}")
        axis.margins(x=0.01)
        if (spikes := exhibit.curves.get(f"spikes {label}")) is not None:
            axis.plot(*spikes, "o", color=RED, markersize=3, label=f"{len(spikes[0])} spikes")
        for begin, end in np.transpose(exhibit.curves.get(f"gaps {label}", np.zeros((2, 0)))):
            axis.axvspan(begin, end, color=SHADE, linewidth=0, zorder=0,
                         label="no samples" if begin == exhibit.curves[f"gaps {label}"][0][0] else None)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, borderaxespad=0.1, fontsize=7.5)
    axes[-1].set_xlabel(exhibit.x)
    drawn.align_ylabels(list(axes))
    return drawn
