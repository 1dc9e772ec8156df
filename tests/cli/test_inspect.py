"""inspect and convert at the command line: their figures, and that a conversion changes nothing."""

import json
import re

import jsonschema
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from mcap.writer import CompressionType

from drivetool.files.figures.plot_kinds import figure
from drivetool.files.results import channel_plot
from drivetool.files.shapes.schema import schemas
from drivetool.logs.door import inspect_log, open_experiment
from tests import encodings
from tests.logs.test_condition import motion
from tests.logs.test_parquet import field

SAMPLE_COUNT, START, STEP = 2000, 1_700_000_000_000_000_000, 1_000_000
MAP = """schema: drivetool/channel-map/1
roles:
  motor_torque: {channel: torque, unit: "%", rated: {value: 20, unit: Nm}, sign: -1}
  motor_speed: {channel: speed, unit: rpm}
  load_torque: {channel: "effort[name=load]", unit: mNm}
"""


@pytest.fixture
def call(call, here):
    """The same in an empty folder, never with a traceback."""
    def run(*words, **surroundings):
        code, out, err = call(*words, **surroundings)
        assert "Traceback" not in err
        return code, out, err
    return run


def write_faulty_record(path):
    """A record with every fault that is reported of a channel."""
    speed, _ = motion(SAMPLE_COUNT)
    torque = np.round(np.sign(np.sin(np.arange(SAMPLE_COUNT) / 40)) + 0.3 * np.sin(np.arange(SAMPLE_COUNT) / 7), 2)
    speed = np.round(speed / 0.05) * 0.05
    speed[[300, 800, 1500]] += 40.0
    speed[100:103] = np.nan
    keep = np.ones(SAMPLE_COUNT, bool)
    keep[600:650] = keep[1000] = False
    fields = [field("time", unit="s"), field("motor_torque", unit="Nm"), field("n", unit="rpm"),
              field("note", pa.string())]
    columns = [np.arange(SAMPLE_COUNT) * 1e-3, torque, speed, ["x"] * SAMPLE_COUNT]
    pq.write_table(pa.table(columns, schema=pa.schema(fields)).filter(pa.array(keep)), path)
    return speed[keep]


def test_the_figures_of_a_channel(tmp_path):
    speed = write_faulty_record(tmp_path / "a.parquet")
    found = inspect_log(tmp_path / "a.parquet")
    by_name = {report.name: report for report in found.channels}
    assert set(by_name) == {"motor_torque", "n"} and found.recording.unreadable == {"note": "string"}
    n = by_name["n"]
    assert (n.unit, n.role, n.samples, n.missing, n.lost) == ("rpm", None, SAMPLE_COUNT - 51, 3, 1)
    assert n.rate == pytest.approx(1000.0, rel=1e-6) and n.duration == pytest.approx(1.999)
    assert n.range == (np.nanmin(speed), np.nanmax(speed))
    assert n.gap_times == ((pytest.approx(0.599), pytest.approx(0.65)),)
    assert n.quantum == pytest.approx(0.05) and list(n.spike_places) == [300, 750, 1449] and n.held == 1
    assert by_name["motor_torque"].role == "motor_torque"
    assert by_name["motor_torque"].quantum == pytest.approx(0.01)
    assert {"log-damaged", "recording-interrupted", "samples-missing"} <= {f.code for f in found.findings}


def test_spikes_are_where_they_were_logged_although_stamps_repeat(tmp_path):
    time = np.repeat(np.arange(1000) * 1e-3, 2)
    time[40:60] = time[40:60][::-1]
    speed = np.random.default_rng(2).uniform(size=2000)
    speed[1400] = 9.0
    pq.write_table(pa.table({"time": time, "n": speed}), tmp_path / "a.parquet")
    found = inspect_log(tmp_path / "a.parquet")
    assert list(found.channels[0].spike_places) == [1400]
    times, values = channel_plot(found).curves["spikes n [?]"]
    assert (list(times), list(values)) == ([time[1400]], [9.0])


