"""manifest.jsonl: what was done with which inputs; whole lines are appended, none is changed.

A line that a killed run left half written is cut off by the next one. Later lines win.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from drivetool.errors import BadOption, CannotWrite
from drivetool.files.disk import make_folder

NAME = "manifest.jsonl"
# What else a folder of results has for the whole site.
SUMMARY, TABLE, PAGE, TRENDS = "summary.parquet", "summary.csv", "index.html", "trends.yaml"
HEAD = b'{"schema":"drivetool/manifest/1"}\n'  # the first line says what the file is
# What a line has besides "output" or "look".
STEP = {"key", "content", "inputs", "sha256", "code", "problem", "ended", "limit", "told", "seconds",
        "peak_memory_mb"}
LOOK = {"map", "drivetool", "start", "metadata", "ended", "limit"}


@dataclass
class Manifest:
    """The lines of a manifest, and where further ones go.

    steps  path of an output from the folder of the results -> its last line
    looks  (sha256 and suffix of a recording, sha256 of its map or "") -> what was seen in it
    """

    path: Path
    steps: dict[str, dict[str, Any]] = field(default_factory=dict)
    looks: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    _stream: BinaryIO | None = None

    def append(self, line: Mapping[str, Any]) -> None:
        """Write one line, on the disk when this returns.

        raises  CannotWrite: the disk is full; what was written of the line is taken back
        """
        self._write((json.dumps(line, separators=(",", ":")) + "\n").encode())
        self._take(dict(line))

    def _write(self, data: bytes) -> None:
        assert self._stream is not None
        before = os.fstat(self._stream.fileno()).st_size
        try:
            if os.write(self._stream.fileno(), data) < len(data):
                raise OSError(28, "No space left on device")
            os.fsync(self._stream.fileno())
        except OSError as error:
            os.ftruncate(self._stream.fileno(), before)
            raise _cannot(self.path, error) from error

    def close(self) -> None:
        """Let others write."""
        if self._stream is not None:
            self._stream.close()

    def _take(self, line: dict[str, Any]) -> None:
        """A line without its fields was edited by hand: what it told is done again."""
        if "output" in line and line.keys() >= STEP:
            self.steps[line["output"]] = line
        elif "look" in line and line.keys() >= LOOK:
            self.looks[line["look"], line["map"] or ""] = line


def read_manifest(folder: Path) -> Manifest:
    """The manifest in a folder of results; without lines where there is none. Nothing is written.

    raises  BadOption: the file is no manifest of a batch
    """
    found = Manifest(folder / NAME)
    data = found.path.read_bytes() if found.path.exists() else b""
    if data[:len(HEAD)] != HEAD[:len(data)]:
        raise BadOption(f"a folder of results of batch, or a new one, at {folder}",
                        f"a {NAME} there that is none of this version of batch", "Give another folder with --out.")
    for line in _whole(data).splitlines():
        try:
            found._take(json.loads(line))
        except (ValueError, TypeError, AttributeError):  # edited by hand, too
            continue
    return found


def open_manifest(folder: Path) -> Manifest:
    """The manifest in a folder of results, open for one writer; both are made where they are missing.

    raises  BadOption: another run is writing, or the file there is none of a batch; CannotWrite: the system refuses
    """
    make_folder(folder)
    path = folder / NAME
    try:
        stream = open(path, "ab", buffering=0)  # noqa: SIM115 - closed by close()
    except OSError as error:
        raise _cannot(path, error) from error
    try:
        _lock(stream, folder)
        found = read_manifest(folder)
        os.ftruncate(stream.fileno(), len(_whole(path.read_bytes())))
        found._stream = stream
        if os.fstat(stream.fileno()).st_size == 0:
            found._write(HEAD)
    except BaseException:
        stream.close()
        raise
    return found


def _whole(data: bytes) -> bytes:
    """The bytes up to the end of the last whole line."""
    return data[:data.rfind(b"\n") + 1]


def _lock(stream: BinaryIO, folder: Path) -> None:
    """One writer at a time; the system lets go when it ends, however it ends."""
    try:
        import fcntl
    except ImportError:  # no POSIX
        return
    try:
        fcntl.flock(stream.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        raise BadOption(f"results in {folder} that no other run writes", "another batch at work there",
                        "Wait for it, or give another folder with --out.") from None


def _cannot(path: Path, error: OSError) -> CannotWrite:
    return CannotWrite(f"to write {path}", error.strerror or str(error),
                       "Make room, or give another folder with --out; what is done stays done.")
