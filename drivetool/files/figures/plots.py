"""Pictures of what a step saw: one PNG per exhibit, the same bytes for the same input."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path, PurePath

from drivetool.files.disk import check_folder, make_folder, write_whole
from drivetool.files.figures.exhibits import figure
from drivetool.files.figures.look import STYLE, as_written, drawing
from drivetool.identify.estimate import Exhibit
from drivetool.logs import Experiment

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
