"""Pictures of what a step saw: one PNG per exhibit, the same bytes for the same input."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from io import BytesIO
from itertools import pairwise
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

import numpy as np

from drivetool.files.write import check_folder, make_folder, write_whole
from drivetool.identify.estimate import Exhibit

if TYPE_CHECKING:
    from drivetool.logs.experiment import Experiment

PER_ROUND = ("diagnosis-candidates",)


def draw_all(exhibits: Sequence[Exhibit], folder: str | Path, step: str,
             records: Sequence[str] = ()) -> list[str]:
    """Draw every exhibit.

    exhibits  what the step saw; those of one kind in the order of the records
    folder    made if it is missing, also for no exhibits
    step      name of the step, the first part of every file name
    records   names of the recordings
    returns   the file names
    """
    check_folder(folder)
    make_folder(folder)
    names = file_names(exhibits, step, records)
    for exhibit, name in zip(exhibits, names, strict=True):
        write_whole(Path(folder) / name, png(exhibit))
    return names


def file_names(exhibits: Sequence[Exhibit], step: str, records: Sequence[str]) -> list[str]:
    """'greybox-steps-record.png'; numbers where there is not one exhibit per record, but per round, say."""
    many = Counter(exhibit.kind for exhibit in exhibits)
    stems = [PurePath(record).stem for record in records]
    seen: Counter[str] = Counter()
    names = []
    for exhibit in exhibits:
        kind = exhibit.kind
        index = seen[kind]
        seen[kind] += 1
        if kind in PER_ROUND:
            part = f"-round-{index + 1}"
        elif many[kind] == len(stems) == len(set(stems)):
            part = f"-{stems[index]}"
        else:
            part = f"-{index + 1}" if many[kind] > 1 else ""
        names.append(f"{step}{part}-{kind}.png")
    return names


def png(exhibit: Exhibit) -> bytes:
    """The picture as PNG bytes without anything that changes from run to run."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from drivetool.files.figures import figure
    from drivetool.files.look import STYLE, as_written, drawing

    with drawing(STYLE):
        drawn = as_written(figure(exhibit))
        buffer = BytesIO()
        FigureCanvasAgg(drawn).print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


def exhibit_of(experiment: Experiment) -> Exhibit:
    """The recording itself, for when there is no fit to show."""
    time = experiment.time
    return Exhibit("recording", f"Recording {experiment.name}", "time [s]", "",
                   {f"{role.replace('_', ' ')} [{experiment.unit(role)}]": (time, values)
                    for role, values in experiment.signals.items()})


def decimated(x: np.ndarray, y: np.ndarray, bins: int = 1200) -> tuple[np.ndarray, np.ndarray]:
    """At most 2 points per bin, the least and the greatest, so that no peak is lost.

    x, y     (n,) of a curve over rising x; NaN where there is nothing
    returns  shorter x, y in the order of x; where evenly spaced x have a gap, a NaN in it, so that no line
             is drawn over what was not recorded
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    edges = [0, *(_gaps(x) + 1), len(x)]
    parts = [_thinned(x[a:b], y[a:b], len(x), bins) for a, b in pairwise(edges)]
    for k in range(len(parts) - 1, 0, -1):
        parts.insert(k, (x[edges[k] - 1:edges[k]], np.array([np.nan])))
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _gaps(x: np.ndarray) -> np.ndarray:
    """Places after which evenly spaced samples have a gap; none where they are not evenly spaced."""
    steps = np.diff(x)
    if len(steps) < 3:
        return np.empty(0, int)
    usual = np.median(steps)
    wide = steps > 1.5 * usual
    even = np.abs(steps - usual) < 0.01 * usual
    return np.flatnonzero(wide) if np.mean(even | wide) == 1.0 and even.mean() > 0.9 else np.empty(0, int)


def _thinned(x: np.ndarray, y: np.ndarray, of: int, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """A stretch of a curve of so many samples; bins of the whole."""
    if of <= 2 * bins:
        return x, y
    width = -(-of // bins)
    rows = np.pad(y, (0, -len(y) % width), mode="edge").reshape(-1, width)
    base = np.arange(len(rows)) * width
    low = np.argmin(np.where(np.isnan(rows), np.inf, rows), axis=1) + base
    high = np.argmax(np.where(np.isnan(rows), -np.inf, rows), axis=1) + base
    keep = np.minimum(np.sort(np.concatenate([low, high])), len(y) - 1)
    return x[keep], y[keep]
