"""A folder after a command stands for the recordings in it, unless it is one data set by its own metadata."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from drivetool.errors import BadOption
from drivetool.logs import natural_order

# Files that writers of data sets leave beside the parts: Parquet's summaries, and the mark of a finished job.
DATA_SET_MARKS = ("_metadata", "_common_metadata", "_SUCCESS")
RECORDING_SUFFIXES = (".parquet", ".mcap")


def recordings_in(logs: Sequence[str]) -> list[str]:
    """The recordings that the command line names, those of a folder in the order of their names and numbers.

    raises  BadOption: a folder without recordings, or with folders of recordings, which may be of several machines
    """
    return [each for log in logs for each in (_recordings_of_folder(Path(log)) if Path(log).is_dir() else [log])]


def _recordings_of_folder(folder: Path) -> list[str]:
    if any((folder / mark).exists() for mark in DATA_SET_MARKS):
        return [str(folder)]
    found = sorted((p for p in folder.iterdir() if _is_recording(p)), key=natural_order)
    below = sorted({p.relative_to(folder).parts[0] for p in folder.rglob("*") if _is_recording(p)}
                   - {p.name for p in found})
    if below:
        raise BadOption(f"recordings of one folder in {folder}", "folders of recordings in it",
                        f"Name those that belong together, for example {folder / below[0]}.", below)
    if not found:
        raise BadOption(f"recordings in the folder {folder}", "none",
                        "Name a Parquet or MCAP file, or their folder.")
    return [str(p) for p in found]


def _is_recording(path: Path) -> bool:
    """By its name; hidden files are the file system's own."""
    return path.suffix.lower() in RECORDING_SUFFIXES and not path.name.startswith(".")
