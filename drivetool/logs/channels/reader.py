"""The protocol of a log-format reader, as drivetool.logs.door calls it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from drivetool.logs import Recording
from drivetool.logs.channels.channel_map import ChannelMap

# Given the names of all channels in a log, those to read.
Choose = Callable[[Sequence[str]], Sequence[str]]


class Reader(Protocol):
    """Reads one format; what it repairs or leaves out stands in the findings of the recording."""

    def __call__(self, path: Path, choose: Choose, channel_map: ChannelMap | None,
                 lenient: bool = False) -> Recording:
        """A log as it was.

        choose       called with the names of all channels; returns those to read
        channel_map  names the clocks, and channels that are not listed by themselves
        lenient      leave out what cannot be read instead of refusing the log
        returns      Recording without a digest
        raises       BadRecording: unreadable, nothing in it, no such channels
        """
