"""Parquet in every layout gives the same Experiment; what is damaged is left out and said."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from drivetool.errors import BadRecording
from drivetool.logs.channels.channel_map import SCHEMA, ChannelMap
from drivetool.logs.door.build import open_experiment
from drivetool.logs.formats.read import read_recording

N, STEP = 400, 0.0004
NAMES = {"motor_torque": "Nm", "motor_speed": "rad/s", "load_angle": "rad"}


def data(n=N):
    rng = np.random.default_rng(7)
    return {name: rng.normal(size=n) for name in NAMES}


def time(n=N):
    return np.round(np.arange(n) * STEP, 9)


def field(name, kind=None, unit=None):
    return pa.field(name, kind or pa.float64(), metadata={"unit": unit} if unit else None)


def wide(columns, **options):
    fields = [field("time", unit="s"), *(field(name, unit=NAMES[name]) for name in columns)]
    return pa.table([time(len(next(iter(columns.values())))), *columns.values()], schema=pa.schema(fields))


def write_wide(path):
    pq.write_table(wide(data()), path)


def write_groups(path):
    pq.write_table(wide(data()), path, row_group_size=64)


def write_folder(path):
    path.mkdir()
    table = wide(data())
    # By name the tenth part comes before the second, and one is empty.
    for i, first in enumerate(range(0, N, 37)):
        pq.write_table(table.slice(first, 37), path / f"part-{i}.parquet", row_group_size=10)
    pq.write_table(table.slice(0, 0), path / "part-99.parquet")


def write_long(path, shuffled=False):
    order = np.random.default_rng(1).permutation(3 * N) if shuffled else np.argsort(np.tile(np.arange(N), 3),
                                                                                    kind="stable")
    channel = np.repeat(np.array(list(NAMES)), N)[order]
    units = np.repeat(np.array(list(NAMES.values())), N)[order]
    pq.write_table(pa.table({"channel": pa.array(channel).dictionary_encode(), "time": np.tile(time(), 3)[order],
                             "value": np.concatenate(list(data().values()))[order], "unit": units}), path)


def write_nested(path):
    columns = data()
    drive = pa.StructArray.from_arrays(
        [columns["motor_torque"], columns["motor_speed"]],
        fields=[field("motor_torque", unit="Nm"), field("motor_speed", unit="rad/s")])
    joints = pa.FixedSizeListArray.from_arrays(
        np.column_stack([np.zeros(N), columns["load_angle"]]).ravel(), 2)
    stamps = pa.array(np.round(time() * 1e9).astype(np.int64), pa.timestamp("ns"))
    schema = pa.schema([field("timestamp", stamps.type), pa.field("drive", drive.type),
                        field("joints", joints.type, "rad")])
    pq.write_table(pa.table([stamps, drive, joints], schema=schema), path)


LAYOUTS = {"wide": write_wide, "groups": write_groups, "folder": write_folder, "long": write_long,
           "nested": write_nested}
NESTED = ChannelMap.from_mapping({"schema": SCHEMA, "roles": {
    "motor_torque": "drive.motor_torque", "motor_speed": "drive.motor_speed", "load_angle": "joints[1]"}})


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_experiment(tmp_path, layout):
    path = tmp_path / ("log" if layout == "folder" else "log.parquet")
    LAYOUTS[layout](path)
    found = open_experiment(path, NESTED if layout == "nested" else None)
    assert found.step == STEP and found.segments == ((0, N),) and found.findings == ()
    assert (found.torque_unit, found.motion_unit) == ("Nm", "rad")
    for name, values in data().items():
        assert found.signals[name].tobytes() == values.tobytes()
    assert found.name == path.name and len(found.sha256) == 64


def test_long_keeps_the_clock_of_every_channel(tmp_path):
    table = pa.table({"signal": ["a", "b", "a", "b", "a"], "t_ms": [0, 5, 1, 7, 2], "value": [1.0, 10, 2, 20, 3]})
    pq.write_table(table, tmp_path / "a.parquet")
    found = read_recording(tmp_path / "a.parquet", choose=list)
    np.testing.assert_array_equal(found.channels["a"].time, [0, 0.001, 0.002])
    np.testing.assert_array_equal(found.channels["b"].time, [0.005, 0.007])
    np.testing.assert_array_equal(found.channels["b"].values, [10, 20])


def test_long_has_one_time_column_and_a_map_may_mean_the_columns(tmp_path):
    write_long(tmp_path / "a.parquet")
    with pytest.raises(BadRecording, match=r"one time column.*`time` at motor_torque"):
        read_recording(tmp_path / "a.parquet", ChannelMap.from_mapping(
            {"schema": SCHEMA, "roles": {"motor_torque": {"channel": "motor_torque", "time": "time"}}}))
    found = read_recording(tmp_path / "a.parquet", ChannelMap.from_mapping(
        {"schema": SCHEMA, "roles": {"motor_torque": "value"}}))
    assert len(found.channels["value"].values) == 3 * N


def test_lists_that_are_too_short_are_missing_values(tmp_path):
    lists = pa.array([[1.0, 2.0], [], None, [3.0], [4.0, 5.0, 6.0]])
    pq.write_table(pa.table({"t": 0.01 * np.arange(5.0), "x": lists}), tmp_path / "a.parquet")
    found = read_recording(tmp_path / "a.parquet", ChannelMap.from_mapping(
        {"schema": SCHEMA, "roles": {"motor_torque": "x[1]"}}))
    np.testing.assert_array_equal(found.channels["x[1]"].values, [2, np.nan, np.nan, np.nan, 5])


def test_roles_with_a_clock_of_their_own(tmp_path):
    pq.write_table(pa.table({"time": time(), "late_us": np.round(time() * 1e6 + 70).astype(np.int64),
                             "x": data()["motor_torque"], "y": data()["motor_speed"]}), tmp_path / "a.parquet")
    found = read_recording(tmp_path / "a.parquet", ChannelMap.from_mapping({"schema": SCHEMA, "roles": {
        "motor_torque": "x", "motor_speed": {"channel": "y", "time": "late_us"}}}))
    np.testing.assert_array_equal(found.channels["x"].time, time())
    np.testing.assert_allclose(found.channels["y"].time, time() + 70e-6, atol=1e-12)


def test_a_damaged_part_of_a_folder_is_left_out_and_said(tmp_path):
    write_folder(tmp_path / "log")
    part = tmp_path / "log" / "part-3.parquet"
    part.write_bytes(part.read_bytes()[:-20])
    found = open_experiment(tmp_path / "log")
    assert [f.code for f in found.findings] == ["log-damaged", "recording-interrupted"]
    assert "part-3.parquet" in found.findings[0].text and found.segments == ((0, 111), (148, N))


def test_a_damaged_page_costs_its_row_group(tmp_path):
    pq.write_table(wide(data()), tmp_path / "b.parquet", row_group_size=64, write_page_checksum=True)
    raw = bytearray((tmp_path / "b.parquet").read_bytes())
    place = pq.read_metadata(tmp_path / "b.parquet").row_group(2).column(1)
    raw[place.data_page_offset + place.total_compressed_size // 2] ^= 0xFF
    (tmp_path / "b.parquet").write_bytes(raw)
    found = open_experiment(tmp_path / "b.parquet")
    assert [f.code for f in found.findings] == ["log-damaged", "recording-interrupted"]
    assert found.segments == ((0, 128), (192, N))
    every = read_recording(tmp_path / "b.parquet", choose=list)
    assert set(every.channels) == {"motor_torque", "load_angle"} and "damaged" in every.unreadable["motor_speed"]
    np.testing.assert_array_equal(found.signals["motor_speed"][192:], data()["motor_speed"][192:])


def test_folders_that_cannot_be(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadRecording, match=r"Parquet files in the folder empty; found none"):
        open_experiment(tmp_path / "empty")
    write_folder(tmp_path / "log")
    pq.write_table(pa.table({"t": [1.0], "other": [2.0]}), tmp_path / "log" / "x.parquet")
    with pytest.raises(BadRecording, match=r"the same columns.*t, other in x\.parquet"):
        open_experiment(tmp_path / "log")