def test_the_picture_shows_short_stretches_and_values_that_hardly_differ(tmp_path):
    time = np.arange(600) * 1e-3 + 1e4 * np.repeat(np.arange(6), 100)
    pq.write_table(pa.table({"time": time, "n": np.full(600, 3.0), "stamp": 1.7e9 + np.arange(600) % 4}),
                   tmp_path / "a.parquet")
    first, second = figure(channel_plot(inspect_log(tmp_path / "a.parquet"))).axes
    assert first.get_title() + first.get_title(loc="left") == "n [?]"
    assert len(first.lines) == 6 and {line.get_marker() for line in first.lines} == {"."}
    assert second.get_title(loc="left") + second.get_title() == "stamp [?], less 1700000000"
    assert np.ptp(second.get_ylim()) < 10 and second.get_ylim()[1] < 10


def test_inspect_as_yaml_json_and_picture(tmp_path, call):
    write_faulty_record(tmp_path / "a.parquet")
    code, out, err = call("inspect", "a.parquet", "--plot", "pictures")
    content = yaml.safe_load(out)
    assert code == 0 and content["experiment"]["segments"] == 2 and "warning recording-interrupted" in err
    jsonschema.validate(content, json.loads(schemas()["inspection.json"]))
    assert json.loads(call("inspect", "a.parquet", "--json", "-q")[1]) == content
    assert str(tmp_path) not in out and call("inspect", "a.parquet", "-q")[1] == out
    picture = (tmp_path / "pictures" / "inspect-a-channels.png").read_bytes()
    call("inspect", "a.parquet", "--plot", "again", "-q")
    assert (tmp_path / "again" / "inspect-a-channels.png").read_bytes() == picture
    assert call("inspect", "a.parquet", "--strict", "-q")[0] == 3


def test_inspect_table_on_a_terminal(tmp_path, call):
    write_faulty_record(tmp_path / "a.parquet")
    _, out, _ = call("inspect", "a.parquet", "-q", terminal=True)
    out = re.sub(r"\x1b\[[0-9;]*m", "", out)
    assert max(len(line) for line in out.splitlines() if "  a step" not in line) <= 80
    assert "motor_torque" in out and "a step receives motor_torque: 2000 samples of 0.001 s in 2 segments" in out
    assert "note: not read, string" in out


def test_show_prints_an_inspection_that_was_written(tmp_path, call):
    write_faulty_record(tmp_path / "a.parquet")
    call("inspect", "a.parquet", "--out", "i.yaml", "-q")
    code, out, err = call("show", "i.yaml")
    assert (code, err) == (0, "") and "note: not read, string" in out
    assert "a step receives motor_torque: 2000 samples of 0.001 s in 2 segments" in out
    assert "warning recording-interrupted" in out
    text = (tmp_path / "i.yaml").read_text()
    (tmp_path / "i.yaml").write_text(text.replace("samples: 1949", "samples: many", 1))
    code, out, err = call("show", "i.yaml")
    assert (code, out) == (1, "") and "at channels[0].samples" in err and "schemas/inspection.json" in err


@pytest.mark.parametrize("first, message", [
    ("schema: drivetool/channel-map/1", "A channel map is an input: 'drivetool inspect LOG --map FILE'"),
    ("schema: drivetool/inspection/0", "Write the file again"), ("schema: [1]", "[1] in a.yaml"),
    ("roles: {}", "Begin a parameter file with 'schema: drivetool/parameters/1'")])
def test_show_lists_what_it_prints(tmp_path, call, first, message):
    (tmp_path / "a.yaml").write_text(first + "\n")
    code, out, err = call("show", "a.yaml")
    assert (code, out, err.count("\n")) == (1, "", 1) and message in err
    assert all(f"drivetool/{kind}/1" in err for kind in (
        "parameters", "validation", "gains", "spectra", "comparison", "inspection"))


