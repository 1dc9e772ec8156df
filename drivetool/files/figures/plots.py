"""Pictures of the results of a step: one PNG per plot data, the same bytes for the same input."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path, PurePath

from matplotlib import rc_context
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text

from drivetool.files.disk import check_folder, make_folder, write_whole
from drivetool.files.figures.plot_kinds import figure
from drivetool.files.figures.plot_style import STYLE
from drivetool.identify.estimate import PlotData
from drivetool.logs import Experiment

KINDS_PER_ROUND = ("diagnosis-candidates",)


def draw_all(plots: Sequence[PlotData], folder: str | Path, step: str,
             records: Sequence[str] = ()) -> list[str]:
    """Draw all plot data.

    plots    plot data of the step; those of one kind in the order of the records
    folder   made if it is missing, also without plot data
    step     name of the step, the first part of every file name
    records  names of the recordings
    returns  the file names
    """
    check_folder(folder)
    make_folder(folder)
    names = picture_names(plots, step, records)
    for plot, name in zip(plots, names, strict=True):
        write_whole(Path(folder) / name, png(plot))
    return names


def picture_names(plots: Sequence[PlotData], step: str, records: Sequence[str]) -> list[str]:
    """'greybox-steps-record.png'; numbers where there is not one plot per record, but one per round, say."""
    kinds = [plot.kind for plot in plots]
    stems = [PurePath(record).stem for record in records]
    names = []
    for n, kind in enumerate(kinds):
        index = kinds[:n].count(kind)
        if kind in KINDS_PER_ROUND:
            part = f"-round-{index + 1}"
        elif kinds.count(kind) == len(stems) == len(set(stems)):
            part = f"-{stems[index]}"
        else:
            part = f"-{index + 1}" if kinds.count(kind) > 1 else ""
        names.append(f"{step}{part}-{kind}.png")
    return names


def png(plot: PlotData) -> bytes:
    """The picture as PNG bytes without anything that changes from run to run."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    buffer = BytesIO()
    with drawing_style():
        FigureCanvasAgg(without_math_text(figure(plot))).print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


def svg(plot: PlotData) -> str:
    """The picture as an SVG element without anything that changes from run to run."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = BytesIO()
    with drawing_style():
        FigureCanvasSVG(without_math_text(figure(plot))).print_svg(buffer, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue().decode("utf-8")
    return text[text.index("<svg"):].strip()


def recording_plot(experiment: Experiment) -> PlotData:
    """The recording itself, where there is no fit to show."""
    time = experiment.time
    return PlotData("recording", f"Recording {experiment.name}", "time [s]", "",
                   {f"{role.replace('_', ' ')} [{experiment.unit(role)}]": (time, values)
                    for role, values in experiment.signals.items()})


@contextmanager
def drawing_style() -> Iterator[None]:
    """Draw with the style; a letter that the font lacks is a box in the picture, without a warning."""
    with rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        yield


def without_math_text(drawn: Figure) -> Figure:
    """The picture with its texts as they are: a name with two dollar signs is no formula."""
    for parent in (drawn, *drawn.axes):
        for child in parent.get_children():
            if isinstance(child, Axis):  # its numbers may have powers
                child.label.set_parse_math(False)
            elif child not in drawn.axes:
                for text in child.findobj(Text):
                    text.set_parse_math(False)
    return drawn
