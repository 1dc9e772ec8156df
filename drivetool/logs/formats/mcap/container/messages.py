"""Messages of an MCAP file, by topic and by block."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from mcap.records import Schema

from drivetool.logs.formats.mcap.container.offsets import Offsets
from drivetool.logs.formats.mcap.container.records import MESSAGE_HEAD_SIZE

# Messages of a topic that give its fields, one per length and block. A choice: further ones add hardly any field.
MAX_SAMPLE_MESSAGES = 16


@dataclass
class Topic:
    """One source of messages: its channels in the file, how often, and a few messages to learn from.

    topic  as the file calls it
    name   the same, or with a number where several sources have that topic
    """

    topic: str
    name: str
    encoding: str
    schema: Schema
    metadata: dict[str, str]
    channels: list[int] = field(default_factory=list)
    count: int = 0
    samples: list[bytes] = field(default_factory=list)


@dataclass(frozen=True)
class Block:
    """Messages of one chunk, in the order of the file.

    places  where they begin, with their heads; lengths (n,) of their contents
    head    (n,) structured: channel, sequence, log_time, publish_time
    only    the channel of all of them, or None where there are several
    """

    places: Offsets
    lengths: np.ndarray
    head: np.ndarray
    only: int | None

    def of(self, channels: list[int]) -> tuple[slice | np.ndarray, Offsets, np.ndarray]:
        """(which of the messages, places and lengths of their contents) of what the channels said."""
        data, starts = self.places.data, self.places.starts
        mine = _is_any_of(self.head["channel"], channels) if self.only is None else None
        if self.only in channels or (mine is not None and mine.all()):
            return slice(None), Offsets(data, starts + MESSAGE_HEAD_SIZE, self.places.stride), self.lengths
        which = np.flatnonzero(mine) if mine is not None else np.zeros(0, np.int64)
        return which, Offsets.of(data, starts[which] + MESSAGE_HEAD_SIZE), self.lengths[which]

    def content(self, index: int) -> bytes:
        """The content of one message."""
        first = int(self.places.starts[index]) + MESSAGE_HEAD_SIZE
        return self.places.data[first:first + int(self.lengths[index])].tobytes()


def _is_any_of(numbers: np.ndarray, wanted: list[int]) -> np.ndarray:
    """(n,) whether each number is one of a few; faster than np.isin for those."""
    found = np.zeros(len(numbers), bool)
    for each in wanted:
        found |= numbers == each
    return found
