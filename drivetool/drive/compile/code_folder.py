"""The folder that stores the kernel's machine code between calls, safe from other users.

Whoever can write there controls what this process executes. On systems with POSIX owners a folder that is used has
these properties:

- it belongs to the user, and its mode lets nobody else write; new folders have mode 0700
- each folder above it belongs to the user or to root, and nobody else may write to it, unless its sticky bit
  prevents others from renaming files that are not theirs
- its path contains no symbolic link: it is resolved first, and then checked as it is used

There is no protection against root, against access lists that the mode does not show, or against files put into a
folder while its mode let others write. The last resort, a folder for one process, is as safe as the folder of
temporary files.
"""

from __future__ import annotations

import fnmatch
import hashlib
import os
import stat
import tempfile
import time
import warnings
from contextlib import suppress
from functools import cache
from pathlib import Path

from drivetool.drive.compile.lowered import SOURCES, source_digest
from drivetool.errors import DriveToolError, Notice

# Folders of other versions that prune keeps, and the age [s] below which it keeps any. A choice: a few checkouts
# share a cache, and a process of an older version may still run within a day.
MAX_OLD_FOLDERS, RECENT_USE = 3, 86400.0
PRIVATE = 0o700  # mode of new folders: only the owner may read, write or enter
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
# Root, and the id that Linux shows for owners outside of a container's user namespace, where root is one of them.
TRUSTED_OWNERS = (0, 65534)

# The marker of a folder that may be removed, in the form that backup programs know: https://bford.info/cachedir
MARKER = "CACHEDIR.TAG"
MARKER_CONTENT = b"""Signature: 8a477f597d28d172789f06886806bc55
# Machine code of drivetool's kernel. It may be deleted at any time, and is compiled again.
"""
OWN_FILES = ("*.o", "*.part", "lock", "*.lock")  # other files written here

_temporary: list[tempfile.TemporaryDirectory] = []  # removed when this process ends


def versions() -> str:
    """What machine code depends on besides its text: what emits it, and the processor."""
    import llvmlite
    from llvmlite import binding as llvm

    llvm.initialize_native_target()
    return " ".join([llvmlite.__version__, llvm.get_default_triple(), llvm.get_host_cpu_name(),
                     llvm.get_host_cpu_features().flatten()])


def folder_name(sources: Path = SOURCES) -> str:
    """Name with a hash of the versions and of the sources, for any part may call any function."""
    return "kernel-" + hashlib.sha256(f"{source_digest(sources)} {versions()}".encode()).hexdigest()[:16]


@cache
def folder() -> Path:
    """The folder for the machine code of this version.

    The first safe place: NUMBA_CACHE_DIR if it is set, else beside the sources; the user's cache; a folder of the
    user's among the temporary files, or one for this process only. A warning reports the last two, and a
    NUMBA_CACHE_DIR that is not used.

    raises  DriveToolError: no place accepts a file
    """
    name, reasons = folder_name(), []
    for place in _candidate_folders():
        problem = reason_unusable(place / name)
        if not problem:
            prune(place / name)
            if reasons and os.environ.get("NUMBA_CACHE_DIR"):
                warnings.warn(f"the compiled kernel is kept in {place}, for NUMBA_CACHE_DIR cannot be used: "
                              f"{reasons[0]}.", Notice, stacklevel=2)
            return place / name
        reasons.append(problem)
    try:
        base, remark = _temporary_base(), ""
        if problem := reason_unusable(base / name):
            reasons.append(problem)
            _temporary.append(tempfile.TemporaryDirectory(prefix="drivetool-"))
            base, remark = Path(os.path.realpath(_temporary[-1].name)), ", and compiled anew by every process"
            (base / name).mkdir(PRIVATE)
    except OSError as error:
        raise DriveToolError("a folder for the kernel's machine code", "; ".join([*reasons, str(error)]),
                             "Set NUMBA_CACHE_DIR to a folder that you alone can write to.") from None
    prune(base / name)
    warnings.warn(f"the compiled kernel is kept in {base}{remark} ({'; '.join(reasons)}). Set NUMBA_CACHE_DIR or "
                  "XDG_CACHE_HOME to a folder that you alone can write to.", Notice, stacklevel=2)
    return base / name


