"""An MCAP file as topics and, block by block, the messages in it."""

from __future__ import annotations

import mmap
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from mcap.records import Channel, Schema

from drivetool.errors import BadRecording
from drivetool.logs import display_name
from drivetool.logs.formats.mcap.container.arena import Arena
from drivetool.logs.formats.mcap.container.messages import MAX_SAMPLE_MESSAGES, Block, Topic
from drivetool.logs.formats.mcap.container.offsets import Offsets
from drivetool.logs.formats.mcap.container.records import (
    CHANNEL,
    CHUNK,
    CUT_CHUNK,
    DAMAGE_ERRORS,
    MAGIC,
    MESSAGE_HEAD,
    MESSAGE_HEAD_SIZE,
    SCHEMA,
    Records,
    open_chunk,
    parse,
    read_records,
    read_summary,
)
from drivetool.logs.formats.mcap.container.recover import recover
from drivetool.logs.formats.mcap.container.sources import find_sources

NO_SCHEMA = Schema(0, b"", "", "")
# Unpacked chunks up to this size [bytes] stay in memory between the two passes. A choice: memory against time.
MAX_CACHED_BYTES = 1 << 28


class McapSource:
    """An opened MCAP file.

    topics    name -> source of messages, those with messages only
    repeated  channels that hold what another one holds, and are not read, each with that other one
    damage    what was wrong, in order
    recorded  messages that the statistics count; None where there are none
    """

    def __init__(self, path: Path):
        """Map the file and look through all of it; BadRecording if it is not MCAP at all."""
        self.path, self.damage = path, []
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Topic] = {}
        with path.open("rb") as file:
            mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        if mapped[:len(MAGIC)] != MAGIC:
            if MAGIC.startswith(mapped[:len(MAGIC)]):
                raise BadRecording(f"messages in {display_name(path)}", "only the beginning of an MCAP file",
                                   "Record or export it again.")
            raise BadRecording(f"an MCAP file in {display_name(path)}", "something else",
                               "Record or export it again.")
        self._bytes = np.frombuffer(mapped, np.uint8)
        self._summary = read_summary(mapped)
        self._top, wrong = recover(read_records(self._bytes, len(MAGIC)), self._summary)
        kept, size = [], 0
        for block in self._read(self.damage):
            self._count(block)
            size += len(block.places.data)
            kept.append(block)
            if size > MAX_CACHED_BYTES:
                kept = []
        self._kept = kept if size <= MAX_CACHED_BYTES else None
        self.damage += wrong
        statistics = self._summary.statistics
        self.recorded = statistics.message_count if statistics else None
        self.topics, self.repeated = find_sources(
            {number: each for number, each in self._channels.items() if each.count}, self.blocks)

    @property
    def count(self) -> int:
        """Messages that can be read, those that are there twice once."""
        return sum(topic.count for topic in self.topics.values())

    def blocks(self) -> Iterator[Block]:
        """The blocks with messages once more."""
        return iter(self._kept) if self._kept is not None else self._read([])

    def _read(self, damage: list[str]) -> Iterator[Block]:
        """Block by block through the file; notes what is damaged."""
        chunks = [each for each in self._top.others.values() if each[0] in (CHUNK, CUT_CHUNK)]
        room = Arena()
        opened = _prefetched(lambda chunk: open_chunk(chunk[1], room, cut=chunk[0] == CUT_CHUNK), chunks)
        for code, content in self._top.others.values():
            if code == CHUNK:
                yield from self._chunk(*next(opened), damage)
            elif code == CUT_CHUNK:  # its missing end is reported already
                yield from self._chunk(next(opened)[0], "", [])
            else:
                self._learn(code, content, damage)
        yield from self._messages(self._top, damage)

    def _chunk(self, data: np.ndarray, problem: str, damage: list[str]) -> Iterator[Block]:
        """The block in an unpacked chunk."""
        if problem:
            damage.append(problem)
            return
        records = read_records(data)
        if records.end < len(data):
            damage.append("a chunk that ends within a record")
        for code, content in records.others.values():
            self._learn(code, content, damage)
        yield from self._messages(records, damage)

    def _messages(self, records: Records, damage: list[str]) -> Iterator[Block]:
        """The messages among records that have a whole head and a known channel, if there are any."""
        starts, lengths = records.starts, records.lengths
        whole = lengths >= MESSAGE_HEAD_SIZE
        if not whole.all():
            damage.append("messages without a head")
            starts, lengths = starts[whole], lengths[whole]
        if not len(starts):
            return
        places = Offsets.of(records.data, starts)
        head = places.read(0, MESSAGE_HEAD)
        numbers = head["channel"]
        only = int(numbers[0]) if np.all(numbers == numbers[0]) else None
        present = {only} if only is not None else set(np.flatnonzero(np.bincount(numbers)).tolist())
        for number in sorted(present & self._summary.channels.keys()):
            self._add_channel(self._summary.channels[number])
        if not present <= self._channels.keys():
            damage.append("messages of a channel that is nowhere described")
        yield Block(places, lengths - MESSAGE_HEAD_SIZE, head, only)

    def _learn(self, code: int, content: memoryview, damage: list[str]) -> None:
        """Remember a schema or a channel, the first of each number."""
        try:
            if code == SCHEMA:
                schema = parse(Schema, content)
                self._schemas.setdefault(schema.id, schema)
            elif code == CHANNEL:
                self._add_channel(parse(Channel, content))
        except DAMAGE_ERRORS:
            damage.append(f"a broken {'schema' if code == SCHEMA else 'channel'}")

    def _add_channel(self, channel: Channel) -> None:
        """Remember a channel, and what its messages are."""
        if channel.id in self._channels:
            return
        schema = self._schemas.get(channel.schema_id) or self._summary.schemas.get(channel.schema_id)
        # Without its number, so that equal schemas are equal.
        schema = replace(schema, id=0, data=bytes(schema.data)) if schema else NO_SCHEMA
        self._channels[channel.id] = Topic(channel.topic, channel.topic, channel.message_encoding, schema,
                                           channel.metadata, [channel.id])

    def _count(self, block: Block) -> None:
        """Count messages per channel, and take some as samples."""
        numbers = block.head["channel"]
        counts = dict(enumerate(np.bincount(numbers).tolist())) if block.only is None \
            else {block.only: len(numbers)}
        for number, count in counts.items():
            topic = self._channels.get(number)
            if topic is None or not count:
                continue
            topic.count += count
            if len(topic.samples) < MAX_SAMPLE_MESSAGES:
                mine = np.flatnonzero(numbers == number)
                topic.samples += [block.content(index) for index in
                                  mine[_first_of_each_length(block.lengths[mine])][:MAX_SAMPLE_MESSAGES
                                                                                   - len(topic.samples)]]


def _prefetched(work: Callable, items: Iterable, ahead: int = 4) -> Iterator:
    """The results of `work` in order, made by a thread that runs a little ahead."""
    with ThreadPoolExecutor(1) as pool:
        waiting = deque()
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _first_of_each_length(lengths: np.ndarray) -> np.ndarray:
    """Where each length occurs first, in order; nearly always there is one length, which needs no sorting."""
    if lengths[0] == lengths[-1] and np.all(lengths == lengths[0]):
        return np.zeros(1, np.int64)
    return np.sort(np.unique(lengths, return_index=True)[1])
