"""Finds the records after a broken one: by the index, or without one by the form of a chunk."""

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import replace

import numpy as np
from mcap.records import Chunk, ChunkIndex
from mcap.summary import Summary

from drivetool.logs.formats.mcap.container.records import (
    CHUNK,
    COMPRESSIONS,
    CUT_CHUNK,
    DAMAGE_ERRORS,
    MAGIC,
    RECORD_HEAD,
    Records,
    parse,
    read_records,
)

# In a chunk record: where the name of its packing begins, and the bytes besides that name and the data.
_COMPRESSION_OFFSET, _CHUNK_OVERHEAD = RECORD_HEAD + 32, RECORD_HEAD + 40
_LENGTH, _SIZE = struct.Struct("<Q"), struct.Struct("<I")
# Bytes that are searched at once. A choice: the arrays of a search stay small beside the file.
_SEARCH_BLOCK = 1 << 24


def recover(walked: Records, summary: Summary) -> tuple[Records, list[str]]:
    """All records of a file, including those after a broken one.

    walked   found one after the other from the beginning of the file
    summary  with the index of the chunks; empty where there is none
    returns  (records, what is wrong with the file as a whole); the sequence of messages stays that of the file
    """
    missing = [each for each in summary.chunk_indexes if not _has_chunk(walked, each)]
    if missing:
        records, damage = _recover_by_index(walked, summary.chunk_indexes, missing)
    else:
        records, damage = (walked, []) if summary.chunk_indexes else _recover_by_search(walked)
    if _has_end_mark(records):
        return records, damage
    end, left = records.end, len(walked.data) - records.end
    return _with_cut_chunk(records, end, len(walked.data)), [
        *damage, f"it stops within a record at byte {end}, {left} bytes before its end" if left
        else "it has no end mark, as if the recorder was killed"]


def _has_end_mark(records: Records) -> bool:
    """Whether the records go on up to the end mark."""
    return len(records.data) - records.end == len(MAGIC) and records.data[records.end:].tobytes() == MAGIC


def _has_chunk(walked: Records, each: ChunkIndex) -> bool:
    """Whether the chunk that the index names is among the records."""
    code, content = walked.others.get(each.chunk_start_offset + RECORD_HEAD, (0, b""))
    return code == CHUNK and len(content) == each.chunk_length - RECORD_HEAD


def _recover_by_index(walked: Records, index: list[ChunkIndex],
                      missing: list[ChunkIndex]) -> tuple[Records, list[str]]:
    """The records with the missing chunks of the index, where their heads say what the index says.

    A wrong length may lead the walk into a chunk that is not packed, and its messages would be read twice.
    So the messages met inside a chunk of the index are left out.
    """
    view, found = memoryview(walked.data), {}
    for each in missing:
        content = view[each.chunk_start_offset:][RECORD_HEAD:each.chunk_length]
        try:
            chunk = parse(Chunk, content)
        except DAMAGE_ERRORS:
            continue
        if (chunk.compression, len(chunk.data)) == (each.compression, each.compressed_size):
            found[each.chunk_start_offset + RECORD_HEAD] = (CHUNK, content)
    lost = min(walked.end, *(each.chunk_start_offset for each in missing))
    damage = ["a chunk with a broken head"] * (len(missing) - len(found))
    if not found:
        return walked, damage
    damage.insert(0, f"a broken record at byte {lost}, chunks found from there on by the index: {len(found)}")
    bounds = [(each.chunk_start_offset + RECORD_HEAD, each.chunk_start_offset + each.chunk_length)
              for each in index if each.chunk_start_offset + RECORD_HEAD in found or _has_chunk(walked, each)]
    first, last = np.sort(np.array(bounds, np.int64), axis=0).T
    keep = np.searchsorted(first, walked.starts, "right") == np.searchsorted(last, walked.starts, "right")
    # The index stands at the end of the file, so reading came that far.
    return Records(walked.data, walked.starts[keep], walked.lengths[keep],
                   dict(sorted((walked.others | found).items())), len(view) - len(MAGIC)), damage


