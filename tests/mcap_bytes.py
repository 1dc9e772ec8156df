"""MCAP files byte by byte after the specification (https://mcap.dev/spec); no code is shared with the reader."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import lz4.frame
import zstandard

MAGIC = b"\x89MCAP0\r\n"
(HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX, STATISTICS, SUMMARY_OFFSET,
 DATA_END) = 1, 2, 3, 4, 5, 6, 7, 8, 11, 14, 15
# Channel number, log time, publish time, content.
Message = tuple[int, int, int, bytes]


def streamed(data: bytes) -> bytes:
    """As recorders pack that do not know the size beforehand: the frame does not state it."""
    packer = zstandard.ZstdCompressor().compressobj()
    return packer.compress(data) + packer.flush()


PACK = {"": bytes, "lz4": lz4.frame.compress, "zstd": zstandard.compress, "zstd, streamed": streamed,
        "brotli": bytes}


@dataclass(frozen=True)
class Log:
    """What a file holds, and how.

    schemas   (name, encoding, text), numbered from 1
    channels  (topic, encoding, schema number or 0, metadata), numbered from 1
    groups    the messages of each chunk; schemas and channels stand in the first
    packing   a key of PACK; loose: no chunks at all
    checksum  whether chunks and the summary have one
    """

    schemas: Sequence[tuple[str, str, bytes]]
    channels: Sequence[tuple[str, str, int, Mapping[str, str]]]
    groups: Sequence[Sequence[Message]]
    packing: str = ""
    loose: bool = False
    checksum: bool = True

    def descriptions(self) -> bytes:
        """The records of schemas and channels."""
        schemas = [record(SCHEMA, struct.pack("<H", number), text(name), text(encoding), sized(content))
                   for number, (name, encoding, content) in enumerate(self.schemas, 1)]
        channels = [record(CHANNEL, struct.pack("<HH", number, schema), text(topic), text(encoding),
                           sized(b"".join(text(key) + text(value) for key, value in metadata.items())))
                    for number, (topic, encoding, schema, metadata) in enumerate(self.channels, 1)]
        return b"".join([*schemas, *channels])


def text(value: str) -> bytes:
    return sized(value.encode())


def sized(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content


def record(code: int, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return struct.pack("<BQ", code, len(content)) + content


def message(channel: int, log_time: int, publish_time: int, content: bytes) -> bytes:
    return record(MESSAGE, struct.pack("<HIQQ", channel, 0, log_time, publish_time), content)


def build(log: Log, wrong_crc: Collection[int] = (), stretched: Collection[int] = (), resized: Collection[int] = (),
          summary: str = "whole", end: bool = True) -> bytes:
    """The bytes of a log.

    wrong_crc, stretched, resized  numbers of chunks whose checksum, length of the record or stated size is wrong
    summary                        "whole", "none" or "wrong" (with a wrong checksum)
    end                            whether the end of the data, the footer and the end mark are there
    """
    raw = MAGIC + record(HEADER, text(""), text("by hand"))
    indexes = []
    for number, group in enumerate(log.groups):
        times = [at for _, at, _, _ in group]
        inside, offsets = b"" if number else log.descriptions(), {}
        for entry in group:
            offsets.setdefault(entry[0], []).append((entry[1], len(inside)))
            inside += message(*entry)
        if log.loose:
            raw += inside
            continue
        packed = PACK[log.packing](inside)
        crc = (zlib.crc32(inside) ^ (number in wrong_crc)) if log.checksum else 0
        size = len(inside) + 7 * (number in resized)
        packing = text(log.packing.partition(",")[0])
        chunk = record(CHUNK, struct.pack("<QQQI", min(times), max(times), size, crc), packing,
                       struct.pack("<Q", len(packed)), packed)
        entries = [record(MESSAGE_INDEX, struct.pack("<H", channel),
                          sized(b"".join(struct.pack("<QQ", *each) for each in found)))
                   for channel, found in offsets.items()]
        places = b"".join(struct.pack("<HQ", channel, len(raw) + len(chunk) + sum(map(len, entries[:k])))
                          for k, channel in enumerate(offsets))
        indexes.append(record(CHUNK_INDEX, struct.pack("<QQQQ", min(times), max(times), len(raw), len(chunk)),
                              sized(places), struct.pack("<Q", sum(map(len, entries))), packing,
                              struct.pack("<QQ", len(packed), size)))
        if number in stretched:
            chunk = chunk[:1] + struct.pack("<Q", 1 << 40) + chunk[9:]
        raw += chunk + b"".join(entries)
    return raw + _ending(log, len(raw), indexes, summary) if end else raw


def _ending(log: Log, start: int, indexes: Sequence[bytes], summary: str) -> bytes:
    """All behind the data, which end at byte `start`."""
    data_end = record(DATA_END, struct.pack("<I", 0))
    if summary == "none":
        return data_end + record(FOOTER, struct.pack("<QQI", 0, 0, 0)) + MAGIC
    everything = [entry for group in log.groups for entry in group]
    times = [at for _, at, _, _ in everything]
    counts = b"".join(struct.pack("<HQ", number, sum(entry[0] == number for entry in everything))
                      for number in range(1, len(log.channels) + 1))
    statistics = record(STATISTICS, struct.pack(
        "<QHIIIIQQ", len(everything), len(log.schemas), len(log.channels), 0, 0, len(indexes), min(times),
        max(times)), sized(counts))
    start += len(data_end)
    first = log.descriptions() + statistics
    body = first + b"".join(indexes)
    offsets = record(SUMMARY_OFFSET, struct.pack("<BQQ", CHUNK_INDEX, start + len(first), len(body) - len(first)))
    head = struct.pack("<BQQQ", FOOTER, 20, start, start + len(body))
    crc = zlib.crc32(body + offsets + head) ^ (summary == "wrong") if log.checksum else 0
    return data_end + body + offsets + head + struct.pack("<I", crc) + MAGIC
