"""A folder is many recordings, or one data set by its own metadata; recordings are identified by path and time."""

import json
from datetime import UTC, datetime

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

N, STEP = 800, 0.002
BEGAN = datetime(2026, 3, 4, 5, 6, 7, 250_000, tzinfo=UTC)


def write(path, seed=0, inertia=0.02, first=0, clock="ns"):
    rng = np.random.default_rng(seed)
    torque = np.repeat(rng.uniform(-1, 1, N // 20), 20)
    speed = np.concatenate([[0.0], np.cumsum(torque)[:-1]]) * STEP / inertia + 0.01 * rng.standard_normal(N)
    k = first + np.arange(N)
    time = pa.array(int(BEGAN.timestamp() * 1e9) + k * 2_000_000, pa.timestamp("ns")) if clock == "ns" else k * STEP
    fields = [pa.field("motor_torque", pa.float64(), metadata={"unit": "Nm"}),
              pa.field("motor_speed", pa.float64(), metadata={"unit": "rad/s"})]
    table = pa.table([torque, speed], schema=pa.schema(fields)).add_column(0, "time", [time])
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)


FIT = ("--drive", "one-body", "--set", "motor.inertia=0.01", "--json", "--quiet")


def data(call, *words):
    code, out, err = call("greybox", *words, *FIT)
    assert code == 0, err
    return json.loads(out)["data"]


def test_a_folder_is_its_recordings_in_their_order(here, call):
    for seed, name in enumerate(("run-10", "run-2", "run-1")):
        write(here / "runs" / f"{name}.parquet", seed)
    (here / "runs" / "notes.txt").write_text("warm")
    found = data(call, "runs")
    assert [entry["file"] for entry in found] == ["runs/run-1.parquet", "runs/run-2.parquet", "runs/run-10.parquet"]
    assert len({entry["sha256"] for entry in found}) == 3


def test_a_copy_does_not_count_twice(here, call):
    write(here / "runs" / "a.parquet")
    (here / "runs" / ".hidden.parquet").write_bytes(b"")
    data(call, "runs")
    (here / "runs" / "b.parquet").write_bytes((here / "runs" / "a.parquet").read_bytes())
    for words, found in ((["runs"], "runs/a.parquet and runs/b.parquet with one content"),
                         (["runs/a.parquet", "runs/a.parquet"], "runs/a.parquet twice")):
        code, _, err = call("greybox", *words, *FIT)
        assert code == 2 and found in err


def test_a_converted_copy_does_not_count_twice(here, call):
    write(here / "runs" / "a.parquet")
    assert call("convert", "runs/a.parquet", "--out", "runs/b.parquet", "--quiet")[0] == 0
    assert (here / "runs" / "a.parquet").read_bytes() != (here / "runs" / "b.parquet").read_bytes()
    code, _, err = call("greybox", "runs", *FIT)
    assert code == 2 and "runs/a.parquet and runs/b.parquet with one content" in err
    write(here / "runs" / "b.parquet", seed=1)  # a repeat
    data(call, "runs")


@pytest.mark.parametrize("mark", ["_metadata", "_common_metadata", "_SUCCESS"])
def test_a_data_set_is_one_recording(here, call, mark):
    for part in range(3):
        write(here / "runs" / f"part-{part}.parquet", part, first=part * N)
    (here / "runs" / mark).write_bytes(b"")
    assert [entry["file"] for entry in data(call, "runs")] == ["runs"]


@pytest.mark.parametrize(("files", "words"), [
    (["axis-1/a.parquet", "axis-2/a.parquet"], ["folders of recordings", "axis-1, axis-2", "site/axis-1"]),
    (["a.parquet", "axis-2/b.parquet"], ["folders of recordings", "axis-2"]),
    ([], ["recordings in the folder site", "none"])])
def test_two_machines_are_no_one_fit(here, call, files, words):
    (here / "site").mkdir()
    for seed, name in enumerate(files):
        write(here / "site" / name, seed)
    code, out, err = call("greybox", "site", *FIT)
    assert code == 2 and out == "" and err.count("\n") == 1
    for word in words:
        assert word in err


def test_a_step_with_one_recording_takes_no_folder_of_several(here, call):
    for name in "ab":
        write(here / "runs" / f"{name}.parquet")
    for words in (("inspect", "runs"), ("convert", "runs", "--out", "x.parquet"),
                  ("simulate", "runs", "--drive", "one-body", "--set", "motor.inertia=1", "--out", "x.parquet")):
        code, _, err = call(*words)
        assert code == 2 and "one recording; found 2 in the folder runs" in err and "runs/a.parquet" in err
    (here / "runs" / "b.parquet").unlink()
    assert call("inspect", "runs", "--quiet")[0] == 0


def test_results_name_a_recording_by_its_path_and_its_own_time(here, call):
    write(here / "day" / "a.parquet")
    entry, = data(call, "day/a.parquet")
    assert entry["file"] == "day/a.parquet" and entry["began"] == "2026-03-04T05:06:07.250000Z"
    again, = data(call, here / "day" / "a.parquet")
    assert again == entry | {"file": "a.parquet"}
    # Part of it began when the recording did.
    assert data(call, "day/a.parquet", "--condition", "keep from=0.5")[0]["began"] == entry["began"]
    write(here / "b.parquet", clock="s")
    assert "began" not in data(call, "b.parquet")[0]


def test_errors_name_the_path_as_given(here, call):
    (here / "day").mkdir()
    (here / "day" / "a.parquet").write_bytes(b"PAR1 and no more")
    for path in ("day/a.parquet", str(here / "day" / "a.parquet")):
        code, _, err = call("greybox", path, *FIT)
        assert code == 1 and f"in {path};" in err
