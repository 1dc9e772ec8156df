"""The records of an MCAP file: what the mcap package reads, and what it lacks.

The package reads the summary, schemas, channels and chunks. It makes an object of each message, and
stops at the first damaged byte. So this module finds the messages of a chunk all at once, and the
beginning of a chunk whose end is missing.
"""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress
from dataclasses import dataclass
from mmap import mmap

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE, SeekingReader
from mcap.records import Chunk, Footer
from mcap.stream_reader import MAGIC_SIZE, CRCValidationError, get_chunk_data_stream
from mcap.summary import Summary

from drivetool.logs.formats.mcap.container.arena import Arena

MAGIC = b"\x89MCAP0\r\n"
# The kind of a record and the length of its content stand before it.
RECORD_HEAD = 9
SCHEMA, CHANNEL, MESSAGE, CHUNK = map(int, (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK))
# No opcode: a chunk whose end is missing or not known.
CUT_CHUNK = 256
_LENGTH = struct.Struct("<Q")
_RECORD = np.dtype([("code", "u1"), ("length", "<u8")])
# What every message begins with.
MESSAGE_HEAD = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8")])
MESSAGE_HEAD_SIZE = MESSAGE_HEAD.itemsize
# A choice: after so many records of one length in a row, a vectorised search of further ones pays off.
_MIN_EQUAL_LENGTHS = 4
# What the package raises on damaged bytes.
DAMAGE_ERRORS = (McapError, struct.error, ValueError)
# packing -> what the beginning of a packed stream gives; the package unpacks whole ones only.
_UNPACK_BEGINNING = {"": lambda packed: packed,
                     "lz4": lambda packed: lz4.frame.LZ4FrameDecompressor().decompress(packed),
                     "zstd": lambda packed: zstandard.ZstdDecompressor().decompressobj().decompress(packed)}
# The packings that are read.
COMPRESSIONS = tuple(_UNPACK_BEGINNING)


@dataclass(frozen=True)
class Records:
    """The records in `data` (a (n,) array of bytes).

    starts   (n,) where the content of each message begins; lengths (n,) [bytes]
    others   where the content begins -> (kind, content), of each other record
    end      where reading stopped
    """

    data: np.ndarray
    starts: np.ndarray
    lengths: np.ndarray
    others: dict[int, tuple[int, memoryview]]
    end: int


def read_records(data: np.ndarray, first: int = 0) -> Records:
    """The records from `first` on, up to the end or the first place that holds none.

    Records of one length in a row, as a single topic of fixed layout gives them, are recognised at
    once; others cost a loop.
    """
    # One view for all: otherwise each unpacking would make one of the array.
    view, last, read = memoryview(data), len(data), _LENGTH.unpack_from
    begin: list[np.ndarray] = []
    single: list[int] = []
    at, before, alike, wait = first, -1, 0, 0
    while at + RECORD_HEAD <= last:
        length = read(view, at + 1)[0]
        stride = RECORD_HEAD + length
        if at + stride > last:
            break
        alike = alike + 1 if length == before else 0
        before = length
        if (alike >= _MIN_EQUAL_LENGTHS or at == first) and len(single) >= wait:
            count = _count_equal_records(data, at, length)
            if count >= 2 * _MIN_EQUAL_LENGTHS:
                if stride * count == last - first and data[at] == MESSAGE:  # all that there is
                    return Records(data, np.arange(at + RECORD_HEAD, last, stride),
                                   np.broadcast_to(np.int64(length), count), {}, last)
                begin += [np.array(single, np.int64), np.arange(at, at + stride * count, stride)]
                single, alike, wait = [], 0, 0
                at += stride * count
                continue
            wait = len(single) + 64
        single.append(at)
        at += stride
    begin = np.concatenate([*begin, np.array(single, np.int64)])
    # No record has the code 0: from there on it is not records.
    nothing = np.flatnonzero(data[begin] == 0)
    if len(nothing):
        at, begin = int(begin[nothing[0]]), begin[:nothing[0]]
    code, starts, lengths = data[begin], begin + RECORD_HEAD, np.diff(begin, append=at) - RECORD_HEAD
    messages, others = np.flatnonzero(code == MESSAGE), np.flatnonzero(code != MESSAGE)
    return Records(data, starts[messages], lengths[messages], {
        first: (kind, view[first:first + length]) for first, kind, length in
        np.column_stack([starts[others], code[others], lengths[others]]).tolist()}, at)


