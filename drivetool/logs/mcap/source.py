"""An MCAP file as topics and, block by block, the messages in it."""

from __future__ import annotations

import mmap
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from mcap.records import Channel, Schema

from drivetool.errors import BadRecording
from drivetool.logs.mcap import container
from drivetool.logs.mcap.container import CHANNEL, CHUNK, HEAD, MAGIC, RECORD_HEAD, SCHEMA, Records
from drivetool.logs.mcap.places import Places
from drivetool.logs.mcap.room import Room

NO_SCHEMA = Schema(0, b"", "", "")
# Unpacked chunks up to this size are kept from the first pass to the second.
KEPT = 1 << 28
# Messages of a topic that are looked at to learn which fields it has, one per length and block.
SAMPLES = 16


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
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Topic] = {}
        with path.open("rb") as file:
            mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        if mapped[:len(MAGIC)] != MAGIC:
            if MAGIC.startswith(mapped[:len(MAGIC)]):
                raise BadRecording(f"messages in {path.name}", "only the beginning of an MCAP file",
                                   "Record or export it again.")
            raise BadRecording(f"an MCAP file in {path.name}", "something else", "Record or export it again.")
        self._bytes = np.frombuffer(mapped, np.uint8)
        self._top = container.walk(self._bytes, len(MAGIC))
        self._summary = container.read_summary(mapped)
        walked = self._top.others
        self._closed = mapped[-len(MAGIC):] == MAGIC and self._top.end == len(mapped) - len(MAGIC)
        self._records = walked if self._closed else dict(sorted((self._indexed() | walked).items()))
        self._rescued = len(self._records) - len(walked)
        kept, size = [], 0
        for block in self._read(self.damage):
            self._count(block)
            size += len(block.places.data)
            kept.append(block)
            if size > KEPT:
                kept = []
        self._kept = kept if size <= KEPT else None
        self._note_end()
        self.topics = {name: topic for name, topic in self.topics.items() if topic.count}

    @property
    def count(self) -> int:
        """Messages that can be read."""
        return sum(topic.count for topic in self.topics.values())

    def blocks(self) -> Iterator[Block]:
        """The blocks with messages once more."""
        return iter(self._kept) if self._kept is not None else self._read([])

    def _indexed(self) -> dict[int, tuple[int, memoryview]]:
        """The chunks that the index names; it finds those behind damage."""
        view = memoryview(self._bytes)
        return {each.chunk_start_offset + RECORD_HEAD:
                (CHUNK, view[each.chunk_start_offset:][RECORD_HEAD:each.chunk_length])
                for each in self._summary.chunk_indexes
                if each.chunk_start_offset < len(view) and view[each.chunk_start_offset] == CHUNK}

    def _read(self, damage: list[str]) -> Iterator[Block]:
        """Block by block through the file; notes what is damaged."""
        chunks = [content for code, content in self._records.values() if code == CHUNK]
        opened = _ahead(partial(container.open_chunk, room=Room()), chunks)
        for code, content in self._records.values():
            if code == CHUNK:
                yield from self._chunk(*next(opened), damage)
            else:
                self._learn(code, content, damage)
        yield from self._messages(self._top, damage)
        end, begin = self._top.end, self._top.end + RECORD_HEAD
        if begin <= len(self._bytes) and self._bytes[end] == CHUNK and begin not in self._records:
            data, _ = container.open_chunk(memoryview(self._bytes)[begin:], Room(), cut=True)
            yield from self._chunk(data, "", [])

    def _chunk(self, data: np.ndarray, problem: str, damage: list[str]) -> Iterator[Block]:
        """The block in an unpacked chunk."""
        if problem:
            damage.append(problem)
            return
        records = container.walk(data)
        if records.end < len(data):
            damage.append("a chunk that ends within a record")
        for code, content in records.others.values():
            self._learn(code, content, damage)
        yield from self._messages(records, damage)

    def _messages(self, records: Records, damage: list[str]) -> Iterator[Block]:
        """The messages among records that have a whole head and a known channel, if there are any."""
        starts, lengths = records.starts, records.lengths
        whole = lengths >= HEAD
        if not whole.all():
            damage.append("messages without a head")
            starts, lengths = starts[whole], lengths[whole]
        if not len(starts):
            return
        places = Places.of(records.data, starts)
        head = places.read(0, container.HEADS)
        numbers = head["channel"]
        only = int(numbers[0]) if np.all(numbers == numbers[0]) else None
        present = {only} if only is not None else set(np.flatnonzero(np.bincount(numbers)).tolist())
        for number in sorted(present & self._summary.channels.keys()):
            self._add_channel(self._summary.channels[number])
        if not present <= self._channels.keys():
            damage.append("messages of a channel that is nowhere described")
        yield Block(places, lengths - HEAD, head, only)

    def _learn(self, code: int, content: memoryview, damage: list[str]) -> None:
        """Remember a schema or a channel, the first of each number."""
        try:
            if code == SCHEMA:
                schema = container.parse(Schema, content)
                self._schemas.setdefault(schema.id, schema)
            elif code == CHANNEL:
                self._add_channel(container.parse(Channel, content))
        except container.DAMAGED:
            damage.append(f"a broken {'schema' if code == SCHEMA else 'channel'}")

    def _add_channel(self, channel: Channel) -> None:
        """Several publishers of one topic are one, unless their messages are of another kind."""
        if channel.id in self._channels:
            return
        schema = self._schemas.get(channel.schema_id) or self._summary.schemas.get(channel.schema_id)
        # Without its number, so that equal schemas are equal.
        schema = replace(schema, id=0, data=bytes(schema.data)) if schema else NO_SCHEMA
        name, encoding = channel.topic, channel.message_encoding
        known = self.topics.get(name)
        if known and (known.encoding, known.schema) != (encoding, schema):
            name = f"{name}#{channel.id}"
        topic = self.topics.setdefault(name, Topic(name, encoding, schema, channel.metadata))
        topic.channels.append(channel.id)
        self._channels[channel.id] = topic

    def _count(self, block: Block) -> None:
        """Count messages per topic, and take one of each as a sample."""
        numbers = block.head["channel"]
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
        end, left = self._top.end, len(self._bytes) - self._top.end
        if self._rescued:
            self.damage.append(f"a broken record at byte {end}, chunks found from there on by the index: "
                               f"{self._rescued}")
        elif not self._closed:
            self.damage.append(f"it stops within a record at byte {end}, {left} bytes before its end"
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
