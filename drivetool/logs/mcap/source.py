"""An MCAP file as topics and, block by block, the messages in it."""

from __future__ import annotations

import mmap
import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from drivetool.errors import BadRecording
from drivetool.logs.mcap import container
from drivetool.logs.mcap.container import CHANNEL, CHUNK, HEAD, MESSAGE, SCHEMA, Records
from drivetool.logs.mcap.places import Places
from drivetool.logs.mcap.room import Room

# Unpacked chunks up to this size are kept from the first pass to the second.
KEPT = 1 << 28
# Messages of a topic that are looked at to learn which fields it has, one per length and block.
SAMPLES = 16


@dataclass(frozen=True)
class Schema:
    """What a topic's messages look like; encoding and content as in the file."""

    name: str = ""
    encoding: str = ""
    content: bytes = b""


@dataclass
class Topic:
    """A topic: its channels in the file, how often, and a few messages to learn from."""

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

    places: Places
    lengths: np.ndarray
    head: np.ndarray
    only: int | None

    def of(self, channels: list[int]) -> tuple[slice | np.ndarray, Places, np.ndarray]:
        """(which of the messages, places and lengths of their contents) of what the channels said."""
        data, starts = self.places.data, self.places.starts
        mine = _among(self.head["channel"], channels) if self.only is None else None
        if self.only in channels or (mine is not None and mine.all()):
            return slice(None), Places(data, starts + HEAD, self.places.stride), self.lengths
        which = np.flatnonzero(mine) if mine is not None else np.zeros(0, np.int64)
        return which, Places.of(data, starts[which] + HEAD), self.lengths[which]

    def content(self, index: int) -> bytes:
        """The content of one message."""
        first = int(self.places.starts[index]) + HEAD
        return self.places.data[first:first + int(self.lengths[index])].tobytes()


