"""drivetool tune at its boundary: files, tables, pictures, replays, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from tests.places import SCHEMAS
from tests.simulator import controllers, machine
from tests.simulator.simulate import simulate

SCHEMA = json.loads((SCHEMAS / "gains.json").read_text())
TWO = """schema: drivetool/parameters/1
parameters:
  motor.inertia: {value: 20, unit: kg m^2, std: 0.4}
  load.inertia: {value: 80, unit: kg m^2, std: 1.0}
  shaft.stiffness: {value: 224, unit: kNm/rad, std: 5}
  shaft.damping: 224
  motor.viscous: 0.006
  load.viscous: 0.024
  shaft.half_gap: {value: 0.5, unit: mrad}
  converter.bandwidth: 433
  converter.dead_time: {value: 2, unit: ms}
covariance:
  names: [motor.inertia, shaft.stiffness]
  matrix: [[0.16, 1.5], [1.5, 25]]
"""
RATINGS = """schema: drivetool/parameters/1
ratings:
  torque: {value: 100, unit: kNm}
  speed: {value: 630, unit: rpm}
controller: {speed_filter: {value: 1, unit: ms}}
"""
TANDEM = """schema: drivetool/parameters/1
drive: {name: tandem, bodies: [motor, motor2, load]}
parameters: {motor.inertia: 1e3, motor2.inertia: 1e3, load.inertia: 4e3, motor.viscous: 0.3, motor2.viscous: 0.3,
  load.viscous: 1.2, shaft.stiffness: 8e6, shaft.damping: 8e3, shaft2.stiffness: 8e6, shaft2.damping: 8e3,
  converter.bandwidth: 433, converter.dead_time: 0.002}
