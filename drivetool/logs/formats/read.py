"""Which reader takes a file."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from drivetool.errors import BadRecording
from drivetool.logs import Recording, display_name
from drivetool.logs.channels import ChannelMap, Choose, Reader, choose_channels


def read_mcap(path: Path, choose: Choose, channel_map: ChannelMap | None, lenient: bool = False) -> Recording:
    """See drivetool.logs.formats.mcap.read; imported here, since a Parquet log does not need it."""
    from drivetool.logs.formats.mcap import read_mcap as read

    return read(path, choose, channel_map, lenient)


def read_parquet(path: Path, choose: Choose, channel_map: ChannelMap | None, lenient: bool = False) -> Recording:
    """See drivetool.logs.formats.tables.parquet; imported here, since an MCAP log does not need it."""
    from drivetool.logs.formats.tables import read_parquet as read

    return read(path, choose, channel_map, lenient)


READERS: Mapping[str, Reader] = {".parquet": read_parquet, ".mcap": read_mcap}


def read_recording(path: str | Path, channel_map: ChannelMap | None = None,
                   choose: Choose | None = None, further: Sequence[str] = ()) -> Recording:
    """A log file as it was, with the channels that the roles need.

    path         .parquet or .mcap, or a folder of the parts of a .parquet
    channel_map  which channel plays which role; None takes channels named like the roles
    choose       other channels than those of the roles: available names -> names to read; then
                 what cannot be read is left out and reported, not refused
    further      roles that the drive has besides those of the table; without a map channels may be named like them
    returns      Recording
    raises       BadRecording: no such file, wrong suffix, empty, unreadable, no such channels
    """
    path = Path(path)
    path = path if path.name else path.resolve()  # `.` has no name of its own
    if not path.exists():
        raise BadRecording("a recording", f"no file {path}", "Check the path.")
    kind = ".parquet" if path.is_dir() else path.suffix.lower()
    if kind not in READERS:
        raise BadRecording("a recording with a known suffix", display_name(path),
                           "Export the log to Parquet or MCAP.", READERS)
    if not path.is_dir() and path.stat().st_size == 0:
        raise BadRecording(f"data in {display_name(path)}", "an empty file", "Record or export it again.")

    def of_roles(available: Sequence[str]) -> Sequence[str]:
        return list(choose_channels(available, channel_map, display_name(path), further).values())

    with ThreadPoolExecutor(1) as pool:
        # Beside the reading: it takes a quarter of the time, and both let go of the interpreter.
        sha256 = pool.submit(_file_digest, path)
        recording = READERS[kind](path, choose or of_roles, channel_map, lenient=choose is not None)
        return replace(recording, sha256=sha256.result())


def _file_digest(path: Path) -> str:
    """SHA-256 of a file; of a folder, that of the digests of its parts by name."""
    if path.is_dir():
        parts = sorted(path.rglob("*.parquet"))
        return hashlib.sha256("".join(f"{part.relative_to(path).as_posix()} {_file_digest(part)}\n"
                                      for part in parts).encode()).hexdigest()
    return file_sha256(path)


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
