"""Every sensor of every body enters, and a step reports what it leaves out: at the process boundary."""

import json
import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from mcap.writer import Writer
from scipy.linalg import expm

from drivetool.logs import ROLES, quantity

N, STEP = 3000, 1e-3
# Two motors on one line, and a turntable behind a gear; what is behind the gear counts there.
TRUTH = {
    "motor.inertia": 0.9, "motor2.inertia": 0.7, "table.inertia": 403.8, "shaft.stiffness": 9e3,
    "shaft.damping": 6.0, "shaft2.stiffness": 1.6e6, "shaft2.damping": 1.6e3}
RATIO = 20.0
NOISE = {"motor_speed": 0.02, "motor2_speed": 0.02, "table_speed": 0.001, "shaft_torque": 1.0,
         "shaft2_torque": 20.0}
UNITS = {"motor_torque": "Nm", "motor2_torque": "Nm", "motor_speed": "rad/s", "motor2_speed": "rad/s",
         "table_speed": "rad/s", "shaft_torque": "Nm", "shaft2_torque": "Nm"}


def feed(seed=4):
    """Signals of the feed, exact under torques that are held, by a matrix exponential of its equations."""
    k1, c1, k2, c2 = (TRUTH[n] for n in ("shaft.stiffness", "shaft.damping", "shaft2.stiffness", "shaft2.damping"))
    j = [TRUTH[f"{b}.inertia"] for b in ("motor", "motor2", "table")]
    first = np.array([c1, -c1, 0.0, k1, 0.0])  # torque in each shaft over (three speeds, two twists)
    second = np.array([0.0, c2 / RATIO, -c2, 0.0, k2])
    a = np.array([-first / j[0], (first - second / RATIO) / j[1], second / j[2], [1, -1, 0, 0, 0],
                  [0, 1 / RATIO, -1, 0, 0]])
    b = np.zeros((5, 2))
    b[0, 0], b[1, 1] = 1 / j[0], 1 / j[1]
    whole = expm(np.block([[a, b], [np.zeros((2, 7))]]) * STEP)
    rng = np.random.default_rng(seed)
    torque = np.column_stack([np.repeat(rng.uniform(-40, 40, N // d + 1), d)[:N] for d in (7, 11)])
    x, states = np.zeros(5), np.empty((N, 5))
    for i in range(N):
        states[i] = x
        x = whole[:5, :5] @ x + whole[:5, 5:] @ torque[i]
    clean = {"motor_torque": torque[:, 0], "motor2_torque": torque[:, 1], "motor_speed": states[:, 0],
             "motor2_speed": states[:, 1], "table_speed": states[:, 2], "shaft_torque": states @ first,
             "shaft2_torque": states @ second}
    return {role: values + NOISE.get(role, 0.0) * rng.standard_normal(N) for role, values in clean.items()}


def write(path, signals, names=None):
    fields = [pa.field("time", pa.float64(), metadata={"unit": "s"}),
              *(pa.field((names or {}).get(role, role), pa.float64(), metadata={"unit": UNITS[role]})
                for role in signals)]
    pq.write_table(pa.table([np.arange(N) * STEP, *signals.values()], schema=pa.schema(fields)), path)


def drive_file(path):
    parameters = {name: {"value": 1.15 * value} for name, value in TRUTH.items()}
    parameters |= {"shaft2.ratio": {"value": RATIO}}
    path.write_text(yaml.safe_dump({
        "schema": "drivetool/parameters/1",
        "drive": {"bodies": ["motor", "motor2", "table"], "shafts": ["shaft", "shaft2"]},
        "parameters": parameters}))


@pytest.fixture
def place(here):
    drive_file(here / "feed.yaml")
    return here


def fitted(call, *more):
    code, out, err = call("greybox", "feed.parquet", "--drive", "feed.yaml", "--hold", "shaft2.ratio",
                          "--free", "shaft.damping", "--quiet", "--json", *more)
    assert code == 0, err
    import json
    return json.loads(out)


def codes(content):
    return {f["code"]: f for f in content["findings"]}


@pytest.mark.slow
@pytest.mark.usefixtures("code_for_any_size")
def test_sensors_of_all_bodies_hold_the_truth(place, call):
    write(place / "feed.parquet", feed())
    found = fitted(call)
    for name, true in TRUTH.items():
        row = found["parameters"][name]
        assert abs(row["value"] - true) < 3.0 * row["std"], name
    assert "role-not-used" not in codes(found)


@pytest.mark.slow
def test_every_sensor_enters(place, call):
    """Without any one of them an interval is wider."""
    signals = feed()
    write(place / "feed.parquet", signals)
    whole = fitted(call)
    for role in NOISE:
        write(place / "feed.parquet", {r: v for r, v in signals.items() if r != role})
        less = fitted(call)
        assert any(less["parameters"][n]["std"] > 1.02 * whole["parameters"][n]["std"] for n in TRUTH), role


# --- every step reports what it does not use, in both formats

TWO = {"schema": "drivetool/parameters/1", "drive": {"name": "two-mass"}, "parameters": {
    "motor.inertia": {"value": 0.02}, "load.inertia": {"value": 0.03}, "shaft.stiffness": {"value": 900.0},
    "shaft.damping": {"value": 0.3}, "motor.viscous": {"value": 0.05}, "load.viscous": {"value": 0.05}}}
SI = {"torque": "Nm", "speed": "rad/s", "angle": "rad", "voltage": "V", "frequency": "Hz"}
NAMES = [*ROLES, "gear_speed", "gear_angle", "shaft2_torque"]
USED = {
    "steady": {"motor_torque", "motor_speed", "shaft_torque", "load_speed"},
    "blackbox": {"motor_torque", "load_torque", "motor_speed", "shaft_torque"},
    "greybox": {"motor_torque", "load_torque", "motor_speed", "load_speed", "shaft_torque"},
    "backlash": {"motor_torque", "load_torque", "motor_speed", "load_speed", "shaft_torque"},
    "diagnose": {"motor_torque", "load_torque", "motor_speed", "load_speed", "shaft_torque"},
    "validate": {"motor_torque", "load_torque", "motor_speed", "load_speed", "shaft_torque"},
    "simulate": {"motor_torque", "load_torque", "motor_speed", "load_speed", "shaft_torque"},
    "compare": {"motor_torque", "load_torque", "motor_speed"},
    "spectra": {"motor_torque", "motor_speed", "reference_torque"}}


def every_role(path, kind, step, hold, seed=1):
    """A two-mass drive whose torque stays for `hold` samples, and something on every other role that there is."""
    rng = np.random.default_rng(seed)
    n = 1200
    p = {name: entry["value"] for name, entry in TWO["parameters"].items()}
    row = np.array([p["shaft.damping"], -p["shaft.damping"], p["shaft.stiffness"]])
    a = np.array([(-row - np.array([p["motor.viscous"], 0, 0])) / p["motor.inertia"],
                  (row - np.array([0, p["load.viscous"], 0])) / p["load.inertia"], [1, -1, 0]])
    b = np.array([[1 / p["motor.inertia"], 0], [0, -1 / p["load.inertia"]], [0, 0]])
    whole = expm(np.block([[a, b], [np.zeros((2, 5))]]) * step)
    torque = np.column_stack([np.repeat(rng.uniform(0.6, 2.0, n // hold), hold), np.full(n, 0.1)])
    x, states = np.array([5.0, 5.0, 0.0]), np.empty((n, 3))
    for i in range(n):
        states[i] = x
        x = whole[:3, :3] @ x + whole[:3, 3:] @ torque[i]
    wave = np.cumsum(rng.standard_normal(n)) * 0.01
    signals = dict.fromkeys(NAMES, wave) | {
        "motor_torque": torque[:, 0], "load_torque": torque[:, 1], "motor_speed": states[:, 0],
        "load_speed": states[:, 1], "shaft_torque": states @ row, "motor_angle": np.cumsum(states[:, 0]) * step,
        "load_angle": np.cumsum(states[:, 1]) * step}
    signals = {r: v + 1e-3 * rng.standard_normal(n) for r, v in signals.items()}
    if kind == "parquet":
        fields = [pa.field("time", pa.float64(), metadata={"unit": "s"}),
                  *(pa.field(r, pa.float64(), metadata={"unit": SI[quantity(r)]}) for r in signals)]
        pq.write_table(pa.table([np.arange(n) * step, *signals.values()], schema=pa.schema(fields)), path)
        return
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        properties = {r: {"type": "number", "unit": SI[quantity(r)]} for r in signals}
        sid = writer.register_schema("drive", "jsonschema", json.dumps(
            {"type": "object", "properties": properties}).encode())
        channel = writer.register_channel("/drive", "json", sid)
        for k in range(n):
            stamp = round(1e9 * step) * k
            writer.add_message(channel, stamp, json.dumps({r: float(v[k]) for r, v in signals.items()}).encode(),
                               stamp)
        writer.finish()


SLOW_STEPS = ("diagnose",)
MAP = {"schema": "drivetool/channel-map/1", "roles": {role: role for role in NAMES}}


@pytest.mark.parametrize("kind", ["parquet", pytest.param("mcap", marks=pytest.mark.slow)])
@pytest.mark.parametrize("step", [
    pytest.param(step, marks=pytest.mark.slow) if step in SLOW_STEPS else step for step in USED])
def test_every_role_is_used_or_said_not_to_be(place, call, step, kind):
    logs = ["all", "more"] if step == "compare" else ["all"]
    for seed, name in enumerate(logs):
        every_role(place / f"{name}.{kind}", kind, *((0.02, 300) if step == "steady" else (0.002, 30)), seed)
    (place / "map.yaml").write_text(yaml.safe_dump(MAP))
    words, given = [step, *(f"{name}.{kind}" for name in logs), "--map", "map.yaml"], TWO
    if step != "spectra":
        fitted = {name: {**entry, "status": "fitted"} for name, entry in TWO["parameters"].items()}
        given = {**TWO, "parameters": fitted} if step == "diagnose" else TWO
        words += ["--params", "-"]
    words += {"greybox": ["--criterion", "simulation", "--hold", "shaft.damping"],
              "backlash": ["--criterion", "simulation"],
              "diagnose": ["--candidates", "dead-time", "--rounds", "1", "--quiet"]}.get(step, [])
    words += ["--out", "x.parquet"] if step == "simulate" else ["--json"]
    code, out, err = call(*words, stdin=yaml.safe_dump(given).encode())
    assert code in (0, 3), err
    text = err if step == "simulate" else codes(json.loads(out))["role-not-used"]["text"]
    said = re.search(r"does not use (.*?)\.( |$|\n)", text)[1]
    named = {role for role in NAMES if re.search(rf"\b{role} \(", said)}
    assert named == set(NAMES) - USED[step]
    if step not in ("spectra",):
        assert "gear_speed (the drive has no body gear)" in said
        assert "shaft2_torque (the drive has no shaft shaft2)" in said
        assert "table_speed (the drive has no body table)" in said


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["parquet", "mcap"])
def test_a_look_shows_every_role(place, call, kind):
    every_role(place / f"all.{kind}", kind, 0.002, 30)
    (place / "map.yaml").write_text(yaml.safe_dump(MAP))
    code, out, err = call("inspect", f"all.{kind}", "--map", "map.yaml", "--json")
    assert code == 0, err
    assert {c["role"] for c in json.loads(out)["channels"]} == set(NAMES)


def test_a_further_body_is_found_by_its_name_without_a_map(place, call):
    signals = feed()
    (place / "feed.yaml").write_text((place / "feed.yaml").read_text().replace("motor2", "pinion"))
    UNITS.update({"pinion_speed": "rad/s", "pinion_torque": "Nm"})
    names = {"motor2_speed": "pinion_speed"}
    signals = {names.get(r, r): v for r, v in signals.items() if r != "motor2_torque"}
    write(place / "feed.parquet", signals)
    code, _, err = call("simulate", "feed.parquet", "--params", "feed.yaml", "--out", "x.parquet")
    assert code == 0 and "pinion_speed: fit" in err and "does not use" not in err
