"""Start and metadata of a recording, which a site needs before any step."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivetool.errors import DriveToolError
from drivetool.logs import start_date
from drivetool.logs.channels import ChannelMap
from drivetool.logs.formats.read import read_recording

# Metadata keys of the writing libraries, not of the recording.
WRITER_KEY_PREFIXES = ("ARROW:", "pandas", "org.apache.")


@dataclass(frozen=True)
class RecordingHeader:
    """Start and metadata of a recording.

    start     when it began by its own clock (UTC, ISO 8601); None: it has no absolute time, or cannot be read
    metadata  key -> text; of an MCAP metadata record also RECORD.key
    """

    start: str | None = None
    metadata: dict[str, str] = field(default_factory=dict)


def read_header(path: str | Path, channel_map: ChannelMap | None = None) -> RecordingHeader:
    """Start and metadata of a recording; of a damaged one what can be read.

    path         .parquet or .mcap
    channel_map  for the clock
    returns      Look
    """
    try:
        metadata = _mcap_metadata(path) if Path(path).suffix.lower() == ".mcap" else _parquet_metadata(path)
    except Exception:  # whatever a damaged file makes a library raise: the steps report what is wrong with it
        metadata = {}
    try:
        recording = read_recording(path, channel_map)
    except DriveToolError:
        return RecordingHeader(None, metadata)
    firsts = [float(np.nanmin(c.time)) for c in recording.channels.values() if np.isfinite(c.time).any()]
    return RecordingHeader(start_date(recording.origin + min(firsts)) if firsts else None, metadata)


def _parquet_metadata(path: str | Path) -> dict[str, str]:
    import pyarrow.parquet as pq

    metadata = pq.read_schema(path).metadata or {}
    texts = {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in metadata.items()}
    return {key: text for key, text in texts.items() if not key.startswith(WRITER_KEY_PREFIXES)}


def _mcap_metadata(path: str | Path) -> dict[str, str]:
    from mcap.reader import make_reader

    found: dict[str, str] = {}
    with open(path, "rb") as stream:
        for record in make_reader(stream).iter_metadata():
            found |= record.metadata
            found |= {f"{record.name}.{key}": text for key, text in record.metadata.items()}
    return found