def _count_equal_records(data: np.ndarray, at: int, length: int) -> int:
    """How many records like the one at `at` follow each other from there."""
    stride = RECORD_HEAD + length
    there, count, block = (len(data) - at) // stride, 0, 32
    code, size = data[at], np.uint64(length)
    while count < there:
        part = min(block, there - count)
        begin = at + count * stride
        seen = np.ndarray((part,), _RECORD, data, begin, (stride,))
        same = (seen["code"] == code) & (seen["length"] == size)
        if not same.all():
            return count + int(np.argmin(same))
        count, block = count + part, 4 * block
    return count


class _View:
    """A file in memory that hands out views, so that no chunk is copied."""

    def __init__(self, content: bytes | memoryview):
        self._rest = memoryview(content)

    def read(self, size: int) -> memoryview:
        found, self._rest = self._rest[:size], self._rest[size:]
        return found


def parse(kind: type, content: bytes | memoryview):
    """The content of a record as the package's record of that kind, its data a view; or DAMAGE_ERRORS."""
    return kind.read(ReadDataStream(_View(content)))


def read_summary(file: mmap) -> Summary:
    """The summary at the end of the file; an empty one where there is none or it is damaged.

    The package does not compare the summary with its checksum; 0 says that there is none.
    """
    with suppress(Exception):  # damaged bytes fail in the libraries with any kind
        footer = parse(Footer, file[RECORD_HEAD - FOOTER_SIZE - MAGIC_SIZE:])
        # The checksum is of all before itself and the end mark.
        if not footer.summary_crc or footer.summary_crc == zlib.crc32(
                memoryview(file)[footer.summary_start:-4 - MAGIC_SIZE]):
            return SeekingReader(file).get_summary() or Summary()
    return Summary()


def open_chunk(content: memoryview, room: Arena, cut: bool = False) -> tuple[np.ndarray, str]:
    """The records of a chunk, unpacked.

    content  of a chunk record; room: where the bytes go
    cut      whether the end of the chunk is missing; then as much as can be unpacked
    returns  (bytes, what was wrong; empty if nothing)
    """
    nothing = np.zeros(0, np.uint8)
    try:
        chunk = parse(Chunk, content)
    except DAMAGE_ERRORS:
        return nothing, "a chunk with a broken head"
    if chunk.compression not in _UNPACK_BEGINNING:  # the package would take it for not packed
        return nothing, f"a chunk packed with '{chunk.compression}' (read are lz4, zstd and none)"
    try:
        data = _UNPACK_BEGINNING[chunk.compression](chunk.data) if cut else _unpacked(chunk, room)
        return np.frombuffer(data, np.uint8), ""
    except CRCValidationError:
        return nothing, "a chunk with a wrong checksum"
    except Exception as problem:  # damaged bytes fail in the libraries with any kind
        return nothing, f"a chunk that cannot be unpacked ({type(problem).__name__})"


def _unpacked(chunk: Chunk, room: Arena) -> np.ndarray | memoryview:
    """All bytes; ValueError if zstandard, which stops after the first frame, gives another size than stated."""
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    if not chunk.compression:
        return chunk.data
    if chunk.compression == "zstd" and size != chunk.uncompressed_size:
        raise ValueError("another size than stated")
    kept = room.take(size)
    kept[:] = np.frombuffer(stream.read(size), np.uint8)
    return kept