class Source:
    """An opened MCAP file. `topics`: those with messages; `damage`: what was wrong, in order."""

    def __init__(self, path: Path):
        """Map the file and look through all of it; BadRecording if it is not MCAP at all."""
        self.path, self.damage = path, []
        self.topics: dict[str, Topic] = {}
        self._schemas: dict[int, Schema] = {0: Schema()}
        self._channels: dict[int, Topic] = {}
        self._described = np.zeros(1 << 16, bool)
        self._kept: list[Block] | None = []
        with path.open("rb") as file:
            self._bytes = np.frombuffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), np.uint8)
        if self._bytes[:8].tobytes() != container.MAGIC:
            if container.MAGIC.startswith(self._bytes[:8].tobytes()):
                raise BadRecording(f"messages in {path.name}", "only the beginning of an MCAP file",
                                   "Record or export it again.")
            raise BadRecording(f"an MCAP file in {path.name}", "something else", "Record or export it again.")
        self._top = container.walk(self._bytes, 8)
        kept, size = [], 0
        for block in self._read(self.damage):
            self._count(block)
            size += len(block.places.data)
            if self._kept is not None:
                kept.append(block)
            if size > KEPT:
                self._kept, kept = None, []
        if self._kept is not None:
            self._kept = kept
        self._note_end()
        self.topics = {name: topic for name, topic in self.topics.items() if topic.count}

    @property
    def count(self) -> int:
        """Messages that can be read."""
        return sum(topic.count for topic in self.topics.values())

    def blocks(self) -> Iterator[Block]:
        """The blocks with messages once more."""
        return iter(self._kept) if self._kept is not None else self._read([])

    def _read(self, damage: list[str]) -> Iterator[Block]:
        """Block by block through the file; notes what is damaged."""
        top = self._top
        loose = np.flatnonzero(top.code == MESSAGE)
        opened = _ahead(partial(container.open_chunk, room=Room()),
                        map(top.content, np.flatnonzero(top.code == CHUNK)))
        for index in np.flatnonzero(top.code != MESSAGE):
            code = int(top.code[index])
            if code == CHUNK:
                data, problem = next(opened)
                yield from self._chunk(data, problem, damage)
            elif code in (SCHEMA, CHANNEL):
                self._learn(code, top.content(index), damage)
        if len(loose):
            yield self._block(top, loose, damage)
        if top.end + 9 <= len(self._bytes) and self._bytes[top.end] == CHUNK:
            data, _ = container.open_chunk(memoryview(self._bytes)[top.end + 9:], cut=True)
            yield from self._chunk(data, "", [])

    def _chunk(self, data: np.ndarray, problem: str, damage: list[str]) -> Iterator[Block]:
        """The block in an unpacked chunk."""
        if problem:
            damage.append(problem)
            return
        records = container.walk(data)
        if not records.whole:
            damage.append("a chunk that ends within a record")
        for index in np.flatnonzero((records.code == SCHEMA) | (records.code == CHANNEL)):
            self._learn(int(records.code[index]), records.content(index), damage)
        which = np.flatnonzero(records.code == MESSAGE)
        if len(which):
            yield self._block(records, which, damage)

    def _block(self, records: Records, which: np.ndarray, damage: list[str]) -> Block:
        """Messages with a whole head and a known channel."""
        whole = records.length[which] >= HEAD
        if not whole.all():
            damage.append("messages without a head")
            which = which[whole]
        everything = len(which) == len(records.start)
        places = Places.of(records.data, records.start if everything else records.start[which])
        head = places.read(0, container.HEADS)
        numbers = head["channel"]
        only = int(numbers[0]) if len(numbers) and np.all(numbers == numbers[0]) else None
        if not np.all(self._described[numbers if only is None else only]):
            damage.append("messages of a channel that is nowhere described")
        return Block(places, (records.length if everything else records.length[which]) - HEAD, head, only)

    def _learn(self, code: int, content: memoryview, damage: list[str]) -> None:
        """Remember a schema or a channel."""
        try:
            number = struct.unpack_from("<H", content, 0)[0]
            if code == SCHEMA:
                name, at = container.text_at(content, 2)
                encoding, at = container.text_at(content, at)
                size = struct.unpack_from("<I", content, at)[0]
                self._schemas.setdefault(number, Schema(name, encoding, bytes(content[at + 4:at + 4 + size])))
            elif number not in self._channels:
                self._add_channel(number, content)
        except (struct.error, ValueError):
            damage.append(f"a broken {'schema' if code == SCHEMA else 'channel'}")

    def _add_channel(self, number: int, content: memoryview) -> None:
        """Several publishers of one topic are one, unless their messages are of another kind."""
        schema = self._schemas.get(struct.unpack_from("<H", content, 2)[0], Schema())
        name, at = container.text_at(content, 4)
        encoding, at = container.text_at(content, at)
        end, metadata = at + 4 + struct.unpack_from("<I", content, at)[0], {}
        at += 4
        while at < end:
            key, at = container.text_at(content, at)
            metadata[key], at = container.text_at(content, at)
        known = self.topics.get(name)
        if known and (known.encoding, known.schema) != (encoding, schema):
            name = f"{name}#{number}"
        topic = self.topics.setdefault(name, Topic(name, encoding, schema, metadata))
        topic.channels.append(number)
        self._channels[number] = topic
        self._described[number] = True

    def _count(self, block: Block) -> None:
        """Count messages per topic, and take one of each as a sample."""
        numbers = block.head["channel"]
        if not len(numbers):
            return
        counts = dict(enumerate(np.bincount(numbers).tolist())) if block.only is None \
            else {block.only: len(numbers)}
        for number, count in counts.items():
            topic = self._channels.get(number)
            if topic is None or not count:
                continue
            topic.count += count
            if len(topic.samples) < SAMPLES:
                mine = np.flatnonzero(numbers == number)
                topic.samples += [block.content(index) for index in
                                  mine[_firsts(block.lengths[mine])][:SAMPLES - len(topic.samples)]]

    def _note_end(self) -> None:
        """Whether the file ends as it should."""
        top = self._top
        closed = self._bytes[-8:].tobytes() == container.MAGIC and top.end == len(self._bytes) - 8
        if not closed:
            left = len(self._bytes) - top.end
            self.damage.append(f"it stops within a record at byte {top.end}, {left} bytes before its end"
                               if left else "it has no end mark, as if the recorder was stopped hard")


def _ahead(work: Callable, items: Iterable, ahead: int = 4) -> Iterator:
    """The results of `work` in order, made by a thread that runs a little ahead."""
    with ThreadPoolExecutor(1) as pool:
        waiting = deque()
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _firsts(lengths: np.ndarray) -> np.ndarray:
    """Where each length occurs first, in order; nearly always there is one length, which needs no sorting."""
    if lengths[0] == lengths[-1] and np.all(lengths == lengths[0]):
        return np.zeros(1, np.int64)
    return np.sort(np.unique(lengths, return_index=True)[1])


def _among(numbers: np.ndarray, wanted: list[int]) -> np.ndarray:
    """(n,) whether each number is one of a few; faster than np.isin for those."""
    found = np.zeros(len(numbers), bool)
    for each in wanted:
        found |= numbers == each
    return found
