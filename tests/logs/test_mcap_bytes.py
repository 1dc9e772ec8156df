"""MCAP files made byte by byte: what is read is what was put in, and damage costs what it hit."""

import struct
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from mcap.reader import make_reader

from drivetool.errors import BadRecording
from drivetool.logs.read import read_recording
from tests.mcap_bytes import Log, build

START, STEP, CHUNKS, EACH = 1_700_000_000_000_000_000, 1_000_000, 5, 12
N = CHUNKS * EACH
# Exact in binary, so that they are the same in every encoding.
SPEED, TORQUE = 100 + np.arange(N) / 8, 0.5 - np.arange(N) / 4
ROS1 = "time stamp\nfloat32 torque\nfloat64 speed # [rad/s]\n"
ROS2 = f"builtin_interfaces/T{ROS1[1:]}{80 * '='}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"


def cdr(k):
    # Four bytes of padding, since CDR aligns a float64 to eight.
    return struct.pack("<4siIf4xd", b"\0\1\0\0", *divmod(START + k * STEP, 10**9), TORQUE[k], SPEED[k])


def ros1(k):
    return struct.pack("<IIfd", *divmod(START + k * STEP, 10**9), TORQUE[k], SPEED[k])


def json(k):
    return b'{"speed": %s, "torque": %s}' % (str(SPEED[k]).encode(), str(TORQUE[k]).encode())


ENCODINGS = {"cdr": (("site/msg/Drive", "ros2msg", ROS2.encode()), cdr),
             "ros1": (("site/Drive", "ros1msg", ROS1.encode()), ros1),
             "json": (("drive", "jsonschema", b'{"properties": {"speed": {"unit": "rad/s"}}}'), json)}


def log(encoding="cdr", **more):
    schema, content = ENCODINGS[encoding]
    groups = [[(1, START + k * STEP, START + k * STEP + 5, content(k)) for k in range(c * EACH, (c + 1) * EACH)]
              for c in range(CHUNKS)]
    return Log([schema], [("/drive", encoding, 1, {"unit:torque": "Nm"})], groups, **more)


@pytest.fixture
def read(tmp_path):
    def read(raw):
        (tmp_path / "a.mcap").write_bytes(raw)
        return read_recording(tmp_path / "a.mcap", choose=list)

    return read


def check(found, kept, *told):
    """The messages of `kept` (a list of numbers) and nothing else; the damage `told`."""
    speed, torque = found.channels["/drive.speed"], found.channels["/drive.torque"]
    np.testing.assert_array_equal(speed.values, SPEED[kept])
    np.testing.assert_array_equal(torque.values, TORQUE[kept])
    np.testing.assert_array_equal(speed.time, (np.array(kept) - kept[0]) * STEP / 10**9)
    assert (speed.unit, torque.unit) == ("rad/s", "Nm")
    assert found.origin == pytest.approx(START / 1e9 + kept[0] * STEP / 1e9, abs=1e-6)
    assert [f.code for f in found.findings] == ["damaged-log"] * bool(told)
    for words in told:
        assert words in found.findings[0].text