def _candidate_folders() -> list[Path]:
    """Folders that may hold the folders of all versions, the best first, links resolved."""
    chosen = os.environ.get("NUMBA_CACHE_DIR") or SOURCES / "__pycache__"
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    bases = [chosen, os.path.join(home, "drivetool")] if os.path.isabs(home) else [chosen]
    return [Path(os.path.realpath(base)) for base in bases]


def _temporary_base() -> Path:
    """The user's own folder among the temporary files; a link in its place is not followed."""
    user = os.geteuid() if hasattr(os, "geteuid") else "cache"
    return Path(os.path.realpath(tempfile.gettempdir())) / f"drivetool-{user}"


def reason_unusable(place: Path) -> str:
    """Why a folder cannot store machine code, empty if it can; a missing one is created, with its parents."""
    for folder in (*reversed(place.parents), place):
        try:
            if not os.path.lexists(folder):
                with suppress(FileExistsError):  # another process was faster
                    os.mkdir(folder, PRIVATE)
            problem = _status_problem(os.lstat(folder), folder == place)
        except OSError as error:
            problem = f"cannot be used: {error.strerror}"
        if problem:
            return f"{folder} {problem}"
    return "" if os.access(place, os.W_OK | os.X_OK) else f"{place} cannot be written to"


def _status_problem(status: os.stat_result, keeps_code: bool) -> str:
    """Why a folder of this status is unsafe; keeps_code: it stores the code itself."""
    if not stat.S_ISDIR(status.st_mode):
        return "is not a folder"
    if not hasattr(os, "geteuid"):
        return ""  # without POSIX owners access lists keep a user's folders private
    if status.st_uid != os.geteuid() and (keeps_code or status.st_uid not in TRUSTED_OWNERS):
        return "belongs to another user"
    if status.st_mode & OTHERS_WRITE and (keeps_code or not status.st_mode & stat.S_ISVTX):
        return "can be written to by others"
    return ""


def read_regular(place: Path) -> bytes | None:
    """The bytes of a regular file, else None: links are not followed and pipes not read."""
    how = os.O_RDONLY | sum(getattr(os, flag, 0) for flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
    with suppress(OSError):
        number = os.open(place, how)
        with os.fdopen(number, "rb") as file:
            if stat.S_ISREG(os.fstat(number).st_mode):
                return file.read()
    return None


def write_whole(place: Path, content: bytes) -> None:
    """Write a file so that a reader finds all of it or the previous one."""
    number, temporary = tempfile.mkstemp(".part", place.name, place.parent)
    try:
        with os.fdopen(number, "wb") as file:
            file.write(content)
        os.replace(temporary, place)
    except BaseException:
        with suppress(OSError):
            os.unlink(temporary)
        raise


def prune(used: Path) -> None:
    """Mark the folder of this version as in use, and remove old folders of other versions next to it.

    Another process may do the same, or still run an older version: that is no error.
    """
    with suppress(OSError):
        if not _has_marker(used):
            write_whole(used / MARKER, MARKER_CONTENT)
        os.utime(used)
        others = [(f.lstat().st_mtime, f) for f in used.parent.glob("kernel-*") if f != used and _has_marker(f)]
        for when, other in sorted(others, reverse=True)[MAX_OLD_FOLDERS:]:
            if when < time.time() - RECENT_USE:
                _remove(other)


def _has_marker(folder: Path) -> bool:
    """Whether it is a folder of the user's, no link to one, that this tool has created."""
    with suppress(OSError):
        marker = folder / MARKER
        return (not _status_problem(folder.lstat(), True) and stat.S_ISREG(marker.lstat().st_mode)
                and marker.read_bytes() == MARKER_CONTENT)
    return False


def _remove(folder: Path) -> None:
    """Remove this tool's files and then the folder; it stays, with its marker, if it holds other files."""
    for file in list(folder.iterdir()):
        if any(fnmatch.fnmatch(file.name, kind) for kind in OWN_FILES) and stat.S_ISREG(file.lstat().st_mode):
            file.unlink(missing_ok=True)
    if [f.name for f in folder.iterdir()] == [MARKER]:
        (folder / MARKER).unlink()
        folder.rmdir()
