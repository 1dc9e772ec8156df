"""The folder that keeps the kernel's machine code between calls, safe from other users.

Whoever can write there decides what this process executes. On systems with POSIX owners these things are
guaranteed of a folder that is used:

- it belongs to the user, and its mode lets nobody else write; what is created here has mode 0700
- each folder above it belongs to the user or to root, and nobody else may write to it, unless its sticky bit
  keeps others from renaming what is not theirs
- no symbolic link lies on the way: the path is resolved first, and then checked as it is used

Not guaranteed: anything against root, against access lists that the mode does not show, or against what was put
into a folder while its mode still let others write. The last resort, a folder for one process, is as safe as the
folder of temporary files.
"""

from __future__ import annotations

import fnmatch
import hashlib
import importlib.util
import os
import stat
import sys
import tempfile
import time
import warnings
from contextlib import suppress
from functools import cache
from pathlib import Path

import llvmlite
from llvmlite import binding as llvm

from drivetool.errors import DriveToolError, Notice

KEPT, DAY = 3, 86400.0  # other versions' folders that stay, and any that was in use within a day [s]
PRIVATE = 0o700
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
# Root, and the id that Linux shows for owners outside of a container's user namespace, where root is one of them.
ABOVE_USERS = (0, 65534)

# The marker of a folder that may be removed, in the form that backup programs know: https://bford.info/cachedir
MARKER = "CACHEDIR.TAG"
MARK = b"""Signature: 8a477f597d28d172789f06886806bc55
# Machine code of drivetool's kernel. It may be deleted at any time, and is compiled again.
"""
OURS = ("*.o", "*.part", "lock", "*.code")  # other files written here; the last for tune
# The folders in which it does so. Numba names them after the folder of the function: of older versions, and now.
OF_NUMBA = ("tune_*", "speed_loop_*")

# What is compiled lies below it, and in its own cache the machine code is kept first.
SOURCES = Path(importlib.util.find_spec("drivetool.drive").submodule_search_locations[0])

_temporary: list[tempfile.TemporaryDirectory] = []  # gone when this process ends


def versions() -> str:
    """What machine code depends on besides its sources: the compiler, Python, and the processor."""
    llvm.initialize_native_target()
    return " ".join([_numba_version(), llvmlite.__version__, sys.implementation.cache_tag,
                     llvm.get_default_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()])


def _numba_version() -> str:
    """The text from which Numba takes its version: to import Numba, or importlib.metadata, takes far longer."""
    spec = importlib.util.find_spec("numba")
    with suppress(OSError):
        if spec is not None and spec.origin:
            return Path(spec.origin).with_name("_version.py").read_text(encoding="utf-8")
    from importlib import metadata

    with suppress(metadata.PackageNotFoundError):
        return metadata.version("numba")
    return ""


def folder_name() -> str:
    """Carries a hash of all sources of the kernel, for any part may call any function, and of the versions."""
    sources = b"".join(file.read_bytes() for file in sorted(SOURCES.rglob("*.py")))
    return "kernel-" + hashlib.sha256(sources + versions().encode()).hexdigest()[:16]


@cache
def folder() -> Path:
    """Where the machine code of this version is kept.

    The first place that is safe: NUMBA_CACHE_DIR if it is set, else beside the sources; the user's cache; a folder
    of the user's among the temporary files, or one for this process only. A warning tells of the last two, and of a
    NUMBA_CACHE_DIR that is passed over.

    raises  DriveToolError: no place takes a file
    """
    name, refused = folder_name(), []
    for place in _places():
        why = obstacle(place / name)
        if not why:
            prune(place / name)
            if refused and os.environ.get("NUMBA_CACHE_DIR"):
                warnings.warn(f"the compiled kernel is kept in {place}, for NUMBA_CACHE_DIR cannot be used: "
                              f"{refused[0]}.", Notice, stacklevel=2)
            return place / name
        refused.append(why)
    try:
        base, how = _temporary_base(), ""
        if why := obstacle(base / name):
            refused.append(why)
            _temporary.append(tempfile.TemporaryDirectory(prefix="drivetool-"))
            base, how = Path(os.path.realpath(_temporary[-1].name)), ", and compiled anew by every process"
            (base / name).mkdir(PRIVATE)
    except OSError as error:
        raise DriveToolError("a folder for the kernel's machine code", "; ".join([*refused, str(error)]),
                             "Set NUMBA_CACHE_DIR to a folder that you alone can write to.") from None
    prune(base / name)
    warnings.warn(f"the compiled kernel is kept in {base}{how} ({'; '.join(refused)}). Set NUMBA_CACHE_DIR or "
                  "XDG_CACHE_HOME to a folder that you alone can write to.", Notice, stacklevel=2)
    return base / name


