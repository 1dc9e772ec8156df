"""The records of an MCAP file, found without looking at one after the other where they are alike.

A file is records one after the other; a chunk is a record that holds records, packed. Everything
here works on the bytes; what is damaged is said and the rest is used.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np

from drivetool.logs.mcap.places import Places
from drivetool.logs.mcap.room import Room

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 1, 2, 3, 4, 5, 6, 15
_LENGTH = struct.Struct("<Q")
_RECORD = np.dtype([("code", "u1"), ("length", "<u8")])
# What every message begins with.
HEADS = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8")])
HEAD = HEADS.itemsize
# A run of records of one length is looked for after so many of them.
_ALIKE = 4


@dataclass(frozen=True)
class Records:
    """Where records lie in `data` (a (n,) array of bytes).

    code    (n,) kind of each record
    start   (n,) where its content begins; length (n,) of the content
    end     where reading stopped
    """

    data: np.ndarray
    code: np.ndarray
    start: np.ndarray
    length: np.ndarray
    end: int

    @property
    def whole(self) -> bool:
        """Whether all bytes were records."""
        return self.end == len(self.data)

    def content(self, index: int) -> memoryview:
        """The content of one record."""
        first = int(self.start[index])
        return memoryview(self.data)[first:first + int(self.length[index])]


def walk(data: np.ndarray, first: int = 0) -> Records:
    """The records from `first` on, up to the end or the first place that holds none.

    Records of one length in a row, as a single topic of fixed layout gives them, are recognised at
    once; others cost a loop.
    """
    whole = _one_run(data, first)
    if whole is not None:
        return whole
    # Without a view of its own, each unpacking would ask the array for one.
    view, last, read = memoryview(data), len(data), _LENGTH.unpack_from
    begin: list[np.ndarray] = []
    codes: list[np.ndarray] = []
    lengths: list[np.ndarray] = []
    places: list[int] = []

    def singles():
        if places:
            starts = np.array(places, np.int64)
            seen = Places(data, starts, 0).read(0, _RECORD)
            begin.append(starts)
            codes.append(seen["code"])
            lengths.append(seen["length"].astype(np.int64))

    at, before, alike, wait = first, -1, 0, 0
    while at + 9 <= last:
        length = read(view, at + 1)[0]
        after = at + 9 + length
        if after > last:
            break
        if length == before:
            alike += 1
            if alike >= _ALIKE and len(places) >= wait:
                count = _run(data, at, length)
                if count >= 2 * _ALIKE:
                    singles()
                    begin.append(np.arange(at, at + (9 + length) * count, 9 + length))
                    codes.append(np.full(count, data[at]))
                    lengths.append(np.full(count, length))
                    places, alike, wait = [], 0, 0
                    at += (9 + length) * count
                    continue
                wait = len(places) + 64
        else:
            before, alike = length, 0
        places.append(at)
        at = after
    singles()
    code = np.concatenate([*codes, np.zeros(0, np.uint8)])
    start, length = (np.concatenate([*each, np.zeros(0, np.int64)]) for each in (begin, lengths))
    # No record has the code 0: from there on it is not records.
    nothing = np.flatnonzero(code == 0)
    if len(nothing):
        first = nothing[0]
        at, code, start, length = int(start[first]), code[:first], start[:first], length[:first]
    return Records(data, code, start + 9, length, at)


def _one_run(data: np.ndarray, first: int) -> Records | None:
    """All records, if they are of one kind and length; then these are stated once and take no room."""
    if len(data) - first < 9:
        return None
    code, length = data[first], _LENGTH.unpack_from(data, first + 1)[0]
    stride = 9 + length
    if code == 0 or (len(data) - first) % stride or len(data) - first < 2 * stride:
        return None
    count = (len(data) - first) // stride
    if _run(data, first, length) < count:
        return None
    return Records(data, np.broadcast_to(code, count), np.arange(first + 9, len(data), stride),
                   np.broadcast_to(np.int64(length), count), len(data))


def _run(data: np.ndarray, at: int, length: int) -> int:
    """How many records like the one at `at` follow each other from there."""
    stride = 9 + length
    there, count, look = (len(data) - at) // stride, 0, 32
    code, size = data[at], np.uint64(length)
    while count < there:
        part = min(look, there - count)
        begin = at + count * stride
        seen = np.ndarray((part,), _RECORD, data, begin, (stride,))
        same = (seen["code"] == code) & (seen["length"] == size)
        if not same.all():
            return count + int(np.argmin(same))
        count, look = count + part, 4 * look
    return count


def open_chunk(content: memoryview, cut: bool = False, room: Room | None = None) -> tuple[np.ndarray, str]:
    """The records of a chunk, unpacked.

    content  of a chunk record; cut: whether its end is missing, then as much as can be unpacked
    room     where the bytes may go
    returns  (bytes, what was wrong; empty if nothing)
    """
    nothing = np.zeros(0, np.uint8)
    try:
        size, crc, name_length = struct.unpack_from("<QII", content, 16)
        packing = bytes(content[32:32 + name_length]).decode()
        packed = content[40 + name_length:]
        stated = struct.unpack_from("<Q", content, 32 + name_length)[0]
    except (struct.error, UnicodeDecodeError):
        return nothing, "" if cut else "a chunk with a broken head"
    if not cut and stated > len(packed):
        return nothing, "a chunk with a broken head"
    try:
        data = _unpack(packed if cut else packed[:stated], packing, size, cut, room or Room())
    except KeyError:
        return nothing, f"a chunk packed with '{packing}' (read are lz4, zstd and none)"
    except Exception as problem:  # damaged bytes fail in the libraries with any kind
        return nothing, f"a chunk that cannot be unpacked ({type(problem).__name__})"
    if not cut and crc and zlib.crc32(data) != crc:
        return nothing, "a chunk with a wrong checksum"
    return np.frombuffer(data, np.uint8), ""


def _unpack(packed: memoryview, packing: str, size: int, cut: bool, room: Room) -> bytes | memoryview | np.ndarray:
    """The unpacked bytes; of a cut stream those that can be had."""
    if packing == "":
        return packed
    if packing == "lz4":
        import lz4.frame

        return lz4.frame.LZ4FrameDecompressor().decompress(packed) if cut else lz4.frame.decompress(packed)
    if packing == "zstd":
        import zstandard

        unpacker = zstandard.ZstdDecompressor()
        if cut:
            return unpacker.decompressobj().decompress(packed)
        data = room.take(size)
        with unpacker.stream_reader(packed) as reader:
            if reader.readinto(data) != size:
                raise ValueError("another size than stated")
        return data
    raise KeyError(packing)


def text_at(content: memoryview, at: int) -> tuple[str, int]:
    """(text, where it ends) of a length-prefixed text."""
    length = struct.unpack_from("<I", content, at)[0]
    if at + 4 + length > len(content):
        raise ValueError("text beyond its record")
    return bytes(content[at + 4:at + 4 + length]).decode(), at + 4 + length