def test_inspect_reports_what_a_step_would_refuse(tmp_path, call):
    messages = encodings.rows(200, STEP, START)
    encodings.write(tmp_path / "a.mcap", "cdr", messages)
    code, out, err = call("inspect", "a.mcap")
    assert code == 0 and yaml.safe_load(out)["experiment"] is None and "recording-not-usable" in err
    (tmp_path / "map.yaml").write_text(MAP.replace("channel: speed", "channel: sped"))
    code, out, err = call("inspect", "a.mcap", "--map", "map.yaml")
    roles = {c["name"]: c["role"] for c in yaml.safe_load(out)["channels"]}
    assert code == 0 and roles["/drive.torque"] == "motor_torque" and "channel-map-mismatch" in err
    assert "several channels" not in err
    (tmp_path / "map2.yaml").write_text(MAP)
    time = np.arange(60) * 1e-3
    names = ["time", "/drive.torque", "/drive.speed", "/spare.speed"]
    pq.write_table(pa.table([time, np.sin(time), np.cos(time), np.cos(time)], names=names), tmp_path / "b.parquet")
    assert "channel-map-mismatch" in call("inspect", "b.parquet", "--map", "map2.yaml")[2]
    # Half of the file, and a clock that jumps: both are reported, nothing fails.
    raw = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(raw[:len(raw) // 2])
    code, out, err = call("inspect", "cut.mcap")
    assert code == 0 and yaml.safe_load(out)["channels"][0]["samples"] > 10 and "log-damaged" in err
    for message in messages[100:]:
        message["stamp"] -= 50 * STEP
    from mcap.writer import Writer

    with (tmp_path / "back.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        name, kind, schema, encoding, texts = encodings.encoded("cdr", messages)
        cid = writer.register_channel("/drive", encoding, writer.register_schema(name, kind, schema))
        for message, text in zip(messages, texts, strict=True):
            writer.add_message(cid, message["stamp"], text, 0)
        writer.finish()
    code, out, err = call("inspect", "back.mcap", "--map", "map.yaml")
    assert code == 0 and "does not go backwards" in yaml.safe_load(out)["channels"][0]["clock"]


def test_inspect_fails_only_on_what_cannot_be_read(tmp_path, call):
    (tmp_path / "a.mcap").write_bytes(b"time;torque\n0;1\n")
    code, out, err = call("inspect", "a.mcap")
    assert code == 1 and out == "" and err.count("\n") == 1 and "an MCAP file" in err


def write_everything(folder):
    """One experiment in every encoding and layout: name of the file -> map or none."""
    rng = np.random.default_rng(11)
    speed = np.repeat([20.0, 40.0, 60.0, 80.0], 600) + 0.01 * rng.normal(size=2400)
    torque = 5 + 0.1 * np.repeat([20.0, 40.0, 60.0, 80.0], 600) + 0.05 * rng.normal(size=2400)
    messages = encodings.rows(2400, STEP, START)
    for k, message in enumerate(messages):
        message["torque"], message["speed"] = torque[k], speed[k]
    paths = []
    for encoding in encodings.ENCODINGS:
        for name, options in {"": {}, "-lz4": {"compression": CompressionType.LZ4}, "-loose": {"chunked": False},
                              "-unindexed": {"index": False}}.items():
            paths.append(folder / f"{encoding}{name}.mcap")
            encodings.write(paths[-1], encoding, messages, **options)
    stamps = pa.array([m["stamp"] for m in messages], pa.timestamp("ns"))
    table = pa.table({"time": stamps, "torque": torque, "speed": speed})
    paths += [folder / "wide.parquet", folder / "long.parquet", folder / "folder"]
    pq.write_table(table, paths[-3])
    twice = stamps.take(np.repeat(np.arange(2400), 2))
    pq.write_table(pa.table({"channel": ["torque", "speed"] * 2400, "time": twice,
                             "value": np.column_stack([torque, speed]).ravel()}), paths[-2])
    paths[-1].mkdir()
    pq.write_metadata(table.schema, paths[-1] / "_common_metadata")
    for i in range(4):
        pq.write_table(table.slice(600 * i, 600), paths[-1] / f"{i}.parquet", row_group_size=70)
    (folder / "map.yaml").write_text("""schema: drivetool/channel-map/1
roles: {motor_torque: {channel: torque, unit: Nm}, motor_speed: {channel: speed, unit: rad/s}}
""")
    return paths


def without_data(text):
    content = yaml.safe_load(text)
    name = content["data"][0]["file"]
    lines = [line for line in text.replace(name, "LOG").splitlines() if "sha256" not in line]
    return "\n".join(lines)


@pytest.mark.slow
def test_every_encoding_and_layout_gives_the_same_experiment_and_file(tmp_path, call):
    from drivetool.files.yaml import load_channel_map

    seen = {}
    paths = write_everything(tmp_path)
    first = open_experiment(paths[0], load_channel_map(tmp_path / "map.yaml"))
    for path in paths:
        one = open_experiment(path, load_channel_map(tmp_path / "map.yaml"))
        assert (one.segments, one.torque_unit, one.motion_unit, one.findings) == (
            first.segments, first.torque_unit, first.motion_unit, ())
        for role, values in first.signals.items():
            np.testing.assert_allclose(one.signals[role], values, rtol=1e-12, atol=0)
        np.testing.assert_allclose(one.time, first.time, rtol=0, atol=1e-12)
        code, out, err = call("steady", path.name, "--map", "map.yaml", "--condition", "lowpass cutoff=300")
        assert code in (0, 3), err
        seen[path.name] = without_data(out)
    assert len(seen) == 19 and set(seen.values()) == {seen["wide.parquet"]}
    content = yaml.safe_load(seen["wide.parquet"])
    assert content["parameters"]["total.viscous"]["value"] == pytest.approx(0.1, rel=0.01)
    assert content["options"]["condition"] == ["lowpass cutoff=300"]
    assert content["findings"][0]["code"] == "conditioned"


def assert_same_recording(one, other):
    return (one.step, one.start, one.segments, one.torque_unit, one.motion_unit) == (
        other.step, other.start, other.segments, other.torque_unit, other.motion_unit) and all(
        np.array_equal(values, other.signals[role], equal_nan=True) for role, values in one.signals.items())


@pytest.mark.parametrize("two_clocks", [False, True])
def test_convert_changes_nothing(tmp_path, call, two_clocks):
    from drivetool.files.yaml import load_channel_map

    messages = encodings.rows(200, STEP, START)
    (tmp_path / "map.yaml").write_text(MAP.replace("channel: speed", "channel: /other.speed" if two_clocks else
                                                   "channel: /drive.speed").replace(": torque", ": /drive.torque")
                                       .replace('"effort', '"/drive.effort'))
    encodings.write_topics(tmp_path / "a.mcap", [
        ("/drive", "cdr", messages), ("/other", "protobuf", encodings.rows(90, 2 * STEP, START + 300_000, seed=5))])
    code, out, err = call("convert", "a.mcap", "--map", "map.yaml", "--out", "b.parquet")
    assert code == 0 and out == "" and "wrote b.parquet: 200 of motor_torque [Nm]" in err
    one = open_experiment(tmp_path / "a.mcap", load_channel_map(tmp_path / "map.yaml"))
    assert assert_same_recording(one, open_experiment(tmp_path / "b.parquet"))
    before = (tmp_path / "b.parquet").read_bytes()
    call("convert", "b.parquet", "--out", "c.parquet")
    assert (tmp_path / "c.parquet").read_bytes() == before
    assert pq.read_schema(tmp_path / "b.parquet").names == (
        ["channel", "time", "value", "unit"] if two_clocks else
        ["time", "motor_torque", "motor_speed", "load_torque"])


def test_a_converted_recording_has_the_same_bytes_whatever_was_in_memory():
    from drivetool.files.results import recording_bytes
    from drivetool.logs import Channel, Recording

    rng, seen = np.random.default_rng(1), set()
    one, other = np.arange(200) * 4e-4, np.arange(90) * 8e-4
    recording = Recording("a", "", {"motor_torque": Channel(one, np.sin(one), "Nm"), "motor_speed": Channel(
        other, np.sin(other), "rad/s"), "load_torque": Channel(one, np.cos(one), "Nm")}, ())
    for _ in range(60):
        for size in rng.integers(1, 9000, 30):
            np.frombuffer(pa.allocate_buffer(int(size)), np.uint8)[:] = rng.integers(0, 256)
        seen.add(recording_bytes(recording))
    assert len(seen) == 1


def test_a_part_of_a_folder_that_is_read_is_no_output(tmp_path, call):
    write_faulty_record(tmp_path / "a.parquet")
    (tmp_path / "parts").mkdir()
    part = tmp_path / "parts" / "0.parquet"
    part.write_bytes((tmp_path / "a.parquet").read_bytes())
    before = part.read_bytes()
    for command in ("convert", "inspect"):
        code, out, err = call(command, "parts", "-o", "parts/0.parquet")
        assert (code, out) == (2, "") and "inputs are never changed" in err
    assert part.read_bytes() == before


def test_convert_refuses(tmp_path, call):
    write_faulty_record(tmp_path / "a.parquet")
    for words, message in ((["-o", "b.csv"], "ends in .parquet"), (["-o", "a.parquet"], "inputs are never changed"),
                           (["-o", "a.parquet/b.parquet"], "which is no folder")):
        code, out, err = call("convert", "a.parquet", *words)
        assert code == 2 and out == "" and message in err and err.count("\n") == 1
