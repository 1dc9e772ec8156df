"""manifest.jsonl: the tasks with their inputs; whole lines are appended, none is changed.

A line that a killed run left incomplete is removed by the next run. Later lines replace earlier ones.
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

MANIFEST_FILE = "manifest.jsonl"
# Further files of the whole site in a folder of results.
SUMMARY_PARQUET, SUMMARY_CSV, OVERVIEW_PAGE, TRENDS_FILE = (
    "summary.parquet", "summary.csv", "index.html", "trends.yaml")
MANIFEST_FIRST_LINE = b'{"schema":"drivetool/manifest/1"}\n'  # the first line identifies the file
# Fields of a line besides "output" or "look".
STEP_LINE_KEYS = {"key", "content", "inputs", "sha256", "code", "problem", "ended", "limit", "told", "seconds",
                  "peak_memory_mb"}
HEADER_LINE_KEYS = {"map", "drivetool", "start", "metadata", "ended", "limit"}


@dataclass
class Manifest:
    """The lines of a manifest, and the stream for further ones.

    steps  path of an output from the folder of the results -> its last line
    headers  (sha256 and suffix of a recording, sha256 of its map or "") -> its header
    """

    path: Path
    steps: dict[str, dict[str, Any]] = field(default_factory=dict)
    headers: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    _stream: BinaryIO | None = None

    def append(self, line: Mapping[str, Any]) -> None:
        """Write one line; it is on the disk when this returns.

        raises  CannotWrite: the disk is full; the incomplete line is removed
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
            raise _write_error(self.path, error) from error

    def close(self) -> None:
        """Release the file for other writers."""
        if self._stream is not None:
            self._stream.close()

    def _take(self, line: dict[str, Any]) -> None:
        """Index a line; one with missing fields was edited by hand, and its task is run again."""
        if "output" in line and line.keys() >= STEP_LINE_KEYS:
            self.steps[line["output"]] = line
        elif "look" in line and line.keys() >= HEADER_LINE_KEYS:
            self.headers[line["look"], line["map"] or ""] = line


def read_manifest(folder: Path) -> Manifest:
    """The manifest in a folder of results; without lines where there is none. Nothing is written.

    raises  BadOption: the file is no manifest of a batch
    """
    manifest = Manifest(folder / MANIFEST_FILE)
    data = manifest.path.read_bytes() if manifest.path.exists() else b""
    if data[:len(MANIFEST_FIRST_LINE)] != MANIFEST_FIRST_LINE[:len(data)]:
        raise BadOption(f"a folder of results of batch, or a new one, at {folder}",
                        f"a {MANIFEST_FILE} there that this version of batch did not write",
                        "Give another folder with --out.")
    for line in _complete_lines(data).splitlines():
        try:
            manifest._take(json.loads(line))
        except (ValueError, TypeError, AttributeError):  # edited by hand as well
            continue
    return manifest


def open_manifest(folder: Path) -> Manifest:
    """The manifest in a folder of results, open for one writer; both are created if missing.

    raises  BadOption: another run is writing, or the file there is none of a batch; CannotWrite: the system refuses
    """
    make_folder(folder)
    path = folder / MANIFEST_FILE
    try:
        stream = open(path, "ab", buffering=0)  # noqa: SIM115 - closed by close()
    except OSError as error:
        raise _write_error(path, error) from error
    try:
        _lock_for_writing(stream, folder)
        manifest = read_manifest(folder)
        os.ftruncate(stream.fileno(), len(_complete_lines(path.read_bytes())))
        manifest._stream = stream
        if os.fstat(stream.fileno()).st_size == 0:
            manifest._write(MANIFEST_FIRST_LINE)
    except BaseException:
        stream.close()
        raise
    return manifest


def _complete_lines(data: bytes) -> bytes:
    """The bytes up to the end of the last whole line."""
    return data[:data.rfind(b"\n") + 1]


def _lock_for_writing(stream: BinaryIO, folder: Path) -> None:
    """One writer at a time; the system releases the lock when the process ends."""
    try:
        import fcntl
    except ImportError:  # no POSIX
        return
    try:
        fcntl.flock(stream.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        raise BadOption(f"results in {folder} that no other run writes", "another batch running there",
                        "Wait for it, or give another folder with --out.") from None


def _write_error(path: Path, error: OSError) -> CannotWrite:
    return CannotWrite(f"to write {path}", error.strerror or str(error),
                       "Make room, or give another folder with --out; completed steps are kept.")
