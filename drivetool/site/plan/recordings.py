"""The recordings of a site: found by their patterns, told apart by content, ordered within their machines."""

from __future__ import annotations

import glob
import hashlib
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

from drivetool.errors import BadParameters
from drivetool.files.disk import SUFFIXES
from drivetool.files.shapes import MachineSection, RecordingsSection, SiteFile
from drivetool.files.yaml import load_channel_map
from drivetool.logs.formats.tables import natural
from drivetool.progress import counted
from drivetool.site.plan.site_file import PLACE
from drivetool.site.results import HEAD, NAME, PAGE, SUMMARY, TABLE, TRENDS

ONE_MACHINE = "machine"  # of recordings beside the site file, where nothing says to which machine they belong


@dataclass(frozen=True)
class Recording:
    """One recording of a site.

    path     from the folder of the site file, with /
    section  of the site file that it belongs to; kind, map: as said there
    folder   of its results, from the folder of all results
    machine  empty where it cannot be told, with the reason in `problem`
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
    def look(self) -> tuple[str, str]:
        """What the look into it is known by."""
        return self.sha256 + PurePosixPath(self.path).suffix.lower(), self.map_sha256 or ""


@dataclass(frozen=True)
class Machine:
    """A machine and its recordings in their order; by_name: they have no absolute time."""

    name: str
    recordings: tuple[Recording, ...]
    by_name: bool = False


def digest(path: str | Path) -> str:
    """SHA-256 of a file."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def find(site: SiteFile, folder: Path, out: Path) -> list[Recording]:
    """The recordings of the site in the order of their paths; their content is known, their machine not yet.

    folder  of the site file; out: of the results, where no recordings are looked for
    raises  BadParameters: a pattern that matches nothing, a map that is not there or wrong
    """
    found: dict[str, RecordingsSection] = {}
    for section in site.recordings:
        paths = _matching(section.files, folder, out)
        if not paths:
            beside = f" but in that of the results, {out}" if folder.is_relative_to(out) else ""
            raise BadParameters(
                f"recordings ({', '.join(SUFFIXES)}) that match '{section.files}'",
                f"none from the folder {folder}{beside}",
                "Correct the pattern; it counts from the folder of the site file, and ** stands for any folders.")
        for path in paths:
            found.setdefault(path, section)
    maps = {section.map: _map_digest(section.map, folder) for section in site.recordings if section.map}
    paths = sorted(found, key=lambda path: natural(Path(path)))
    folders = _folders(paths)
    return [Recording(path, found[path], content_of(path, folder), maps.get(found[path].map or ""), folders[path])
            for path in counted("compare the recordings with the last run", paths, len(paths))]


def content_of(path: str, folder: Path) -> str:
    """SHA-256 of a recording; a word of its own for one that cannot be read, or whose name is no text."""
    try:
        path.encode()
        return digest(folder / path)
    except (OSError, UnicodeEncodeError):
        return f"unread {path}"


def _matching(pattern: str, folder: Path, out: Path) -> list[str]:
    """Recordings of a pattern, without those that are results of a batch.

    The name of a file that is there stands for itself, whatever signs are in it.
    """
    paths = []
    pattern = os.path.expanduser(pattern)
    one = os.path.isfile(folder / pattern)
    for each in [pattern] if one else glob.glob(pattern, root_dir=folder, recursive=True):
        full = Path(os.path.normpath(folder / each))
        if is_recording(full, folder) and not full.is_relative_to(out):
            paths.append(PurePosixPath(os.path.relpath(full, folder).replace(os.sep, "/")).as_posix())
    return paths


def is_recording(path: Path, folder: Path) -> bool:
    """Whether a path is that of a recording, by its name and what the folders up to the given one are."""
    above = [parent for parent in path.parents if parent != folder and not folder.is_relative_to(parent)]
    return (path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and path.is_file()
            and not any(map(_is_passed_over, above)))


@cache
def _is_passed_over(folder: Path) -> bool:
    """Whether a folder is what a batch has written, or a link back to a folder that it lies in."""
    if folder.is_symlink() and folder.parent.resolve().is_relative_to(folder.resolve()):
        return True
    try:
        with open(folder / NAME, "rb") as stream:
            return stream.read(len(HEAD)) == HEAD
    except OSError:
        return False


