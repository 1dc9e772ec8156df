"""What a site wants to know of a recording before any step: when it began, and what is noted in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivetool.errors import DriveToolError
from drivetool.logs import began
from drivetool.logs.channels import ChannelMap
from drivetool.logs.formats.read import read_recording

# Of the writers, not of the recording.
OF_THE_WRITER = ("ARROW:", "pandas", "org.apache.")


@dataclass(frozen=True)
class Look:
    """What was seen in a recording.

    start     when it began by its own clock (UTC, ISO 8601); None: it has no absolute time, or cannot be read
    metadata  key -> text; of an MCAP metadata record also RECORD.key
    """

    start: str | None = None
    metadata: dict[str, str] = field(default_factory=dict)


def look_at(path: str | Path, channel_map: ChannelMap | None = None) -> Look:
    """Start and metadata of a recording; of a damaged one what can be read.

    path         .parquet or .mcap
    channel_map  for the clock
    returns      Look
    """
    try:
        metadata = _of_mcap(path) if Path(path).suffix.lower() == ".mcap" else _of_parquet(path)
    except Exception:  # whatever a damaged file makes a library raise: the steps will say what is wrong with it
        metadata = {}
    try:
        recording = read_recording(path, channel_map)
    except DriveToolError:
        return Look(None, metadata)
    firsts = [float(np.nanmin(c.time)) for c in recording.channels.values() if np.isfinite(c.time).any()]
    return Look(began(recording.origin + min(firsts)) if firsts else None, metadata)


def _of_parquet(path: str | Path) -> dict[str, str]:
    import pyarrow.parquet as pq

    noted = pq.read_schema(path).metadata or {}
    texts = {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in noted.items()}
    return {key: text for key, text in texts.items() if not key.startswith(OF_THE_WRITER)}


def _of_mcap(path: str | Path) -> dict[str, str]:
    from mcap.reader import make_reader

    found: dict[str, str] = {}
    with open(path, "rb") as stream:
        for record in make_reader(stream).iter_metadata():
            found |= record.metadata
            found |= {f"{record.name}.{key}": text for key, text in record.metadata.items()}
    return found