"""


@pytest.fixture
def folder(here):
    """A working folder with parameter files."""
    for name, text in (("drive", TWO), ("ratings", RATINGS), ("tandem", TANDEM)):
        (here / f"{name}.yaml").write_text(text)
    return here


def read(path):
    return yaml.safe_load(Path(path).read_text())


@pytest.mark.slow
def test_gains_file_says_everything_and_repeats_to_the_byte(folder, call):
    words = "tune", "--params", "drive.yaml", "--params", "ratings.yaml", "--draws", 40
    code, as_json, err = call(*words, "--out", "gains.yaml", "--json")
    assert code == 0 and "wrote gains.yaml" in err and "Kp" in err
    assert call(*words)[1] == Path("gains.yaml").read_text()
    content = read("gains.yaml")
    jsonschema.validate(content, SCHEMA)
    assert content["schema"] == "drivetool/gains/1" and [i["file"] for i in content["inputs"]] == [
        "drive.yaml", "ratings.yaml"]
    (design,) = content["designs"]
    kp = design["gains"]["kp"]
    assert kp["unit"] == "Nm s/rad" and kp["per_unit"] == pytest.approx(kp["value"] * 630 * np.pi / 30 / 100e3)
    assert design["speed_filter"]["value"] == 0.001
    assert design["margins"]["max_sensitivity"] <= 2.0 + 1e-6
    assert design["spread"]["draws"] == 40
    assert set(design["spread"]["parameters"]) == {"motor.inertia", "shaft.stiffness", "load.inertia"}
    assert design["variations"][0]["change"] == "nominal" and len(design["variations"]) == 7
    assert [h["situation"] for h in design["hunting"]] == ["shaft without torque, moving"]
    iae = design["factors"]["load_speed"]["iae"]
    assert design["criterion_value"]["value"] == pytest.approx(iae["value"], rel=1e-9)
    assert iae["per_unit"] == pytest.approx(iae["value"] * 100 * 100e3 / (630 * np.pi / 30)) and (
        iae["per_unit_unit"] == "% s")
    assert json.loads(as_json) == content
    code, out, _ = call("show", "gains.yaml")
    assert code == 0 and "impact drop" in out and "shaft.stiffness -20 %" in out
    assert "95 % quantile of 40 draws" in out


@pytest.mark.slow
def test_pictures(folder, call, monkeypatch):
    from drivetool.tune import pictures

    monkeypatch.setattr(pictures, "POINTS_PER_AXIS", 20)
    words = "tune", "-p", "drive.yaml", "--draws", 20, "--out", "g.yaml", "--plot", "pictures"
    code, _, err = call(*words)
    assert code == 0 and "drew" in err
    names = {path.name for path in (folder / "pictures").iterdir()}
    assert names == {f"tune-{kind}.png" for kind in (
        "load-step", "criterion-plane", "impact-drop-plane", "nichols", "sensitivity", "spread", "hunting")}
    first = {path.name: path.read_bytes() for path in (folder / "pictures").iterdir()}
    call(*words)
    assert first == {path.name: path.read_bytes() for path in (folder / "pictures").iterdir()}
    assert min(map(len, first.values())) > 10000


def test_options_reach_the_design(folder, call):
    (folder / "bare.yaml").write_text("schema: drivetool/parameters/1\nparameters: {motor.inertia: 20, "
                                      "load.inertia: 80, shaft.stiffness: 224e3, shaft.damping: 224}\n")
    words = ["tune", "-p", "bare.yaml", "--speed", "300 rpm", "--converter", "433 rad/s,0.69,2 ms",
             "--criterion", "ISE", "--max-sensitivity", 1.7, "--weight", "motor_speed=0.5", "--dead-time", "zero",
             "--max-gain", "2 kNm s/rad", "--speed-filter", "1 ms", "--set", "load.inertia=70"]
    code, out, _ = call(*words)
    content = yaml.safe_load(out)
    assert code == 0 and content["criterion"] == {"name": "ISE", "weights": {"load_speed": 1.0, "motor_speed": 0.5}}
    assert content["constraint"] == {"max_sensitivity": 1.7, "max_gain": 2000.0, "confidence": None}
    (design,) = content["designs"]
    assert design["dead_time_form"] == "zero" and design["speed_filter"]["value"] == 0.001
    assert design["margins"]["max_sensitivity"] <= 1.7 + 1e-6 and design["spread"] is None
    assert content["options"]["speed"] == "300 rpm"
    assert content["options"]["set"] == ["load.inertia=70"] and design["criterion_value"]["unit"] == "weighted"


@pytest.mark.slow
def test_tandem_side_by_side(folder, call, monkeypatch):
    from drivetool.tune.optimisation import search

    monkeypatch.setattr(search, "GRID_TIMES", 24)  # the optimum itself is tested elsewhere
    monkeypatch.setattr(search, "GRID_SECOND_GAINS", 7)
    (folder / "map.yaml").write_text(
        "schema: drivetool/channel-map/1\nroles: {motor_torque: t, motor_speed: n, shaft_torque: ts}\n")
    words = "tune", "-p", "tandem.yaml", "-p", "ratings.yaml", "--map", "map.yaml", "--out", "t.yaml"
    assert call(*words)[0] == 0
    content = read("t.yaml")
    jsonschema.validate(content, SCHEMA)
    assert [d["configuration"] for d in content["designs"]] == ["siso", "miso", "mimo"]
    assert content["best"] == min(content["designs"], key=lambda d: d["criterion_value"]["value"])["configuration"]
    miso, mimo = content["designs"][1:]
    assert miso["gains"]["kp2"]["value"] / miso["gains"]["kp"]["value"] == pytest.approx(
        miso["gains"]["ti2"]["value"] / miso["gains"]["ti"]["value"])
    assert mimo["gains"]["k3"]["value"] == 0.5 and mimo["gains"]["kp2"] is None
    code, out, _ = call("show", "t.yaml")
    assert code == 0 and "siso" in out and "miso" in out and "mimo" in out and "Kp2" in out


def load_step_record(path, gain, integral_time, step=5e-4):
    """A load step on the true machine under a discrete controller with these settings."""
    m = machine.Machine(inertia=(20, 80), viscous=(0.006, 0.024), stiffness=(224e3,), damping=(224.0,),
                        half_gap=(0.0005,), converter_bandwidth=433.0, dead_time=0.002 - step / 2)
    n = 3000
    load = np.where(np.arange(n) * step < 0.5, 200.0, 1200.0)
    twist = 200.0 / 224e3 + 0.0005
    start = machine.State((10.0, 10.0), (twist,), 0.0, 200.3, 0.0)
    pi = controllers.SpeedPI(np.full(n, 10.0), gain, gain / integral_time, step, start=200.3)
    run = simulate(m, np.zeros(n), step, start, pi, load_torque=load, rtol=1e-8, atol=1e-10)
    columns = {"time": (np.arange(n) * step, "s"), "motor_torque": (run.applied, "Nm"),
               "motor_speed": (run.speeds[:, 0], "rad/s"), "load_speed": (run.speeds[:, 1], "rad/s"),
               "load_torque": (load, "Nm")}
    fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, (_, unit) in columns.items()]
    pq.write_table(pa.table([v for v, _ in columns.values()], schema=pa.schema(fields)), path)


@pytest.mark.slow
def test_validate_replays_gains_on_a_load_step(folder, call):
    (folder / "plain.yaml").write_text(TWO.partition("covariance")[0].replace(", std: 0.4", "").replace(
        ", std: 1.0", "").replace(", std: 5", ""))
    assert call("tune", "-p", "plain.yaml", "--out", "gains.yaml")[0] == 0
    gains = read("gains.yaml")["designs"][0]["gains"]
    load_step_record("step.parquet", gains["kp"]["value"], gains["ti"]["value"])
    words = ["validate", "step.parquet", "-p", "plain.yaml", "--gains", "gains.yaml", "--min-fit", 95]
    code, _, _ = call(*words, "--out", "v.yaml", "--plot", "p")
    assert code == 0 and [p.name for p in (folder / "p").iterdir()] == ["validate-step-record.png"]
    checks = {c["output"]: c for c in read("v.yaml")["checks"]}
    assert set(checks) == {"motor_speed", "load_speed", "motor_torque"}
    assert all(c["simulation_fit_percent"] > 97.0 for c in checks.values()), checks
    assert [i["file"] for i in read("v.yaml")["inputs"]] == ["plain.yaml", "gains.yaml"]
    load_step_record("other.parquet", 0.6 * gains["kp"]["value"], gains["ti"]["value"])
    code, _, _ = call("validate", "other.parquet", "-p", "plain.yaml", "--gains", "gains.yaml", "--min-fit", 95)
    assert code == 3
    code, _, err = call("validate", "step.parquet", "-p", "drive.yaml", "--gains", "gains.yaml", "--out", "w.yaml")
    assert code == 0 and "tuned-for-another-file" in err


WRONG = {
    "no file": (["tune"], 2, "--params"),
    "criterion": (["tune", "-p", "drive.yaml", "--criterion", "best"], 2, "wanted a criterion"),
    "limit": (["tune", "-p", "drive.yaml", "--max-sensitivity", "0.8"], 2, "sensitivity above 1; found 0.8"),
    "infeasible": (["tune", "-p", "drive.yaml", "--max-sensitivity", "1.001"], 2, "the lowest attainable Ms is"),
    "gain": (["tune", "-p", "drive.yaml", "--max-gain", "-3"], 2, "gain above zero"),
    "gain unit": (["tune", "-p", "drive.yaml", "--max-gain", "3 kg"], 1, "unit 'kg'"),
    "weight": (["tune", "-p", "drive.yaml", "--weight", "speed"], 2, "SIGNAL=W"),
    "weight signal": (["tune", "-p", "drive.yaml", "--weight", "speed=1"], 2,
                      "found 'speed' (available: load_speed"),
    "configuration": (["tune", "-p", "drive.yaml", "--configuration", "sios"], 2, "Did you mean 'siso'?"),
    "no tandem": (["tune", "-p", "drive.yaml", "--configuration", "miso"], 1, "three bodies, two of them driven"),
    "no shaft torque": (["tune", "-p", "tandem.yaml", "--configuration", "mimo"], 1, "no shaft_torque role"),
    "ratings": (["tune", "-p", "drive.yaml", "--per-unit"], 1, "wanted ratings for per-unit figures"),
    "converter": (["tune", "-p", "drive.yaml", "--converter", "433,x"], 2, "--converter"),
    "converter parts": (["tune", "-p", "drive.yaml", "--converter", "1,2,3,4"], 2, "DEAD_TIME"),
    "confidence": (["tune", "-p", "tandem.yaml", "--configuration", "siso", "--confidence", "0.95"], 1,
                   "standard deviations or a covariance"),
    "confidence range": (["tune", "-p", "drive.yaml", "--confidence", "95"], 2, "between 0 and 1"),
    "filter": (["tune", "-p", "drive.yaml", "--speed-filter", "-1"], 2, "filter time of zero or more"),
    "speed": (["tune", "-p", "drive.yaml", "--speed", "fast"], 2, "a number after --speed"),
    "speed too high": (["tune", "-p", "drive.yaml", "--speed", "1e7"], 2, "a working speed after --speed"),
    "sensor order": (["tune", "-p", "drive.yaml", "--set", "sensor.order=1.5"], 2, "sensor.order of 1 or 2"),
    "no such sensor": (["tune", "-p", "drive.yaml", "--set", "sensor.delay=0.001"], 2, "'sensor.delay'"),
    "non-physical": (["tune", "-p", "drive.yaml", "--set", "shaft.stiffness=-5"], 2, "shaft.stiffness between"),
    "non-physical file": (["tune", "-p", "bad.yaml"], 1, "motor.inertia between"),
    "missing": (["tune", "-p", "ratings.yaml"], 1, "motor.inertia, load.inertia, shaft.stiffness"),
    "motors": (["tune", "-p", "drive.yaml", "--motors", "load"], 1, "the first body first"),
    "gains for params": (["tune", "-p", "gains.yaml"], 1, "schema drivetool/parameters/1"),
    "covariance": (["tune", "-p", "indefinite.yaml"], 1, "negative variances"),
    "lossless": (["tune", "-p", "drive.yaml", "--set", "converter.dead_time=0", "--set", "converter.bandwidth=1e9",
                  "--out", "bad.yaml/g.yaml"], 2, "bad.yaml, which is no folder"),
    "replay over its gains": (["validate", "free.parquet", "-p", "drive.yaml", "--gains", "gains.yaml",
                               "--out", "gains.yaml"], 2, "inputs are never changed"),
    "replay without load": (["validate", "free.parquet", "-p", "drive.yaml", "--gains", "drive.yaml"], 1,
                            "wanted schema drivetool/gains/1"),
}


@pytest.mark.parametrize("words, code, message", WRONG.values(), ids=WRONG)
def test_wrong_words_give_one_clear_sentence(folder, call, words, code, message):
    (folder / "bad.yaml").write_text(TWO.replace("value: 20,", "value: -20,"))
    (folder / "indefinite.yaml").write_text(TWO.replace("[0.16, 1.5]", "[0.16, 9]").replace("[1.5, 25]", "[9, 25]"))
    (folder / "gains.yaml").write_text("schema: drivetool/gains/1\n")
    t = np.arange(100) * 1e-3
    names = {"time": "s", "motor_torque": "Nm", "motor_speed": "rad/s"}
    fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in names.items()]
    pq.write_table(pa.table([t, np.sin(9 * t), np.cos(9 * t)], schema=pa.schema(fields)), "free.parquet")
    before = sorted(path.name for path in folder.iterdir())
    found, out, err = call(*words)
    assert found == code and message in out + err and "Traceback" not in err, err
    if "error: wanted" in err:
        assert out == "" and err.count("\n") == 1 and err.startswith(f"drivetool {words[0]}: error: ")
    assert sorted(path.name for path in folder.iterdir()) == before


def test_ratings_and_speed_filter_are_carried_by_every_step(folder):
    """What a person adds to a parameter file is in the file of the next step."""
    from drivetool.drive import two_mass
    from drivetool.files.results import dump, estimate_file
    from drivetool.files.yaml import load_parameters
    from drivetool.identify.estimate import Estimate

    loaded = load_parameters(["drive.yaml", "ratings.yaml"])
    estimate = Estimate("greybox", loaded.stated().start, (), "converged", {})
    (folder / "next.yaml").write_text(dump(estimate_file(estimate, loaded.inputs, loaded.carried)))
    after = load_parameters(["next.yaml"])
    assert after.ratings(two_mass()) == pytest.approx((100e3, 630 * np.pi / 30)) and after.speed_filter == 0.001