def _map_digest(name: str, folder: Path) -> str:
    """SHA-256 of a channel map that can be used."""
    try:
        sha = digest(folder / name)
    except OSError as error:
        raise BadParameters(f"to read the channel map {name}", error.strerror or str(error),
                            "Correct the path at recordings of the site file.") from None
    load_channel_map(folder / name)
    return sha


def _folders(paths: Sequence[str]) -> dict[str, str]:
    """Where the results of each recording go: its path without suffix, unless two would share that."""
    bare = {path: "/".join(part for part in PurePosixPath(path).with_suffix("").parts if part != "..")
            for path in paths}
    many = Counter([*bare.values(), NAME, SUMMARY, TABLE, PAGE, TRENDS])
    full = {path: bare[path] + (PurePosixPath(path).suffix if many[bare[path]] > 1 else "") for path in paths}
    for name, count in Counter(full.values()).items():
        if count > 1:
            raise BadParameters("recordings whose paths differ in more than the folders above",
                                " and ".join(path for path in paths if full[path] == name),
                                "Put the site file above the recordings.")
    return full


def machines_of(found: Iterable[Recording], looks: Mapping[tuple[str, str], Mapping[str, Any]],
                folders: bool) -> tuple[list[Machine], list[Recording]]:
    """(machines by name, each with its recordings in order; recordings whose machine cannot be told).

    looks    what was seen in each, by Recording.look
    folders  whether each machine has a folder of its own, named after it
    raises   BadParameters: two machines whose folders would be one
    """
    groups: dict[str, list[Recording]] = {}
    lost = []
    for recording in found:
        seen = looks.get(recording.look) or {"start": None, "metadata": {}}
        name, problem = _machine(recording, seen["metadata"])
        known = replace(recording, machine=name, start=seen["start"], problem=problem)
        if problem:
            lost.append(known)
        else:
            groups.setdefault(name, []).append(known)
    for name, count in Counter(map(safe, groups)).items() if folders else ():
        if count > 1:
            raise BadParameters("machines whose names differ in letters or digits",
                                " and ".join(sorted(n for n in groups if safe(n) == name)),
                                "Rename one of them: both would have the same folder.")
    return [_ordered(name, groups[name]) for name in sorted(groups, key=lambda n: natural(Path(n)))], lost


def safe(name: str) -> str:
    """A name as a folder may have it."""
    return "".join(c if c.isalnum() or c in " ._-" else "_" for c in name).lstrip(".") or "_"


def _ordered(name: str, recordings: Sequence[Recording]) -> Machine:
    """By start, and by name where that is equal; by name alone where one has no start: times cannot be compared."""
    timed = all(recording.start is not None for recording in recordings)

    def place(recording: Recording) -> tuple[str, list[tuple[int, str]]]:
        return recording.start or "" if timed else "", natural(Path(recording.path))

    ordered = sorted(recordings, key=place)
    return Machine(name, tuple(replace(r, order=i) for i, r in enumerate(ordered, 1)), not timed)


def _machine(recording: Recording, metadata: Mapping[str, str]) -> tuple[str, str]:
    """(name of the machine, why there is none)."""
    given, path = recording.section.machine, PurePosixPath(recording.path)
    if given is None:
        given = MachineSection(folder=1) if len(path.parts) > 1 else ONE_MACHINE
    if isinstance(given, str):
        return given.strip(), ""
    tell: tuple[str, Callable[[], str | None]]
    if given.metadata is not None:
        tell = f"the metadata '{given.metadata}'", lambda: metadata.get(given.metadata or "")
    elif given.file is not None:
        tell = f"a file name like '{given.file}'", lambda: _in_name(given.file or "", path.name)
    else:
        level = given.folder or 1
        tell = f"folder {level} above it", lambda: path.parts[-1 - level] if len(path.parts) > level else None
    name = (tell[1]() or "").strip()
    if name and name != "..":
        return name, ""
    there = f"only {', '.join(sorted(metadata)) or 'nothing'} there" if given.metadata else "none"
    there = f"'{name}'" if name else there
    return "", (f"wanted {tell[0]} to tell the machine of {recording.path}; found {there}. Correct machine at "
                "recordings of the site file, or name the machine there.")


def _in_name(pattern: str, name: str) -> str | None:
    """What stands in a file's name where the pattern has the machine; the shortest text that fits."""
    before, after = (re.escape(part).replace(r"\*", ".*").replace(r"\?", ".") for part in pattern.split(PLACE))
    match = re.fullmatch(f"{before}(?P<machine>.+?){after}", name)
    return match["machine"] if match else None
