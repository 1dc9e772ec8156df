"""MCAP files made byte by byte: what is read is what was put in, and damage costs what it hit."""

import struct
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from mcap.reader import make_reader

from drivetool.errors import BadRecording
from drivetool.logs.formats.read import read_recording
from tests.mcap_bytes import CHUNK, MAGIC, Log, build

START, STEP, CHUNKS, PER_CHUNK = 1_700_000_000_000_000_000, 1_000_000, 5, 12
N = CHUNKS * PER_CHUNK
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
    groups = [[(1, START + k * STEP, START + k * STEP + 5, content(k))
               for k in range(c * PER_CHUNK, (c + 1) * PER_CHUNK)]
              for c in range(CHUNKS)]
    return Log([schema], [("/drive", encoding, 1, {"unit:torque": "Nm"})], groups, **more)


@pytest.fixture
def read(tmp_path):
    def read(raw):
        (tmp_path / "a.mcap").write_bytes(raw)
        return read_recording(tmp_path / "a.mcap", choose=list)

    return read


def check_read(found, kept, *damage):
    """The messages of `kept` (a list of numbers) and nothing else; all texts of `damage` in the finding."""
    speed, torque = found.channels["/drive.speed"], found.channels["/drive.torque"]
    np.testing.assert_array_equal(speed.values, SPEED[kept])
    np.testing.assert_array_equal(torque.values, TORQUE[kept])
    np.testing.assert_array_equal(speed.time, (np.array(kept) - kept[0]) * STEP / 10**9)
    assert (speed.unit, torque.unit) == ("rad/s", "Nm")
    assert found.origin == pytest.approx(START / 1e9 + kept[0] * STEP / 1e9, abs=1e-6)
    assert [f.code for f in found.findings] == ["log-damaged"] * bool(damage)
    for words in damage:
        assert words in found.findings[0].text


