"""MCAP in every encoding: values as the stock decoders give them, paths, clocks, and what is said."""

import itertools
import struct

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from mcap.writer import CompressionType

from drivetool.errors import BadRecording
from drivetool.logs.channels import field_path
from drivetool.logs.channels.channel_map import SCHEMA, ChannelMap
from drivetool.logs.door.build import open_experiment
from drivetool.logs.formats.mcap.collector import Collector
from drivetool.logs.formats.mcap.container import source
from drivetool.logs.formats.mcap.container.offsets import Offsets
from drivetool.logs.formats.mcap.container.records import read_records
from drivetool.logs.formats.mcap.container.source import McapSource
from drivetool.logs.formats.mcap.decoders import layout
from drivetool.logs.formats.mcap.decoders.ros import ros_walk
from drivetool.logs.formats.mcap.decoders.topics import open_topic
from drivetool.logs.formats.read import read_recording
from tests import encodings
from tests.mcap_bytes import Log, build

START, STEP = 1_700_000_000_999_000_123, 400_000
ROLES = {"motor_torque": {"channel": "torque", "unit": "Nm"}, "motor_speed": {"channel": "speed", "unit": "rad/s"}}


def everything(path, **more):
    return read_recording(path, choose=lambda names: names, **more)


def channel_map(roles=ROLES, **more):
    return ChannelMap.from_mapping({"schema": SCHEMA, "roles": roles, **more})


def value_at(message, name):
    """The value of a stock message at a channel's name, written independently of the reader."""
    node, beside = message, None
    for step in field_path.parse(name):
        beside = node if isinstance(step, str) else beside
        if isinstance(step, str):
            node = node[step] if isinstance(node, dict) else getattr(node, step)
        elif isinstance(step, int):
            node = node[step]
        else:
            names = beside["name"] if isinstance(beside, dict) else beside.name
            node = node[list(names).index(step.value)]
    return float(node)


@pytest.mark.parametrize("encoding", encodings.ENCODINGS)
@pytest.mark.parametrize("options", [
    {}, {"compression": CompressionType.LZ4}, {"compression": CompressionType.NONE}, {"index": False},
    {"chunked": False}, {"chunk": 1 << 20}, {"packing": ""}, {"packing": "zstd"}], ids=str)
def test_values_and_times_of_the_stock_decoders(tmp_path, encoding, options):
    path = tmp_path / "a.mcap"
    messages = encodings.rows(150, STEP, START)
    write = encodings.write_by_hand if "packing" in options else encodings.write
    write(path, encoding, messages, **options)
    found = everything(path)
    assert found.findings == () and found.unreadable == {}
    if encoding == "protobuf":
        assert {"/drive.plain", "/drive.sizes[2]", "/drive.effort[name=load]"} <= set(found.channels)
    expected = encodings.stock(path)
    assert len(expected) == 150
    for name, channel in found.channels.items():
        values = [value_at(message, name.removeprefix("/drive.")) for _, _, message in expected]
        np.testing.assert_array_equal(channel.values, values, err_msg=name)
        np.testing.assert_array_equal(np.round(channel.time * 1e9), [log - START for _, log, _ in expected])
    assert found.origin == pytest.approx(START / 1e9, abs=1e-6)


@pytest.mark.parametrize("encoding", ["cdr", "ros1", "protobuf"])
def test_one_by_one_gives_the_same(tmp_path, encoding, monkeypatch):
    encodings.write(tmp_path / "a.mcap", encoding, encodings.rows(300, STEP, START))
    together = everything(tmp_path / "a.mcap")
    monkeypatch.setattr(layout, "MAX_NEW_LAYOUTS", 0)
    monkeypatch.setattr(layout, "MIN_LAYOUT_MESSAGES", np.inf)
    alone = everything(tmp_path / "a.mcap")
    assert list(together.channels) == list(alone.channels)
    for name, channel in together.channels.items():
        assert channel.values.tobytes() == alone.channels[name].values.tobytes(), name


def test_json_one_by_one_gives_the_same(tmp_path):
    messages = encodings.rows(300, STEP, START)
    encodings.write(tmp_path / "a.mcap", "json", messages)
    together = everything(tmp_path / "a.mcap")
    # A NaN, which strict JSON does not have, sends the whole chunk through the other decoder.
    messages[150]["torque"] = float("nan")
    encodings.write(tmp_path / "b.mcap", "json", messages, chunk=1 << 20)
    alone = everything(tmp_path / "b.mcap")
    for name, channel in together.channels.items():
        keep = np.arange(300) != (150 if name == "/drive.torque" else -1)
        np.testing.assert_array_equal(channel.values[keep], alone.channels[name].values[keep], err_msg=name)
    assert np.isnan(alone.channels["/drive.torque"].values[150])


