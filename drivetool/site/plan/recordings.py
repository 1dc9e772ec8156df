"""The recordings of a site: found by their patterns, identified by content, ordered within their machines."""

from __future__ import annotations

import glob
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

from drivetool.errors import BadParameters
from drivetool.files.disk import RECORDING_SUFFIXES
from drivetool.files.shapes import MachineSection, RecordingsSection, SiteFile
from drivetool.files.yaml import load_channel_map
from drivetool.logs import natural_order
from drivetool.logs.formats import file_sha256
from drivetool.progress import counted
from drivetool.site.plan.site_file import MACHINE_PLACEHOLDER
from drivetool.site.results import (
    MANIFEST_FILE,
    MANIFEST_FIRST_LINE,
    OVERVIEW_PAGE,
    SUMMARY_CSV,
    SUMMARY_PARQUET,
    TRENDS_FILE,
)

DEFAULT_MACHINE = "machine"  # of recordings beside the site file without the name of a machine


@dataclass(frozen=True)
class Recording:
    """One recording of a site.

    path     from the folder of the site file, with /
    section  of the site file that it belongs to; kind, map: as said there
    folder   of its results, from the folder of all results
    machine  empty where it is unknown, with the reason in `problem`
    start    when it began (UTC, ISO 8601), None without absolute time
    order    place in the machine's order, from one
    """

    path: str
    section: RecordingsSection
    sha256: str
    map_sha256: str | None
    folder: str
    machine: str = ""
    start: str | None = None
    order: int = 0
    problem: str = ""

    @property
    def kind(self) -> str:
        """What was recorded."""
        return self.section.kind

    @property
    def header_key(self) -> tuple[str, str]:
        """The key of its header in the manifest."""
        return self.sha256 + PurePosixPath(self.path).suffix.lower(), self.map_sha256 or ""


@dataclass(frozen=True)
class Machine:
    """A machine and its recordings in their order; by_name: they have no absolute time."""

    name: str
    recordings: tuple[Recording, ...]
    by_name: bool = False


def find_recordings(site: SiteFile, folder: Path, out: Path) -> list[Recording]:
    """The recordings of the site in the order of their paths; their content is known, their machine not yet.

    folder  of the site file; out: of the results, which is not searched
    raises  BadParameters: a pattern that matches nothing, a map that is not there or wrong
    """
    found: dict[str, RecordingsSection] = {}
    for section in site.recordings:
        paths = _paths_matching(section.files, folder, out)
        if not paths:
            beside = f" but in that of the results, {out}" if folder.is_relative_to(out) else ""
            raise BadParameters(
                f"recordings ({', '.join(RECORDING_SUFFIXES)}) that match '{section.files}'",
                f"none from the folder {folder}{beside}",
                "Correct the pattern; it counts from the folder of the site file, and ** stands for any folders.")
        for path in paths:
            found.setdefault(path, section)
    maps = {section.map: _map_sha256(section.map, folder) for section in site.recordings if section.map}
    paths = sorted(found, key=lambda path: natural_order(Path(path)))
    folders = _result_folders(paths)
    return [Recording(path, found[path], recording_sha256(path, folder), maps.get(found[path].map or ""),
                      folders[path])
            for path in counted("compare the recordings with the last run", paths, len(paths))]


def recording_sha256(path: str, folder: Path) -> str:
    """SHA-256 of a recording; a unique word for one that cannot be read, or whose name is not valid text."""
    try:
        path.encode()
        return file_sha256(folder / path)
    except (OSError, UnicodeEncodeError):
        return f"unread {path}"


def _paths_matching(pattern: str, folder: Path, out: Path) -> list[str]:
    """Recordings of a pattern, without those that are results of a batch.

    The name of an existing file is taken literally, even with wildcard characters.
    """
    paths = []
    pattern = os.path.expanduser(pattern)
    is_file = os.path.isfile(folder / pattern)
    for each in [pattern] if is_file else glob.glob(pattern, root_dir=folder, recursive=True):
        full = Path(os.path.normpath(folder / each))
        if is_recording(full, folder) and not full.is_relative_to(out):
            paths.append(PurePosixPath(os.path.relpath(full, folder).replace(os.sep, "/")).as_posix())
    return paths


def is_recording(path: Path, folder: Path) -> bool:
    """Whether a path is that of a recording, by its name and the kind of the folders above it."""
    above = [parent for parent in path.parents if parent != folder and not folder.is_relative_to(parent)]
    return (path.suffix.lower() in RECORDING_SUFFIXES and not path.name.startswith(".") and path.is_file()
            and not any(map(_is_results_or_loop, above)))


@cache
def _is_results_or_loop(folder: Path) -> bool:
    """Whether a folder has results of a batch, or is a link to one of its parent folders."""
    if folder.is_symlink() and folder.parent.resolve().is_relative_to(folder.resolve()):
        return True
    try:
        with open(folder / MANIFEST_FILE, "rb") as stream:
            return stream.read(len(MANIFEST_FIRST_LINE)) == MANIFEST_FIRST_LINE
    except OSError:
        return False