def messages_without(*chunks):
    return [k for k in range(N) if k // PER_CHUNK not in chunks]


PACKINGS = [{}, {"packing": "lz4"}, {"packing": "zstd"}, {"packing": "zstd, streamed"}]
LAYOUTS = [*PACKINGS, {"loose": True}, {"packing": "zstd", "checksum": False}]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("layout", LAYOUTS, ids=str)
@pytest.mark.parametrize("summary", ["whole", "none"])
def test_what_was_put_in(read, encoding, layout, summary):
    check_read(read(build(log(encoding, **layout), summary=summary)), messages_without())


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
    check_read(read(raw), messages_without(chunk), "(a chunk with a wrong checksum)")


def test_without_a_summary_the_first_chunk_describes_the_others(read):
    given = log(packing="zstd")
    check_read(read(build(given, wrong_crc=[2], summary="none")), messages_without(2),
               "(a chunk with a wrong checksum)")
    with pytest.raises(BadRecording, match="a chunk with a wrong checksum; 4 times messages of a channel that is"):
        read(build(given, wrong_crc=[0], summary="none"))


def test_a_summary_with_a_wrong_checksum_is_not_used(read):
    with pytest.raises(BadRecording, match="a chunk with a wrong checksum; 4 times messages of a channel that is"):
        read(build(log(), wrong_crc=[0], summary="wrong"))
    check_read(read(build(log(), summary="wrong")), messages_without())


@pytest.mark.parametrize("layout", PACKINGS, ids=str)
def test_a_record_of_a_wrong_length_costs_nothing_where_there_is_an_index(read, layout):
    raw = build(log(**layout), stretched=[1, 3])
    check_read(read(raw), messages_without(), "a broken record at byte ",
               "chunks found from there on by the index: 4)")


WITHOUT_INDEX = [{"summary": "none"}, {"summary": "wrong"}, {"end": False}]


@pytest.mark.parametrize("layout", PACKINGS, ids=str)
@pytest.mark.parametrize("more", WITHOUT_INDEX, ids=str)
def test_without_an_index_reading_goes_on_with_the_next_chunk(read, layout, more):
    # The length of the data inside the chunk is still there.
    check_read(read(build(log(**layout), stretched=[2], **more)), messages_without(), "(broken records at byte ",
               "reading goes on with the next chunk")


def chunk_starts(raw):
    """Where each chunk of an undamaged file begins."""
    starts, at = [], len(MAGIC)
    while at + 9 <= len(raw) - len(MAGIC):
        starts += [at] * (raw[at] == CHUNK)
        at += 9 + struct.unpack_from("<Q", raw, at + 1)[0]
    return starts


def overwritten(raw, chunks, first, content):
    """The file with `content` over the heads of some chunks, from their byte `first` on."""
    starts, raw = chunk_starts(raw), bytearray(raw)
    for start in (starts[number] for number in chunks):
        raw[start + first:start + first + len(content)] = content
    return bytes(raw)


# What is destroyed, and whether the chunk itself can be read by the index, and without one.
HEADS = {"kind 0": (0, b"\0", True, False), "kind of a message": (0, b"\5", True, None),
         "kind of an attachment": (0, b"\x09", True, True), "private kind": (0, b"\x90", True, True),
         "length 0": (1, bytes(8), True, False), "length 30": (1, struct.pack("<Q", 30), True, False),
         "length 2^40": (1, struct.pack("<Q", 1 << 40), True, True), "all 0": (0, bytes(64), False, False),
         "all 255": (0, b"\xff" * 64, False, False), "sizes": (33, b"\xff" * 8, False, None)}


@pytest.mark.parametrize("layout", PACKINGS[::2], ids=str)
@pytest.mark.parametrize("chunks", [[0], [2], [CHUNKS - 1], [1, 2], [1, 3], [0, CHUNKS - 1]], ids=str)
@pytest.mark.parametrize("head", HEADS)
def test_chunks_behind_a_smashed_head_are_found_by_the_index(read, layout, chunks, head):
    first, content, itself, _ = HEADS[head]
    raw = build(log(**layout))
    found = read(overwritten(raw, chunks, first, content))
    kept = messages_without(*([] if itself else chunks))
    check_read(found, kept, f"a broken record at byte {chunk_starts(raw)[chunks[0]]}, " if itself
               else "a chunk with a broken head")
    recorded = {} if itself else {"recorded": N}
    assert found.findings[0].evidence == {"messages": len(kept), **recorded,
                                          "places": found.findings[0].evidence["places"]}
    assert itself or f"the {len(kept)} messages of {N} that can be read" in found.findings[0].text


@pytest.mark.parametrize("layout", PACKINGS[::2], ids=str)
@pytest.mark.parametrize("more", WITHOUT_INDEX, ids=str)
@pytest.mark.parametrize("chunks", [[2], [1, 2], [1, 3], [CHUNKS - 1]], ids=str)
@pytest.mark.parametrize("head", [name for name in HEADS if HEADS[name][3] is not None])
def test_chunks_behind_a_smashed_head_are_found_by_their_look(read, layout, more, chunks, head):
    first, content, _, itself = HEADS[head]
    # A chunk with a wrong length is only seen where reading stops, so not behind another one.
    lost = chunks if not itself else [2] if (head, chunks) == ("length 2^40", [1, 2]) else []
    check_read(read(overwritten(build(log(**layout), **more), chunks, first, content)), messages_without(*lost), "")


@pytest.mark.parametrize("layout", PACKINGS, ids=str)
@pytest.mark.parametrize("more", [{}, *WITHOUT_INDEX], ids=str)
def test_a_length_that_leads_over_the_next_chunk_loses_no_message(read, layout, more):
    raw = build(log(**layout), **more)
    starts = chunk_starts(raw)
    check_read(read(overwritten(raw, [1], 1, struct.pack("<Q", starts[3] + 50 - starts[1]))), messages_without(),
               "broken record")


def test_a_file_with_many_broken_places_gives_one_short_sentence(read):
    given = replace(log(), groups=[[entry] for group in log().groups for entry in group])
    raw = build(given, summary="none")
    found = read(overwritten(raw, range(1, N, 2), 0, b"\0"))
    check_read(found, list(range(0, N, 2)), " and further on, reading goes on with the next chunk each time")
    assert len(found.findings[0].text) < 300


def test_a_length_that_leads_into_a_chunk_gives_no_message_twice(read):
    raw = build(log())
    at = raw.index(cdr(PER_CHUNK + 3)) - 31  # the record of the fourth message of the second chunk
    length = struct.pack("<Q", at - chunk_starts(raw)[1] - 9)
    check_read(read(overwritten(raw, [1], 1, length)), messages_without(), "a broken record at byte ")


def test_an_index_that_names_no_chunk_takes_nothing_away(read):
    raw = build(log(checksum=False))
    start = chunk_starts(raw)[2]
    entry = raw.rindex(struct.pack("<Q", start))
    for place in (start + 100, 1 << 60):
        found = read(raw[:entry] + struct.pack("<Q", place) + raw[entry + 8:])
        check_read(found, messages_without(), "a chunk with a broken head")


def test_a_chunk_without_a_checksum_that_has_another_size_than_stated(read):
    check_read(read(build(log(packing="zstd", checksum=False), resized=[1])), messages_without(1),
               "(a chunk that cannot be unpacked (ValueError))")


def test_an_unknown_packing_is_named(read):
    with pytest.raises(BadRecording, match=r"5 times a chunk packed with 'brotli' \(read are lz4, zstd and none\)"):
        read(build(log(packing="brotli")))


@pytest.mark.parametrize("layout", LAYOUTS, ids=str)
def test_without_an_end(read, layout):
    check_read(read(build(log(**layout), end=False)), messages_without(), "it has no end mark")


@pytest.mark.parametrize("layout", PACKINGS[:3], ids=str)
def test_cut_within_the_fourth_chunk(read, layout):
    given = log(**layout)
    three, four = (build(replace(given, groups=given.groups[:count]), end=False) for count in (3, 4))
    counts = []
    for cut in np.linspace(len(three) + 1, len(four) - 1, 7).astype(int):
        found = read(four[:cut])
        counts.append(len(found.channels["/drive.speed"].values))
        check_read(found, list(range(counts[-1])), "it stops within a record at byte ")
    assert counts == sorted(counts) and (counts[0], counts[-1]) == (3 * PER_CHUNK, 4 * PER_CHUNK)
    # A packed chunk this small gives all or nothing.
    assert layout or len(set(counts)) > 4


def test_two_topics_in_turn(read):
    schema, content = ENCODINGS["cdr"]
    channels = [("/drive", "cdr", 1, {}), ("/other", "json", 0, {})]
    messages = [(1, START + k * STEP, 0, content(k)) for k in range(N)]
    messages[20:20] = [(2, START + 20 * STEP, 0, b'{"x": 7}'), (2, START + 20 * STEP, 0, b'{"x": 0.5}')]
    groups = [messages[:25], messages[25:26], messages[26:]]
    for loose in (False, True):
        found = read(build(Log([schema], channels, groups, "lz4", loose)))
        np.testing.assert_array_equal(found.channels["/drive.speed"].values, SPEED)
        np.testing.assert_array_equal(found.channels["/other.x"].values, [7, 0.5])
        np.testing.assert_array_equal(found.channels["/other.x"].time, [0.02, 0.02])
        assert found.findings == ()
