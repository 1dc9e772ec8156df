"""A logger that changes its rate, at the process boundary: every command uses all or reports what it leaves out."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from mcap.writer import Writer

from tests.simulator.experiments import multisine
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

STEP, UNITS = 1e-3, {"time": "s", "motor_torque": "Nm", "motor_speed": "rad/s"}
KEEP = np.concatenate([np.arange(0, 2000), np.arange(2000, 8000, 4)])
COUNTS = "2000 samples at 1000 Hz", "1500 samples at 250 Hz"
START = ("--drive", "one-body", "--set", "motor.inertia=0.012", "--set", "motor.viscous=0.02")
COMMANDS = {
    "greybox": (*START, "--criterion", "innovations"), "blackbox": ("--drive", "one-body"),
    "inverse": (*START, "--criterion", "inverse"), "structure": ("--drive", "one-body", "--structure", "oe"),
    "spectra": (), "validate": ("--params", "model.yaml"),
    "simulate": ("--params", "model.yaml", "--out", "s.parquet"),
    "compare": ("--drive", "one-body", "--structure", "oe"),
    "diagnose": ("--params", "model.yaml", "--candidates", "quadratic-drag", "--rounds", "1")}
USE_EVERY_RATE, SLOW_TEST_COMMANDS = ("greybox", "blackbox"), ("diagnose", "inverse", "compare", "structure")
STEPS = {"inverse": "greybox", "structure": "blackbox"}


def columns(seed):
    torque = multisine([0.4, 0.9, 1.7, 3.1], 0.15, 8.0, STEP, seed)
    held = np.diff([*KEEP, 8000])
    torque = np.repeat(torque[KEEP], held)
    noise = np.repeat(white_noise(len(KEEP), 0.004, seed + 10), held)
    run = simulate_linear(Machine(inertia=(0.01,), viscous=(0.02,)), torque, STEP, None, noise)
    return {"time": KEEP * STEP, "motor_torque": torque[KEEP],
            "motor_speed": run.speeds[KEEP, 0] + white_noise(len(KEEP), 0.01, seed + 20)}


def parquet(path, seed):
    found = columns(seed)
    fields = [pa.field(name, pa.float64(), metadata={"unit": UNITS[name]}) for name in found]
    pq.write_table(pa.table(list(found.values()), schema=pa.schema(fields)), path)


def mcap(path, seed):
    """Torque and speed on topics of their own."""
    found = columns(seed)
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, name in (("/torque", "motor_torque"), ("/speed", "motor_speed")):
            schema = {"type": "object", "properties": {name: {"type": "number", "unit": UNITS[name]}}}
            kind = writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
            channel = writer.register_channel(topic, "json", kind)
            for i, (t, value) in enumerate(zip(found["time"], found[name], strict=True)):
                when = round(t * 1e9)
                writer.add_message(channel, when, json.dumps({name: float(value)}).encode(), when, i)
        writer.finish()


@pytest.fixture
def place(here):
    parquet(here / "a.parquet", 1)
    (here / "model.yaml").write_text(yaml.safe_dump({
        "schema": "drivetool/parameters/1", "drive": {"bodies": ["motor"], "shafts": []},
        "parameters": {"motor.inertia": {"value": 0.01, "std": 1e-4, "status": "fitted"},
                       "motor.viscous": {"value": 0.02, "std": 1e-3, "status": "fitted"}}}))
    return here


@pytest.mark.parametrize("command", [
    pytest.param(c, marks=pytest.mark.slow) if c in SLOW_TEST_COMMANDS else c for c in COMMANDS])
def test_a_command_uses_every_rate_or_says_what_it_leaves_out(call, place, command):
    logs = ["a.parquet"]
    if command == "compare":
        parquet(place / "b.parquet", 2)
        logs.append("b.parquet")
    code, out, err = call(STEPS.get(command, command), *logs, *COMMANDS[command])
    assert code in (0, 3), err
    text = " ".join(err.split())
    assert all(count in text for count in COUNTS) and "rate-changes" in text
    assert text.count("warning rate-changes") == (0 if command in USE_EVERY_RATE else len(logs))
    if command != "simulate":
        assert [entry["file"] for entry in yaml.safe_load(out)["data"]] == logs
    if command in USE_EVERY_RATE:
        content = yaml.safe_load(out)
        assert content["fit"]["n"] == len(KEEP)
        line = content["parameters"]["motor.inertia"]
        assert abs(line["value"] - 0.01) < 4.0 * line["std"]


@pytest.mark.slow
def test_topics_of_their_own_say_the_same(call, place):
    mcap(place / "a.mcap", 1)
    found = []
    for log in ("a.parquet", "a.mcap"):
        code, out, err = call("greybox", log, *COMMANDS["greybox"])
        assert code == 0, err
        found.append(yaml.safe_load(out)["parameters"]["motor.inertia"]["value"])
    assert found[0] == pytest.approx(found[1], rel=1e-6)


def test_inspect_shows_every_rate_and_no_gap(call, place):
    code, out, _ = call("inspect", "a.parquet", "--json")
    content = json.loads(out)
    assert code == 0 and [f["code"] for f in content["findings"]] == ["rate-changes"]
    e = content["experiment"]
    assert sorted([(e["samples"], e["segments"]), *((o["samples"], o["segments"]) for o in e["others"])]) == [
        (1500, 1), (2000, 1)]
    for channel in content["channels"]:
        assert channel["gaps"] == 0 and channel["lost"] == 0 and "1000 Hz, 250 Hz" in channel["clock"]


@pytest.mark.slow
def test_what_counts_recordings_counts_files(call, place):
    """A start, a record that differs and a copy are of a log, not of its rates."""
    code, out, err = call("greybox", "a.parquet", *COMMANDS["greybox"], "--start", "rest")
    assert code == 0, err
    parquet(place / "b.parquet", 2)
    code, out, err = call("greybox", "a.parquet", "b.parquet", *COMMANDS["greybox"], "--record", "b.parquet",
                          "free=motor.viscous", "--record", "a.parquet", "start=rest")
    assert code == 0, err
    content = yaml.safe_load(out)
    assert content["parameters"]["motor.viscous@b.parquet"]["status"] == "fitted"
    assert [entry["file"] for entry in content["data"]] == ["a.parquet", "b.parquet"]
    code, _, err = call("greybox", "a.parquet", "a.parquet", *COMMANDS["greybox"])
    assert code == 2 and "every recording once" in err


def test_a_current_is_a_torque_at_every_rate(call, place):
    """A motor in A with its torque constant gives what the same motor in Nm does, at both rates."""
    found, units = columns(1), {**UNITS, "motor_torque": "A"}
    fields = [pa.field(name, pa.float64(), metadata={"unit": units[name]}) for name in found]
    found["motor_torque"] = found["motor_torque"] / 0.5
    pq.write_table(pa.table(list(found.values()), schema=pa.schema(fields)), place / "c.parquet")
    values = []
    for log, more in (("a.parquet", ()), ("c.parquet", ("--set", "motor.torque_constant=0.5"))):
        code, out, err = call("greybox", log, *COMMANDS["greybox"], *more)
        assert code == 0, err
        values.append(yaml.safe_load(out)["parameters"]["motor.inertia"]["value"])
    assert values[1] == pytest.approx(values[0], rel=1e-7)
