"""Parquet and MCAP: the same data gives the same Experiment, and bad files one clear sentence."""

import json
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import CompressionType, Writer

from drivetool.errors import BadOption, BadRecording, NotEnoughData
from drivetool.logs.channels.channel_map import SCHEMA, ChannelMap
from drivetool.logs.door.build import open_experiment
from drivetool.logs.formats.read import read_recording

N, STEP_NS = 400, 400_000


def data(n=N, seed=3):
    """Torque and speed with full mantissas, so that any rounding shows."""
    rng = np.random.default_rng(seed)
    return {"motor_torque": rng.normal(size=n), "motor_speed": 100 + rng.normal(size=n)}


UNITS = {"motor_torque": "Nm", "motor_speed": "rad/s", "n": "rpm", "iq": "A"}


def write_parquet(path, columns, time="ns", **metadata):
    n = len(next(iter(columns.values())))
    ns = np.arange(n) * STEP_NS
    stamps = {"float": ("time", pa.array(ns / 1e9), None), "integer": ("t", pa.array(ns // 1000), "us"),
              "suffix": ("time_us", pa.array(ns // 1000), None),
              "ns": ("timestamp", pa.array(ns, pa.timestamp("ns")), None),
              "duration": ("t", pa.array(ns // 1000, pa.duration("us")), None),
              "nounit": ("t", pa.array(ns), None), "none": None}[time]
    fields, arrays = [], []
    if stamps:
        name, array, unit = stamps
        fields.append(pa.field(name, array.type, metadata={"unit": unit} if unit else None))
        arrays.append(array)
    for name, values in columns.items():
        array = pa.array(values)
        fields.append(pa.field(name, array.type, metadata={"unit": UNITS[name]} if name in UNITS else None))
        arrays.append(array)
    pq.write_table(pa.table(arrays, schema=pa.schema(fields, metadata=metadata or None)), path)
    return path


def write_mcap(path, columns, topic="/drive", nested=None, encoding="json", start=0,
               compression=CompressionType.ZSTD, chunk=4096):
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, chunk_size=chunk)
        writer.start()
        inner = {"type": "object", "properties": {
            name: {"type": "number", **({"unit": UNITS[name]} if name in UNITS else {})} for name in columns}}
        schema = inner if nested is None else {"type": "object", "properties": {nested: inner}}
        sid = writer.register_schema("drive", "jsonschema", json.dumps(schema).encode())
        cid = writer.register_channel(topic, encoding, sid)
        for k, row in enumerate(zip(*columns.values(), strict=True)):
            message = {name: float(value) for name, value in zip(columns, row, strict=True)}
            if nested is not None:
                message = {nested: message}
            writer.add_message(cid, start + k * STEP_NS, json.dumps(message).encode(), start + k * STEP_NS)
        writer.finish()
    return path


def channel_map(roles, **more):
    return ChannelMap.from_mapping({"schema": SCHEMA, "roles": roles, **more})


def content(experiment):
    """Everything in an experiment but where it came from."""
    return {"step": experiment.step, "start": experiment.start, "segments": experiment.segments,
            "units": (experiment.torque_unit, experiment.motion_unit, experiment.torque_is),
            "findings": experiment.findings,
            "signals": {role: values.tobytes() for role, values in experiment.signals.items()}}


def test_both_formats_give_the_same_experiment_bit_by_bit(tmp_path):
    columns = data()
    a = open_experiment(write_parquet(tmp_path / "a.parquet", columns, "float"))
    b = open_experiment(write_mcap(tmp_path / "a.mcap", columns))
    assert content(a) == content(b)
    assert a.step == 0.0004 and a.start == 0.0 and a.segments == ((0, N),) and a.findings == ()
    for role, values in columns.items():
        assert a.signals[role].tobytes() == values.tobytes()
        assert not a.signals[role].flags.writeable
    assert a.name == "a.parquet" and len(a.sha256) == 64 and a.sha256 != b.sha256


@pytest.mark.parametrize("time", ["float", "integer", "suffix", "ns", "duration"])
def test_every_kind_of_time_column(tmp_path, time):
    reference = open_experiment(write_parquet(tmp_path / "r.parquet", data(), "float"))
    assert content(open_experiment(write_parquet(tmp_path / "x.parquet", data(), time))) == content(reference)


def test_step_from_the_metadata(tmp_path):
    found = open_experiment(write_parquet(tmp_path / "x.parquet", data(), "none", step="0.0004"))
    assert found.step == 0.0004 and found.size == N


@pytest.mark.parametrize("compression", list(CompressionType))
def test_every_compression(tmp_path, compression):
    reference = open_experiment(write_mcap(tmp_path / "r.mcap", data()))
    found = open_experiment(write_mcap(tmp_path / "x.mcap", data(), compression=compression))
    assert content(found) == content(reference)


def test_a_clock_since_1970_keeps_its_nanoseconds(tmp_path):
    found = open_experiment(write_mcap(tmp_path / "x.mcap", data(), start=1_700_000_000_123_456_789))
    assert found.step == 0.0004 and found.findings == ()
    assert found.start == pytest.approx(1_700_000_000.123456789, abs=1e-6)


def test_map_in_both_formats(tmp_path):
    columns = {"iq": data()["motor_torque"], "n": data()["motor_speed"], "other": np.zeros(N)}
    roles = {"motor_torque": {"channel": "iq", "sign": -1, "scale": 2, "offset": 0.5}, "motor_speed": "n"}
    given = channel_map(roles, torque_is="command")
    a = open_experiment(write_parquet(tmp_path / "a.parquet", columns), given)
    b = open_experiment(write_mcap(tmp_path / "a.mcap", columns, nested="actual"), given)
    assert content(a) == content(b)
    assert a.torque_unit == "A" and a.torque_is == "command"
    np.testing.assert_array_equal(a.signals["motor_torque"], -(2 * columns["iq"] + 0.5))
    np.testing.assert_allclose(a.signals["motor_speed"], columns["n"] * np.pi / 30, rtol=1e-15)


def test_percent_of_rated(tmp_path):
    path = write_parquet(tmp_path / "a.parquet", {"m": np.linspace(-100, 100, N), "n": np.arange(float(N))})
    found = open_experiment(path, channel_map({
        "motor_torque": {"channel": "m", "unit": "%", "rated": {"value": 0.2, "unit": "kNm"}},
        "motor_speed": {"channel": "n", "unit": "1", "rated": {"value": 3000, "unit": "rpm"}}}))
    np.testing.assert_allclose(found.signals["motor_torque"], np.linspace(-200, 200, N), rtol=1e-14)
    np.testing.assert_allclose(found.signals["motor_speed"], np.arange(N) * 3000 * np.pi / 30, rtol=1e-14)
    assert found.torque_unit == "Nm"


def test_only_the_needed_columns_are_read(tmp_path):
    path = write_parquet(tmp_path / "a.parquet", {**data(), "big": np.zeros(N)})
    assert set(read_recording(path).channels) == {"motor_torque", "motor_speed"}
    every = read_recording(path, choose=lambda names: names)
    assert set(every.channels) == {"motor_torque", "motor_speed", "big"}


def test_mcap_time_from_a_field(tmp_path):
    columns = {**data(), "t": np.arange(N) * 2.0}
    found = open_experiment(
        write_mcap(tmp_path / "a.mcap", columns),
        channel_map({"motor_torque": "motor_torque", "motor_speed": "motor_speed"},
                    time={"channel": "t", "unit": "ms"}))
    assert found.step == 0.002


def test_missing_fields_and_nan_become_missing_values(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        cid = writer.register_channel("/d", "json", 0)
        for k in range(100):
            message = {"motor_torque": k * 1.0, "motor_speed": float("nan") if k == 7 else k}
            if k == 5:
                del message["motor_speed"]
            text = b"{broken" if k == 20 else json.dumps(message).encode()
            writer.add_message(cid, k * 1_000_000, text, 0)
        writer.finish()
    found = open_experiment(path, channel_map({"motor_torque": {"channel": "motor_torque", "unit": "N"},
                                               "motor_speed": {"channel": "motor_speed", "unit": "m/s"}}))
    assert list(np.flatnonzero(np.isnan(found.signals["motor_speed"]))) == [5, 7, 20]
    assert found.signals["motor_torque"][20] == 19.0
    assert {f.code for f in found.findings} == {"log-damaged", "samples-missing"}
    assert (found.torque_unit, found.motion_unit) == ("N", "m")


@pytest.mark.parametrize("share", [0.35, 0.6, 0.9, 0.999])
def test_a_cut_file_is_used_as_far_as_it_goes(tmp_path, share):
    whole = write_mcap(tmp_path / "a.mcap", data())
    raw = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(raw[:int(share * len(raw))])
    found = open_experiment(cut)
    assert 50 <= found.size <= N
    assert found.signals["motor_speed"].tobytes() == data()["motor_speed"][:found.size].tobytes()
    damaged = next(f for f in found.findings if f.code == "log-damaged")
    assert damaged.severity == "warning" and damaged.evidence["messages"] == found.size


def test_a_damaged_chunk_is_left_out(tmp_path):
    raw = bytearray(write_mcap(tmp_path / "a.mcap", data(), compression=CompressionType.NONE).read_bytes())
    at = raw.index(b'{"motor_torque": ', len(raw) // 3) + 20
    raw[at] = ord("1") if raw[at] != ord("1") else ord("2")
    (tmp_path / "b.mcap").write_bytes(raw)
    found = open_experiment(tmp_path / "b.mcap")
    assert {f.code for f in found.findings} == {"log-damaged", "recording-interrupted"}
    assert len(found.segments) == 2 and found.size == N


def empty(tmp_path, name):
    (tmp_path / name).write_bytes(b"")
    return tmp_path / name


def garbage(tmp_path, name):
    (tmp_path / name).write_bytes(b"time;torque\n0;1\n" * 20)
    return tmp_path / name


def text_column(tmp_path, name):
    return write_parquet(tmp_path / name, {"motor_torque": ["a"] * N, "motor_speed": data()["motor_speed"]})


BAD = {
    "missing": (lambda d: d / "a.parquet", BadRecording, ["no file", "Check the path"]),
    "suffix": (lambda d: garbage(d, "a.csv"), BadRecording, ["a.csv", ".parquet", ".mcap"]),
    "folder": (lambda d: d, BadRecording, ["folder"]),
    "empty parquet": (lambda d: empty(d, "a.parquet"), BadRecording, ["empty file", "a.parquet"]),
    "empty mcap": (lambda d: empty(d, "a.mcap"), BadRecording, ["empty file"]),
    "not parquet": (lambda d: garbage(d, "a.parquet"), BadRecording, ["a Parquet file in a.parquet"]),
    "not mcap": (lambda d: garbage(d, "a.mcap"), BadRecording, ["an MCAP file in a.mcap"]),
    "no rows": (lambda d: write_parquet(d / "a.parquet", data(0)), BadRecording, ["table without rows"]),
    "no messages": (lambda d: write_mcap(d / "a.mcap", data(0)), BadRecording, ["messages in a.mcap"]),
    "other encoding": (lambda d: write_mcap(d / "a.mcap", data(), encoding="cdr"), BadRecording,
                       ["(json, cdr, ros1, protobuf)", "/drive (encoding cdr with schema encoding jsonschema"]),
    "no time": (lambda d: write_parquet(d / "a.parquet", data(), "none"), BadRecording,
                ["a time column", "motor_torque", "timestamp"]),
    "integer time": (lambda d: write_parquet(d / "a.parquet", data(), "nounit"), BadRecording,
                     ["unit of time", "integer time column 't'", "ms"]),
    "no roles": (lambda d: write_parquet(d / "a.parquet", {"n": np.arange(9.0)}), BadRecording,
                 ["named like the roles", "available: n", "--map"]),
    "text": (lambda d: text_column(d, "a.parquet"), BadRecording, ["numbers in channel 'motor_torque'"]),
    "short": (lambda d: write_parquet(d / "a.parquet", data(30)), NotEnoughData, ["at least 50", "found 30"]),
}


def test_a_parquet_log_does_not_import_what_reads_mcap(tmp_path):
    write_parquet(tmp_path / "a.parquet", data())
    code = ("import sys; from drivetool.logs.door.build import open_experiment; "
            "open_experiment(sys.argv[1]); print(*{m.partition('.')[0] for m in sys.modules})")
    done = subprocess.run([sys.executable, "-c", code, tmp_path / "a.parquet"], capture_output=True, text=True)
    loaded = set(done.stdout.split())
    assert "pyarrow" in loaded and not {"mcap", "lz4", "zstandard"} & loaded, done.stderr


@pytest.mark.parametrize("case", BAD)
def test_bad_files(tmp_path, case):
    make, kind, words = BAD[case]
    with pytest.raises(kind) as caught:
        open_experiment(make(tmp_path))
    for word in words:
        assert word in str(caught.value)


def test_unit_missing_in_the_log(tmp_path):
    path = write_parquet(tmp_path / "a.parquet", {"x": np.arange(100.0)})
    with pytest.raises(BadRecording, match=r"unit of torque for motor_torque.*none.*Nm, mNm"):
        open_experiment(path, channel_map({"motor_torque": "x"}))


@pytest.mark.parametrize("unit, factor, si", [
    ("A", 1.0, "A"), ("kA", 1e3, "A"), ("V", 1.0, "V"), ("mV", 1e-3, "V"), ("%", 1.0, "%"), ("pu", 100.0, "%")])
def test_the_input_of_a_motor_stays_in_its_own_unit(tmp_path, unit, factor, si):
    """Alone it is the unit of all torques; beside another torque in Nm its role says so."""
    n = np.arange(100.0)
    path = write_parquet(tmp_path / "a.parquet", {"m": n, "s": n, "w": n})
    roles = {"motor_torque": {"channel": "m", "unit": unit, "scale": 2.0, "sign": -1},
             "motor_speed": {"channel": "w", "unit": "rad/s"}}
    alone = open_experiment(path, channel_map(roles))
    beside = open_experiment(path, channel_map(roles | {"shaft_torque": {"channel": "s", "unit": "mNm"}}))
    for e in (alone, beside):
        np.testing.assert_allclose(e.signals["motor_torque"], -2.0 * factor * n, rtol=1e-14)
        assert e.unit("motor_torque") == si
    assert (alone.torque_unit, alone.input_units) == (si, {})
    assert (beside.torque_unit, beside.input_units) == ("Nm", {"motor_torque": si})
    assert beside.unit("shaft_torque") == "Nm"


def test_percent_without_rated_is_refused_by_map_and_log(tmp_path):
    with pytest.raises(BadOption, match="rated value"):
        channel_map({"motor_speed": {"channel": "x", "unit": "%"}})
    table = pa.table([pa.array(0.01 * np.arange(100.0)), pa.array(np.arange(100.0))], schema=pa.schema(
        [pa.field("t", pa.float64()), pa.field("motor_speed", pa.float64(), metadata={"unit": "%"})]))
    pq.write_table(table, tmp_path / "a.parquet")
    with pytest.raises(BadRecording, match="rated value of motor_speed"):
        open_experiment(tmp_path / "a.parquet")


def test_missing_channel_suggests_the_nearest(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", data())
    with pytest.raises(BadRecording, match=r"'motor_torq' for motor_torque.*available: /drive.motor_torque"):
        open_experiment(path, channel_map({"motor_torque": "motor_torq"}))