@pytest.mark.parametrize("encoding", encodings.ENCODINGS)
def test_lists_of_varying_length_and_order(tmp_path, encoding):
    messages = encodings.rows(120, STEP, START)
    for k, message in enumerate(messages):
        if k % 5 == 0:
            message["name"], message["effort"] = ["brake", "load", "motor"], [0.5, 10.0 + k, 20.0 + k]
        if k % 7 == 0:
            message["name"], message["effort"] = ["load"], [30.0 + k]
        message["note"] = "x" * (k % 11)
    encodings.write(tmp_path / "a.mcap", encoding, messages)
    roles = {"motor_torque": "/drive.effort[name=motor]", "load_torque": "effort[name=load]",
             "shaft_torque": "/drive.effort[2]"}
    found = read_recording(tmp_path / "a.mcap", channel_map(roles))
    for channel, name in (("/drive.effort[name=motor]", "motor"), ("/drive.effort[name=load]", "load")):
        expected = [dict(zip(m["name"], m["effort"], strict=True)).get(name, np.nan) for m in messages]
        np.testing.assert_array_equal(found.channels[channel].values, expected)
    expected = [m["effort"][2] if len(m["effort"]) > 2 else np.nan for m in messages]
    np.testing.assert_array_equal(found.channels["/drive.effort[2]"].values, expected)