def _places() -> list[Path]:
    """Folders that keep those of all versions, the best first, without links."""
    chosen = os.environ.get("NUMBA_CACHE_DIR") or SOURCES / "__pycache__"
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    bases = [chosen, os.path.join(home, "drivetool")] if os.path.isabs(home) else [chosen]
    return [Path(os.path.realpath(base)) for base in bases]


def _temporary_base() -> Path:
    """The user's own folder among the temporary files; a link in its place is not followed."""
    user = os.geteuid() if hasattr(os, "geteuid") else "cache"
    return Path(os.path.realpath(tempfile.gettempdir())) / f"drivetool-{user}"


def obstacle(place: Path) -> str:
    """Why a folder cannot keep machine code, empty if it can; made, with those above, where it is missing."""
    for folder in (*reversed(place.parents), place):
        try:
            if not os.path.lexists(folder):
                with suppress(FileExistsError):  # another process was faster
                    os.mkdir(folder, PRIVATE)
            why = _refused(os.lstat(folder), folder == place)
        except OSError as error:
            why = f"cannot be used: {error.strerror}"
        if why:
            return f"{folder} {why}"
    return "" if os.access(place, os.W_OK | os.X_OK) else f"{place} cannot be written to"


def _refused(status: os.stat_result, last: bool) -> str:
    """What is wrong with a folder of this status; last: it keeps the code itself."""
    if not stat.S_ISDIR(status.st_mode):
        return "is not a folder"
    if not hasattr(os, "geteuid"):
        return ""  # there a user's folders are private by their access lists
    if status.st_uid != os.geteuid() and (last or status.st_uid not in ABOVE_USERS):
        return "belongs to another user"
    if status.st_mode & OTHERS_WRITE and (last or not status.st_mode & stat.S_ISVTX):
        return "can be written to by others"
    return ""


def read_regular(place: Path) -> bytes | None:
    """The bytes of a regular file, else None: a link is not followed, a pipe not waited for."""
    how = os.O_RDONLY | sum(getattr(os, flag, 0) for flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
    with suppress(OSError):
        number = os.open(place, how)
        with os.fdopen(number, "rb") as file:
            if stat.S_ISREG(os.fstat(number).st_mode):
                return file.read()
    return None


def write_whole(place: Path, content: bytes) -> None:
    """Write a file so that whoever reads it finds all of it or the one before."""
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
    """Mark the folder of this version as ours and in use, and remove those of versions long gone beside it.

    Another process may do the same, or still run an older version: that is no error.
    """
    with suppress(OSError):
        if not _marked(used):
            write_whole(used / MARKER, MARK)
        os.utime(used)
        others = [(f.lstat().st_mtime, f) for f in used.parent.glob("kernel-*") if f != used and _marked(f)]
        for when, other in sorted(others, reverse=True)[KEPT:]:
            if when < time.time() - DAY:
                _remove(other)


def _marked(folder: Path) -> bool:
    """Whether it is a folder of the user's, no link to one, that this tool has made."""
    with suppress(OSError):
        marker = folder / MARKER
        return (not _refused(folder.lstat(), True) and stat.S_ISREG(marker.lstat().st_mode)
                and marker.read_bytes() == MARK)
    return False


def _remove(folder: Path) -> None:
    """Remove a folder with what is ours in it; one that holds anything else stays, with that and the marker."""
    inner = [f for kind in OF_NUMBA for f in folder.glob(kind) if stat.S_ISDIR(f.lstat().st_mode)]
    for place in (*inner, folder):
        for file in list(place.iterdir()):
            if any(fnmatch.fnmatch(file.name, kind) for kind in OURS) and stat.S_ISREG(file.lstat().st_mode):
                file.unlink(missing_ok=True)
        if place in inner and not any(place.iterdir()):
            place.rmdir()
    if [f.name for f in folder.iterdir()] == [MARKER]:
        (folder / MARKER).unlink()
        folder.rmdir()
