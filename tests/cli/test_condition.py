"""--condition: every command that fits or checks on recordings takes it, does it and notes it."""

import inspect

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from drivetool.cli import command_line
from drivetool.errors import BadRecording
from tests.cli.test_simulate import fixture_file

# These show or pass on what was logged; nothing may be changed there.
AS_LOGGED = {"inspect", "convert", "init"}
READING = [name for name, module in command_line.COMMANDS.items()
           if {"log", "logs"} & set(inspect.signature(module.command).parameters) and name not in AS_LOGGED]
STEPS = ["despike", "lowpass cutoff=120"]
WORDS = [word for step in STEPS for word in ("--condition", step)]


@pytest.fixture
def folder(here):
    """A working folder with a recording of two seconds and a parameter file."""
    t = np.arange(2000) * 1e-3
    torque = 20 + 5 * np.sign(np.sin(20 * t)) + 3 * np.sin(90 * t)
    columns = {"time": (t, "s"), "motor_torque": (torque, "Nm"), "motor_speed": (80 + np.cos(20 * t), "rad/s")}
    schema = pa.schema([pa.field(name, pa.float64(), metadata={"unit": unit})
                        for name, (_, unit) in columns.items()])
    for name in ("a.parquet", "b.parquet"):
        pq.write_table(pa.table([values for values, _ in columns.values()], schema=schema), name)
    fixture_file(here)
    return here


def words_for(command):
    more = {"compare": ["b.parquet"], "simulate": ["--out", "sim.parquet"]}.get(command, [])
    params = [] if command == "spectra" else ["--params", "rig.yaml"]
    return [command, "a.parquet", *more, *params, *WORDS]


def test_the_list_of_commands_is_right():
    assert {"steady", "spectra", "blackbox", "greybox", "backlash", "validate", "compare", "diagnose",
            "simulate"} == set(READING)


@pytest.mark.parametrize("command", READING)
def test_every_command_passes_the_steps_on(folder, call, monkeypatch, command):
    seen = []

    def stop(log, channel_map, steps, further):
        seen.append(list(steps))
        raise BadRecording("anything", "a stop", "Go on.")

    monkeypatch.setattr("drivetool.logs.door.open_experiment", stop)
    code, out, err = call(*words_for(command))
    assert (code, out, seen) == (1, "", [STEPS]) and "a stop" in err and not (folder / "sim.parquet").exists()


@pytest.mark.parametrize("command", READING)
def test_a_step_that_is_none_is_refused_before_anything_is_read(folder, call, command):
    words = [word.replace("despike", "smooth") for word in words_for(command)]
    code, out, err = call(*words)
    assert code == 2 and out == "" and err.count("\n") == 1 and "smooth" in err and "despike" in err


@pytest.mark.slow
@pytest.mark.parametrize("command", ["spectra", "compare", "validate"])
def test_the_steps_are_noted(folder, call, command):
    code, out, err = call(*words_for(command))
    assert code in (0, 3), err
    content = yaml.safe_load(out)
    assert content["options"]["condition"] == STEPS
    noted = [f["evidence"]["step"] for f in content["findings"] if f["code"] == "conditioned"]
    assert noted[:2] == ["despike", "lowpass"]


def test_simulate_notes_them_in_its_table(folder, call):
    code, _, err = call(*words_for("simulate"))
    assert code == 0 and "conditioned" in err
    assert pq.read_schema("sim.parquet").metadata[b"condition"] == b"despike; lowpass cutoff=120"
    assert call("simulate", "a.parquet", "--params", "rig.yaml", "--out", "plain.parquet")[0] == 0
    assert b"condition" not in pq.read_schema("plain.parquet").metadata
    one, other = (pq.read_table(name)["motor_torque"].to_numpy() for name in ("sim.parquet", "plain.parquet"))
    assert np.abs(one - other).max() > 0.1  # the torque that drives the model is the conditioned one
