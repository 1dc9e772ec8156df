"""Files written whole or not at all, their folders made where they are missing."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path

from drivetool.errors import BadOption, CannotWrite


def check_target(path: str | Path) -> Path:
    """The path, if a file could be written there; so that a long fit is not lost at its end.

    raises  BadOption: the folder can neither be made nor written to, or the path is a folder
    """
    path = Path(path)
    if _is_stream(path):
        return path
    folder = (Path(os.path.realpath(path)) if path.is_symlink() else path).parent
    if path.is_symlink() and not folder.is_dir():
        raise BadOption(f"an existing folder for the target of the link {path.name}", f"no folder {folder}",
                        "Correct the link, or give another path.")
    if path.is_dir():
        raise BadOption("a file name to write to", f"the folder '{path}'", "Add a file name.")
    check_folder(folder)
    return path


def check_folder(folder: str | Path) -> None:
    """Whether files could be written to a folder, which is made where it is missing.

    raises  BadOption: it, or the folder to make it in, is none or gives no right to write
    """
    existing = Path(folder)
    while not os.path.lexists(existing):
        existing = existing.parent
    if not existing.is_dir():
        raise BadOption(f"a folder {folder} to write to", f"{existing}, which is no folder", "Give another folder.")
    if not os.access(existing, os.W_OK):
        raise BadOption(f"the right to write to the folder {existing}", "none",
                        "Change its rights, or give another path.")


def make_folder(folder: str | Path) -> list[Path]:
    """Make a folder and those above it.

    returns  what was missing, the innermost first
    raises   CannotWrite: the system refuses
    """
    missing = [each for each in (Path(folder), *Path(folder).parents) if not each.exists()]
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CannotWrite(f"to make the folder {folder}", error.strerror or str(error),
                          "Check the rights and the free space, or give another path.") from error
    return missing


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write a file so that no reader ever sees half of it.

    path     target; replaced if it exists; its folder is made, and stays away if the file fails
    content  text (written as UTF-8 with \\n; bytes of a file name that are no text as \\udcff) or bytes
    raises   BadOption: see `check_target`; CannotWrite: the disk is full
    """
    path = check_target(path)
    data = encoded(content)
    temporary, made = None, []
    try:
        if _is_stream(path):
            with open(path, "wb") as stream:
                stream.write(data)
            return
        path = Path(os.path.realpath(path))  # what a link points to is replaced, not the link
        folder = path.parent
        made = make_folder(folder)
        # In the same folder, because a rename is atomic only within one file system.
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=folder)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, _file_mode(path))
        os.replace(temporary, path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            if temporary:
                os.unlink(temporary)
            for each in made:
                each.rmdir()
        if isinstance(error, OSError):
            raise CannotWrite(f"to write {path}", error.strerror or str(error),
                              "Check the rights and the free space, or give another path.") from error
        raise


def encoded(content: str | bytes) -> bytes:
    """The bytes that `write_whole` writes."""
    return content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content


def _is_stream(path: Path) -> bool:
    """Whether it is a pipe or a device, which is written to and not replaced."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _file_mode(path: Path) -> int:
    """The rights of the file replaced, or those a new file would get."""
    try:
        return path.stat().st_mode & 0o777
    except FileNotFoundError:
        mask = os.umask(0)
        os.umask(mask)
        return 0o666 & ~mask