def _recover_by_search(walked: Records) -> tuple[Records, list[str]]:
    """The records, and those from the next place on that looks like a chunk, as often as reading stops."""
    parts, damage = [walked], []
    while not _has_end_mark(parts[-1]) and \
            (start := _next_chunk(walked.data, _search_start(parts[-1]))) is not None:
        parts[-1] = _with_cut_chunk(parts[-1], parts[-1].end, start)
        parts.append(read_records(walked.data, start))
    if len(parts) > 1:
        places = [str(part.end) for part in parts[:-1]]
        damage = [f"broken records at byte {', '.join(places[:3])}{' and further on' * (len(places) > 3)}, reading "
                  "goes on with the next chunk each time"]
    others = {at: record for part in parts for at, record in part.others.items()}
    for at, (code, content) in others.items():
        if code not in (CHUNK, CUT_CHUNK) and _is_chunk(walked.data, at - RECORD_HEAD):
            others[at] = (CHUNK, content)
            damage.append("a chunk with the type of another record")
    if not damage:
        return walked, []
    return Records(walked.data, np.concatenate([part.starts for part in parts]),
                   np.concatenate([part.lengths for part in parts]), others, parts[-1].end), damage


def _search_start(part: Records) -> int:
    """From where on a chunk may have been missed: the end of the last one by the length of its data.

    The length of its record may be wrong, and lead the walk over other chunks to where it stopped.
    """
    at = max((at for at, (code, _) in part.others.items() if code == CHUNK), default=None)
    if at is not None:
        with suppress(*DAMAGE_ERRORS):
            chunk = parse(Chunk, part.others[at][1])
            return min(part.end + 1, at - RECORD_HEAD + _CHUNK_OVERHEAD + len(chunk.compression) + len(chunk.data))
    return part.end + 1


def _with_cut_chunk(records: Records, end: int, until: int) -> Records:
    """The records and the chunk that begins at byte `end`, if one does, whose own end is not known."""
    begin = end + RECORD_HEAD
    if begin > until or records.data[end] != CHUNK:
        return records
    return replace(records, others=records.others | {
        begin: (CUT_CHUNK, memoryview(records.data)[begin:until])})


def _next_chunk(data: np.ndarray, first: int) -> int | None:
    """The first byte from `first` on where a whole chunk record begins, by its head; None if there is none."""
    for begin in range(first, len(data) - _CHUNK_OVERHEAD + 1, _SEARCH_BLOCK):
        part = data[begin:min(begin + _SEARCH_BLOCK, len(data) - _CHUNK_OVERHEAD + 1)]
        at = begin + np.flatnonzero(part == CHUNK)
        # The high byte of the length of a name; few of the places that are none have it and the next one 0.
        at = at[(data[at + _COMPRESSION_OFFSET - 1] == 0) & (data[at + _COMPRESSION_OFFSET - 2] == 0)]
        found = next((start for start in at.tolist() if _is_chunk(data, start)), None)
        if found is not None:
            return found
    return None


def _is_chunk(data: np.ndarray, start: int) -> bool:
    """Whether the record at `start` has the lengths and the packing of a chunk, whatever its kind says."""
    if start + _CHUNK_OVERHEAD > len(data):
        return False
    size = _SIZE.unpack_from(data, start + _COMPRESSION_OFFSET - 4)[0]
    if size > max(map(len, COMPRESSIONS)) or start + _CHUNK_OVERHEAD + size > len(data):
        return False
    whole = RECORD_HEAD + _LENGTH.unpack_from(data, start + 1)[0]
    inside = _LENGTH.unpack_from(data, start + _COMPRESSION_OFFSET + size)[0]
    name = data[start + _COMPRESSION_OFFSET:start + _COMPRESSION_OFFSET + size].tobytes()
    return name in [each.encode() for each in COMPRESSIONS] and \
        whole == _CHUNK_OVERHEAD + size + inside <= len(data) - start