@given(st.lists(st.sampled_from([0, 1, 2, 5]), min_size=1, max_size=80), st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_any_mixture_of_layouts(tmp_path_factory, lengths, seed):
    path = tmp_path_factory.mktemp("mix") / "a.mcap"
    rng = np.random.default_rng(seed)
    messages = encodings.rows(len(lengths), STEP, START, seed)
    for message, length in zip(messages, lengths, strict=True):
        message["name"] = [f"j{i}" for i in range(length)]
        message["effort"] = rng.normal(size=length).tolist()
        message["counts"] = int(rng.integers(-2, 2)) << int(rng.integers(0, 30))
        message["note"] = "é" * int(rng.integers(0, 3))
    for encoding in ("cdr", "protobuf"):
        encodings.write(path, encoding, messages, chunk=2000)
        found = everything(path)
        for name in ("torque", "speed", "counts", "temperature", "state"):
            np.testing.assert_array_equal(found.channels[f"/drive.{name}"].values, [m[name] for m in messages])
        if max(lengths) == 5:
            np.testing.assert_array_equal(found.channels["/drive.effort[name=j4]"].values,
                                          [m["effort"][4] if len(m["effort"]) == 5 else np.nan for m in messages])


def test_every_encoding_gives_the_same_experiment(tmp_path):
    messages = encodings.rows(200, STEP, START)
    found = []
    for encoding in encodings.ENCODINGS:
        encodings.write(tmp_path / "a.mcap", encoding, messages)
        found.append(open_experiment(tmp_path / "a.mcap", channel_map()))
    assert set(found[0].signals) == set(channel_map().roles)
    for one in found:
        assert set(one.signals) == set(found[0].signals)
        assert (one.step, one.start, one.segments, one.findings) == (
            found[0].step, found[0].start, found[0].segments, ())
        for role, values in one.signals.items():
            assert values.tobytes() == found[0].signals[role].tobytes()


@pytest.mark.parametrize(("encoding", "stamp"), [
    ("json", "header.stamp"), ("cdr", "header.stamp"), ("cdr", "/drive.header.stamp"), ("ros1", "header.stamp"),
    ("protobuf", "header.stamp"), ("cdr", "log_time"), ("cdr", "publish_time")])
def test_clocks(tmp_path, encoding, stamp):
    messages = encodings.rows(100, STEP, START)
    encodings.write(tmp_path / "a.mcap", encoding, messages)
    found = read_recording(tmp_path / "a.mcap", channel_map(time=stamp))
    for channel in found.channels.values():
        np.testing.assert_array_equal(channel.time, np.arange(100) * STEP / 10**9)
    late = 1e-3 * (stamp == "publish_time")
    assert found.origin == pytest.approx(START / 1e9 + late, abs=3e-7)


def test_topics_at_different_rates_with_clocks_of_their_own(tmp_path):
    fast, slow = encodings.rows(100, STEP, START), encodings.rows(40, 1_000_000, START + 70_000, seed=4)
    encodings.write_topics(tmp_path / "a.mcap", [("/drive1", "cdr", fast), ("/drive2", "protobuf", slow),
                                                 ("/other", "json", slow)])
    found = everything(tmp_path / "a.mcap")
    np.testing.assert_array_equal(found.channels["/drive1.torque"].values, [m["torque"] for m in fast])
    np.testing.assert_array_equal(found.channels["/drive2.torque"].values, [m["torque"] for m in slow])
    slow_time = (70_000 + np.arange(40) * 1_000_000) / 10**9
    np.testing.assert_array_equal(found.channels["/drive2.torque"].time, slow_time)
    with pytest.raises(BadRecording, match=r"one channel 'torque'.*/drive1\.torque, /drive2\.torque, /other\.torq"):
        read_recording(tmp_path / "a.mcap", channel_map())
    roles = {"motor_torque": "/drive1.torque", "motor_speed": {"channel": "/drive2.speed", "time": "publish_time"}}
    found = read_recording(tmp_path / "a.mcap", channel_map(roles, time="header.stamp"))
    assert found.channels["/drive2.speed"].time[0] == pytest.approx(1_070_000e-9, rel=1e-12)
    assert found.channels["/drive1.torque"].time[0] == 0.0


def test_units_in_the_file(tmp_path):
    messages = encodings.rows(60, STEP, START)
    for encoding, torque in (("json", "Nm"), ("cdr", "Nm"), ("ros1", "Nm"), ("protobuf", None)):
        encodings.write(tmp_path / "a.mcap", encoding, messages, metadata={"unit:counts": "deg"})
        found = everything(tmp_path / "a.mcap")
        assert found.channels["/drive.torque"].unit == torque
        assert found.channels["/drive.counts"].unit == "deg"
        assert found.channels["/drive.effort[name=load]"].unit == ("Nm" if encoding == "json" else None)


def test_unknown_encodings_are_reported(tmp_path):
    path = tmp_path / "a.mcap"
    encodings.write(path, "cdr", encodings.rows(60, STEP, START), compression=CompressionType.NONE)
    raw = path.read_bytes()
    path.write_bytes(raw.replace(b"ros2msg", b"ros2idl"))
    with pytest.raises(BadRecording, match="checksum"):
        read_recording(path)  # the change is in a chunk
    encodings.write(path, "cdr", encodings.rows(60, STEP, START), chunked=False)
    path.write_bytes(path.read_bytes().replace(b"ros2msg", b"ros2idl"))
    with pytest.raises(BadRecording, match=r"only /drive \(encoding cdr with schema encoding ros2idl, not ros2msg"):
        read_recording(path)
    assert everything(path).unreadable == {"/drive": "encoding cdr with schema encoding ros2idl, not ros2msg"}


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
@pytest.mark.parametrize("definition", [b"", b" \n", b"# of the bridge\nint8 MOST=3\n"])
@pytest.mark.parametrize("beside", [False, True])
def test_an_empty_definition_is_reported(tmp_path, encoding, definition, beside):
    name, kind, _, _, texts = encodings.encoded(encoding, encodings.rows(60, STEP, START))
    log = Log([(name, kind, definition), ("std/Empty", kind, b"")],
              [("/drive", encoding, 1, {}), ("/event", encoding, 2, {}), ("/other", "json", 0, {})],
              [[(1, START + k * STEP, 0, text) for k, text in enumerate(texts)],
               [(2, START, 0, b"\0\1\0\0\0" if encoding == "cdr" else b"")],
               [(3, START, 0, b'{"x": 1}')]][:2 + beside])
    (tmp_path / "a.mcap").write_bytes(build(log))
    why = f"the definition of its schema {name} is empty"
    assert everything(tmp_path / "a.mcap").unreadable == {"/drive": why}  # a type without fields is no fault
    with pytest.raises(BadRecording) as problem:
        read_recording(tmp_path / "a.mcap", channel_map())
    assert f"/drive ({why})" in problem.value.found
    assert problem.value.available == (("/other.x",) if beside else ())


@pytest.mark.parametrize("kind", ["ros2idl", "omgidl"])
def test_definitions_in_idl_are_refused_by_name_beside_the_channels_there_are(tmp_path, kind):
    log = Log([("plant/msg/Drive", kind, b"module plant { struct Drive { double torque; }; };")],
              [("/drive", "cdr", 1, {}), ("/other", "json", 0, {})],
              [[(1, START, 0, bytes(12))], [(2, START, 0, b'{"x": 1}')]])
    (tmp_path / "a.mcap").write_bytes(build(log))
    with pytest.raises(BadRecording) as problem:
        read_recording(tmp_path / "a.mcap", channel_map({"motor_torque": "/drive.torque"}))
    assert f"/drive (encoding cdr with schema encoding {kind}, not ros2msg)" in problem.value.found
    assert problem.value.available == ("/other.x",)


def test_schema_without_the_field_lists_those_there_are(tmp_path):
    encodings.write(tmp_path / "a.mcap", "cdr", encodings.rows(60, STEP, START))
    with pytest.raises(BadRecording, match=r"'torqe' for motor_torque.*/drive.torque, .*effort\[name=motor\]"):
        read_recording(tmp_path / "a.mcap", channel_map({"motor_torque": "torqe"}))
    with pytest.raises(BadRecording, match=r"time field 'stamp' in topic /drive.*header\.stamp\.sec"):
        read_recording(tmp_path / "a.mcap", channel_map(time="stamp"))


def test_cdr_of_both_byte_orders_and_versions():
    text = "uint8 a\nfloat64 x\nuint8[] few\nint16[2] pair\nstring s\nbool ok\n"
    for order, kind in itertools.product("<>", (0, 6)):
        head = bytes([0, kind + (order == "<"), 0, 0])
        pad = 7 if kind == 0 else 3
        message = head + struct.pack(f"{order}B{pad}xdIBBhh2xI3s?", 7, -1.5, 2, 3, 4, -5, 6, 3, b"ab\0", True)
        shape, _ = ros_walk("t/T", text, cdr=True)
        columns = layout.BinaryColumns(shape, [("a",), ("x",), ("few", 1), ("pair", 0), ("ok",)])
        places = Offsets.of(np.frombuffer(message, np.uint8), np.array([0]))
        found, good = columns.read(places, np.array([len(message)]))
        assert good.all() and [column[0] for column in found] == [7, -1.5, 4, -5, 1]


def test_json_values_of_changing_kind(tmp_path):
    messages = encodings.rows(60, STEP, START)
    for k, value in enumerate([[1, 2], "3", True, None, {"a": 1}], 7):
        messages[k]["torque"] = value
    encodings.write(tmp_path / "a.mcap", "json", messages)
    found = everything(tmp_path / "a.mcap").channels["/drive.torque"].values
    np.testing.assert_array_equal(found[5:13], [messages[5]["torque"], messages[6]["torque"], np.nan, np.nan, 1.0,
                                                np.nan, np.nan, messages[12]["torque"]])


def test_a_message_that_is_no_text(tmp_path):
    encodings.write(tmp_path / "a.mcap", "json", encodings.rows(60, STEP, START), chunked=False)
    raw = (tmp_path / "a.mcap").read_bytes()
    at = raw.index(b'"motor"', len(raw) // 2)
    (tmp_path / "a.mcap").write_bytes(raw[:at + 2] + b"\xb5" + raw[at + 3:])
    found = everything(tmp_path / "a.mcap")
    assert [f.code for f in found.findings] == ["log-damaged"]
    assert len(found.channels["/drive.torque"].values) == 59


def test_samples_teach_lists_that_begin_empty(tmp_path):
    messages = encodings.rows(200, STEP, START)
    for message in messages[:100]:
        message["name"], message["effort"] = [], []
    encodings.write(tmp_path / "a.mcap", "cdr", messages)
    found = everything(tmp_path / "a.mcap").channels["/drive.effort[name=motor]"].values
    assert np.all(np.isnan(found[:100])) and found[199] == messages[199]["effort"][0]


def test_a_broken_message_is_left_out_and_said(tmp_path):
    messages = encodings.rows(80, STEP, START)
    for encoding in ("cdr", "protobuf", "ros1"):
        encodings.write(tmp_path / "a.mcap", encoding, messages, chunked=False)
        opened = McapSource(tmp_path / "a.mcap")
        fields = open_topic(opened.topics["/drive"])
        block = next(opened.blocks())
        _, places, lengths = block.of([1])
        lengths[40] -= 5
        (torque,), good = fields.columns([("torque",)]).read(places, lengths)
        assert list(np.flatnonzero(~good)) == [40]
        np.testing.assert_array_equal(torque[good], [m["torque"] for k, m in enumerate(messages) if k != 40])


def test_files_that_do_not_fit_into_memory_are_read_twice(tmp_path, monkeypatch):
    encodings.write(tmp_path / "a.mcap", "cdr", encodings.rows(300, STEP, START))
    once = everything(tmp_path / "a.mcap")
    monkeypatch.setattr(source, "MAX_CACHED_BYTES", 3000)
    twice = everything(tmp_path / "a.mcap")
    assert set(twice.channels) == set(once.channels) >= {"/drive.torque", "/drive.speed"}
    for name, channel in once.channels.items():
        assert channel.values.tobytes() == twice.channels[name].values.tobytes()


@given(st.lists(st.sampled_from([1, 5, 30]), max_size=30), st.integers(1, 40), st.integers(0, 9), st.booleans())
def test_records_are_found_one_by_one_or_in_runs(lengths, count, cut, zero):
    for every in (lengths, lengths + [7] * count, [7] * count, [7] * count + lengths):
        raw = b"".join(struct.pack("<BQ", 5, n) + bytes(n) for n in every) + bytes(50 if zero else 0)
        kept = raw[:len(raw) - cut]
        expected, at = [], 0
        for n in every:
            if at + 9 + n <= len(kept):
                expected.append(at + 9)
            at += 9 + n
        found = read_records(np.frombuffer(kept, np.uint8))
        assert found.starts.tolist() == expected
        assert found.lengths.tolist() == every[:len(expected)] and found.others == {}
        assert (found.end == len(kept)) == (sum(every) + 9 * len(every) == len(kept) and not zero)


def test_a_column_turns_to_floats_with_its_first_float():
    column = Collector(5)
    column.add(np.array([1, 2**62]))
    assert column.values.tolist() == [1, 2**62] and column.values.dtype.kind == "i"
    column.add(np.array([0.5]))
    column.add(np.array([3]))
    assert column.values.tolist() == [1.0, 2.0**62, 0.5, 3.0]


@pytest.mark.parametrize("size", [10, 1 << 40, (1 << 64) - 1])
def test_a_chunk_with_a_wrong_size_costs_itself(tmp_path, size):
    encodings.write(tmp_path / "a.mcap", "cdr", encodings.rows(100, STEP, START))
    raw = bytearray((tmp_path / "a.mcap").read_bytes())
    at, which = 8, 0
    while raw[at] != 6 or which < 1:
        which += raw[at] == 6
        at += 9 + struct.unpack_from("<Q", raw, at + 1)[0]
    struct.pack_into("<QI", raw, at + 9 + 16, size, 0)  # the size, and no checksum that would show it
    (tmp_path / "a.mcap").write_bytes(raw)
    found = everything(tmp_path / "a.mcap")
    assert 30 < len(found.channels["/drive.speed"].values) < 100
    assert [f.code for f in found.findings] == ["log-damaged"]


STEPS = st.lists(st.from_regex(r"[a-z_]{1,5}", fullmatch=True) | st.integers(0, 99)
                 | st.builds(field_path.Selector, st.just("name"),
                             st.from_regex(r"[a-z0-9 .]{1,5}", fullmatch=True)))


@given(st.from_regex(r"[a-z]{1,5}", fullmatch=True), STEPS)
def test_paths_are_written_as_they_are_read(first, steps):
    path = tuple(step if not isinstance(step, field_path.Selector)
                 else field_path.Selector("name", step.value.strip())
                 for step in (first, *steps))
    assert field_path.parse(field_path.text_of(path)) == path


def test_elements_of_lists_of_messages():
    tree = {"axes": [{"name": "x", "torque": 1.0}, {"name": "y", "torque": 2.0}], "other": [3.0, 4.0]}
    listed = [field_path.text_of(path) for path in field_path.paths(tree, lambda v: isinstance(v, float))]
    assert listed == ["axes[name=x].torque", "axes[name=y].torque", "other[0]", "other[1]"]
    assert field_path.find(tree, field_path.parse("axes[name=y].torque")) == 2.0
    assert field_path.find(tree, field_path.parse("axes[name=z].torque")) is None
    assert field_path.parse("a[") is None and field_path.parse("a[x]") is None and field_path.parse("") is None