def without(*chunks):
    return [k for k in range(N) if k // EACH not in chunks]


PACKINGS = [{}, {"packing": "lz4"}, {"packing": "zstd"}, {"packing": "zstd, streamed"}]
LAYOUTS = [*PACKINGS, {"loose": True}, {"packing": "zstd", "checksum": False}]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("layout", LAYOUTS, ids=str)
@pytest.mark.parametrize("summary", ["whole", "none"])
def test_what_was_put_in(read, encoding, layout, summary):
    check(read(build(log(encoding, **layout), summary=summary)), without())


@pytest.mark.parametrize("layout", LAYOUTS, ids=str)
def test_the_bytes_are_what_another_reader_takes_for_mcap(layout):
    given = log(**layout)
    reader = make_reader(BytesIO(build(given)), validate_crcs=True)
    assert [(1, message.log_time, message.publish_time, message.data)
            for _, _, message in reader.iter_messages()] == [entry for group in given.groups for entry in group]
    assert reader.get_summary().statistics.message_count == N


@pytest.mark.parametrize("layout", PACKINGS, ids=str)
@pytest.mark.parametrize("chunk", [0, 2, CHUNKS - 1])
def test_a_wrong_checksum_costs_its_chunk(read, layout, chunk):
    raw = build(log(**layout), wrong_crc=[chunk])
    check(read(raw), without(chunk), "(a chunk with a wrong checksum)")


def test_without_a_summary_the_first_chunk_describes_the_others(read):
    given = log(packing="zstd")
    check(read(build(given, wrong_crc=[2], summary="none")), without(2), "(a chunk with a wrong checksum)")
    with pytest.raises(BadRecording, match="a chunk with a wrong checksum; 4 times messages of a channel that is"):
        read(build(given, wrong_crc=[0], summary="none"))


def test_a_summary_with_a_wrong_checksum_is_not_used(read):
    with pytest.raises(BadRecording, match="a chunk with a wrong checksum; 4 times messages of a channel that is"):
        read(build(log(), wrong_crc=[0], summary="wrong"))
    check(read(build(log(), summary="wrong")), without())


@pytest.mark.parametrize("layout", PACKINGS, ids=str)
def test_a_record_of_a_wrong_length_costs_nothing_where_there_is_an_index(read, layout):
    raw = build(log(**layout), stretched=[1, 3])
    check(read(raw), without(), "a broken record at byte ", "chunks found from there on by the index: 4)")


@pytest.mark.parametrize("layout", PACKINGS, ids=str)
@pytest.mark.parametrize("more", [{"summary": "none"}, {"summary": "wrong"}, {"end": False}], ids=str)
def test_without_an_index_reading_ends_with_the_broken_record(read, layout, more):
    check(read(build(log(**layout), stretched=[2], **more)), without(3, 4), "it stops within a record at byte ")


def test_a_chunk_without_a_checksum_that_has_another_size_than_stated(read):
    check(read(build(log(packing="zstd", checksum=False), resized=[1])), without(1),
          "(a chunk that cannot be unpacked (ValueError))")


def test_an_unknown_packing_is_named(read):
    with pytest.raises(BadRecording, match=r"5 times a chunk packed with 'brotli' \(read are lz4, zstd and none\)"):
        read(build(log(packing="brotli")))


@pytest.mark.parametrize("layout", LAYOUTS, ids=str)
def test_without_an_end(read, layout):
    check(read(build(log(**layout), end=False)), without(), "it has no end mark")


@pytest.mark.parametrize("layout", PACKINGS[:3], ids=str)
def test_cut_within_the_fourth_chunk(read, layout):
    given = log(**layout)
    three, four = (build(replace(given, groups=given.groups[:count]), end=False) for count in (3, 4))
    counts = []
    for cut in np.linspace(len(three) + 1, len(four) - 1, 7).astype(int):
        found = read(four[:cut])
        counts.append(len(found.channels["/drive.speed"].values))
        check(found, list(range(counts[-1])), "it stops within a record at byte ")
    assert counts == sorted(counts) and (counts[0], counts[-1]) == (3 * EACH, 4 * EACH)
    # A packed chunk this small gives all or nothing.
    assert layout or len(set(counts)) > 4


def test_two_topics_in_turn_and_a_topic_of_two_channels(read):
    schema, content = ENCODINGS["cdr"]
    # The same schema twice, as two publishers give it; and one without a schema.
    channels = [("/drive", "cdr", 1, {}), ("/drive", "cdr", 2, {}), ("/other", "json", 0, {})]
    messages = [(1 + k % 2, START + k * STEP, 0, content(k)) for k in range(N)]
    messages[20:20] = [(3, START + 20 * STEP, 0, b'{"x": 7}'), (3, START + 20 * STEP, 0, b'{"x": 0.5}')]
    groups = [messages[:25], messages[25:26], messages[26:]]
    for loose in (False, True):
        found = read(build(Log([schema, schema], channels, groups, "lz4", loose)))
        np.testing.assert_array_equal(found.channels["/drive.speed"].values, SPEED)
        np.testing.assert_array_equal(found.channels["/other.x"].values, [7, 0.5])
        np.testing.assert_array_equal(found.channels["/other.x"].time, [0.02, 0.02])
        assert found.findings == ()
