"""Logs that were cut or damaged: what is readable is used, and said; never anything but a sentence."""

import struct

import numpy as np
import pytest
from mcap.writer import CompressionType

from drivetool.errors import BadRecording, DriveToolError
from drivetool.logs.door.inspect import inspect_log
from drivetool.logs.formats.read import read_recording
from tests import encodings
from tests.logs.test_parquet import write_groups, write_long

START, STEP = 1_700_000_000_000_000_000, 1_000_000
N = 60
SPEED = np.array([m["speed"] for m in encodings.rows(N, STEP, START)])


def log(path, encoding="cdr", n=N, **options):
    encodings.write(path, encoding, encodings.rows(N, STEP, START)[:n], **options)
    return path.read_bytes()


def message_ends(raw, first=8, last=None):
    """Where each message ends, in the file or in an uncompressed chunk; independent of the reader's code."""
    ends, at = [], first
    while at + 9 <= (last or len(raw)):
        code, length = struct.unpack_from("<BQ", raw, at)
        if code == 6:
            name = struct.unpack_from("<I", raw, at + 9 + 28)[0]
            ends += message_ends(raw, at + 9 + 40 + name, at + 9 + length).tolist()
        elif code == 5:
            ends.append(at + 9 + length)
        at += 9 + length
        if code == 15:  # the data section is over
            break
    return np.array(ends)


def check_cut(path, raw, cut, ends):
    path.write_bytes(raw[:cut])
    expected = int(np.sum(ends <= cut))
    try:
        found = read_recording(path, choose=list)
    except BadRecording as problem:
        assert expected == 0, (cut, problem)
        return
    values = found.channels["/drive.speed"].values
    np.testing.assert_array_equal(values, SPEED[:expected])
    assert [f.code for f in found.findings] == ["log-damaged"]
    assert found.findings[0].evidence["messages"] == expected


LAYOUTS = {"loose": {"chunked": False}, "chunks": {"compression": CompressionType.NONE, "chunk": 1000}}


@pytest.mark.slow
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("encoding", ["json", "cdr", "protobuf"])
def test_cut_at_some_bytes(tmp_path, layout, encoding):
    raw = log(tmp_path / "a.mcap", encoding, **LAYOUTS[layout])
    ends = message_ends(raw)
    assert len(ends) == N
    rng = np.random.default_rng(len(raw))
    near = [int(end) + d for end in rng.choice(ends, 5, replace=False) for d in (-1, 0, 1)]
    for cut in {*near, *rng.integers(1, len(raw), 25).tolist(), len(raw) - 1, 8, 7, 9}:
        check_cut(tmp_path / "a.mcap", raw, cut, ends)


@pytest.mark.fuzz
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("encoding", encodings.ENCODINGS)
def test_cut_at_every_byte(tmp_path, layout, encoding):
    raw = log(tmp_path / "a.mcap", encoding, 12, **LAYOUTS[layout])
    ends = message_ends(raw)
    assert len(ends) == 12
    for cut in range(1, len(raw)):
        check_cut(tmp_path / "a.mcap", raw, cut, ends)


def check_cut_of_compressed_log(path, raw, cut, before):
    """A cut packed chunk gives at least nothing less than the chunks before it, and a true beginning."""
    path.write_bytes(raw[:cut])
    try:
        found = read_recording(path, choose=list)
    except BadRecording:
        assert before == 0
        return 0
    values = found.channels["/drive.speed"].values
    assert len(values) >= before
    np.testing.assert_array_equal(values, SPEED[:len(values)])
    assert [f.code for f in found.findings] == ["log-damaged"]
    return len(values)


def check_cuts_of_compressed_log(path, compression, cuts, n=N):
    raw = log(path, "cdr", n, compression=compression, chunk=500)
    before = 0
    for cut in sorted(cuts(len(raw))):
        before = check_cut_of_compressed_log(path, raw, cut, before)
    assert before == n


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_cut_packed_chunks_at_some_bytes(tmp_path, compression):
    check_cuts_of_compressed_log(tmp_path / "a.mcap", compression,
                                 lambda size: {*np.random.default_rng(2).integers(1, size, 30).tolist(), size - 1})


@pytest.mark.fuzz
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_cut_packed_chunks_at_every_byte(tmp_path, compression):
    check_cuts_of_compressed_log(tmp_path / "a.mcap", compression, lambda size: range(1, size), 12)


def test_a_wrong_checksum_costs_its_chunk(tmp_path):
    raw = bytearray(log(tmp_path / "a.mcap", "cdr", compression=CompressionType.NONE, chunk=1000))
    raw[message_ends(raw)[30] - 3] ^= 1
    (tmp_path / "a.mcap").write_bytes(raw)
    found = read_recording(tmp_path / "a.mcap", choose=list)
    assert "a chunk with a wrong checksum" in found.findings[0].text
    values = found.channels["/drive.speed"].values
    assert N - 15 <= len(values) < N and set(values) <= set(SPEED) and SPEED[30] not in values


def damage(path, raw, rng, checked):
    """Some bytes changed, swapped, or a stretch taken out: a sentence or what is left, never anything else.

    returns  whether a speed was left to compare
    """
    raw = bytearray(raw)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(0, len(raw)))
        kind = rng.integers(0, 3)
        if kind == 0:
            raw[at] = int(rng.integers(0, 256))
        elif kind == 1:
            raw[at:at + 8] = rng.bytes(8)
        else:
            del raw[at:at + int(rng.integers(1, 40))]
    path.write_bytes(raw)
    try:
        found = inspect_log(path)
    except DriveToolError:
        return False
    channel = found.recording.channels.get("/drive.speed")
    if not checked or channel is None:
        return False
    left = set(channel.values[np.isfinite(channel.values)])
    assert left <= set(SPEED)
    return bool(left)


@pytest.mark.slow
@pytest.mark.parametrize("encoding", encodings.ENCODINGS)
def test_damaged_somewhere(tmp_path, encoding):
    rng = np.random.default_rng(5)
    for chunked in (True, False):
        raw = log(tmp_path / "a.mcap", encoding, chunked=chunked, chunk=1500)
        compared = [damage(tmp_path / "a.mcap", raw, rng, checked=chunked) for _ in range(20)]
        assert any(compared) == chunked


@pytest.mark.fuzz
@pytest.mark.parametrize("encoding", encodings.ENCODINGS)
def test_damaged_anywhere(tmp_path, encoding):
    rng = np.random.default_rng(6)
    for options in ({"chunk": 1500}, {"chunked": False}, {"compression": CompressionType.LZ4}):
        raw = log(tmp_path / "a.mcap", encoding, **options)
        compared = [damage(tmp_path / "a.mcap", raw, rng, checked="chunked" not in options) for _ in range(300)]
        assert any(compared) == ("chunked" not in options)


@pytest.mark.parametrize("write", [write_groups, write_long])
@pytest.mark.parametrize("tries", [30, pytest.param(700, marks=pytest.mark.fuzz)])
def test_damaged_parquet(tmp_path, write, tries):
    write(tmp_path / "a.parquet")
    raw = (tmp_path / "a.parquet").read_bytes()
    rng = np.random.default_rng(8)
    for _ in range(tries):
        damage(tmp_path / "a.parquet", raw, rng, checked=False)