def _map_sha256(name: str, folder: Path) -> str:
    """SHA-256 of a valid channel map."""
    sha = named_sha256(folder / name, f"to read the channel map {name}",
                       "Correct the path at recordings of the site file.")
    load_channel_map(folder / name)
    return sha


def named_sha256(path: Path, wanted: str, action: str) -> str:
    """SHA-256 of a file that the site file names.

    raises  BadParameters: it cannot be read
    """
    try:
        return file_sha256(path)
    except OSError as error:
        raise BadParameters(wanted, error.strerror or str(error), action) from None


def _result_folders(paths: Sequence[str]) -> dict[str, str]:
    """The folder of the results of each recording: its path without suffix, unless two would share it."""
    without_suffix = {path: "/".join(part for part in PurePosixPath(path).with_suffix("").parts if part != "..")
            for path in paths}
    name_counts = Counter([*without_suffix.values(), MANIFEST_FILE, SUMMARY_PARQUET, SUMMARY_CSV, OVERVIEW_PAGE,
                           TRENDS_FILE])
    folders = {path: bare + (PurePosixPath(path).suffix if name_counts[bare] > 1 else "")
               for path, bare in without_suffix.items()}
    for name, count in Counter(folders.values()).items():
        if count > 1:
            raise BadParameters("recordings whose paths still differ without their '..' parts",
                                " and ".join(path for path in paths if folders[path] == name),
                                "Put the site file above the recordings.")
    return folders


def machines_of(found: Iterable[Recording], headers: Mapping[tuple[str, str], Mapping[str, Any]],
                own_folders: bool) -> tuple[list[Machine], list[Recording]]:
    """(machines by name, each with its recordings in order; recordings whose machine is unknown).

    headers  start and metadata of each, by Recording.header_key
    own_folders  whether each machine has its own folder, named after it
    raises   BadParameters: two machines whose folders would be one
    """
    groups: dict[str, list[Recording]] = {}
    without_machine = []
    for recording in found:
        header = headers.get(recording.header_key) or {"start": None, "metadata": {}}
        name, problem = _machine_name(recording, header["metadata"])
        placed = replace(recording, machine=name, start=header["start"], problem=problem)
        if problem:
            without_machine.append(placed)
        else:
            groups.setdefault(name, []).append(placed)
    for name, count in Counter(map(safe_folder_name, groups)).items() if own_folders else ():
        if count > 1:
            raise BadParameters("machines whose names differ in more than special characters",
                                " and ".join(sorted(n for n in groups if safe_folder_name(n) == name)),
                                "Rename one of them: both would have the same folder.")
    return [_in_order(name, groups[name])
            for name in sorted(groups, key=lambda n: natural_order(Path(n)))], without_machine


def safe_folder_name(name: str) -> str:
    """A name without the characters that a folder may not have."""
    return "".join(c if c.isalnum() or c in " ._-" else "_" for c in name).lstrip(".") or "_"


def _in_order(name: str, recordings: Sequence[Recording]) -> Machine:
    """By start, and by name where that is equal; by name alone where one has no start."""
    timed = all(recording.start is not None for recording in recordings)

    def place(recording: Recording) -> tuple[str, list[tuple[int, str]]]:
        return recording.start or "" if timed else "", natural_order(Path(recording.path))

    ordered = sorted(recordings, key=place)
    return Machine(name, tuple(replace(r, order=i) for i, r in enumerate(ordered, 1)), not timed)


def _machine_name(recording: Recording, metadata: Mapping[str, str]) -> tuple[str, str]:
    """(name of the machine, why there is none)."""
    section, path = recording.section.machine, PurePosixPath(recording.path)
    if section is None:
        section = MachineSection(folder=1) if len(path.parts) > 1 else DEFAULT_MACHINE
    if isinstance(section, str):
        return section.strip(), ""
    source: tuple[str, Callable[[], str | None]]
    if section.metadata is not None:
        source = f"the metadata '{section.metadata}'", lambda: metadata.get(section.metadata or "")
    elif section.file is not None:
        source = f"a file name like '{section.file}'", lambda: _machine_in_file_name(section.file or "", path.name)
    else:
        level = section.folder or 1
        source = f"folder {level} above it", lambda: path.parts[-1 - level] if len(path.parts) > level else None
    name = (source[1]() or "").strip()
    if name and name != "..":
        return name, ""
    available = f"only {', '.join(sorted(metadata)) or 'nothing'} there" if section.metadata else "none"
    available = f"'{name}'" if name else available
    return "", (f"wanted {source[0]} to name the machine of {recording.path}; found {available}. Correct machine "
                "at recordings of the site file, or name the machine there.")


def _machine_in_file_name(pattern: str, name: str) -> str | None:
    """The shortest text in a file's name that fits the place of the machine in the pattern."""
    before, after = (re.escape(part).replace(r"\*", ".*").replace(r"\?", ".")
                     for part in pattern.split(MACHINE_PLACEHOLDER))
    match = re.fullmatch(f"{before}(?P<machine>.+?){after}", name)
    return match["machine"] if match else None
