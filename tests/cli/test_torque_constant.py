"""Torque constants at the command line: recordings in A, V and %, from the first step to the controller."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.identify.test_by_record import record
from tests.simulator.records import write_mcap, write_parquet

K = 0.35
SET = ("--set", f"motor.torque_constant={K} Nm/A")
START = ("--drive", "one-body", "--set", "motor.inertia=0.03")
FIT = ("--criterion", "innovations", "--quiet")
MAP = "schema: drivetool/channel-map/1\nroles:\n  motor_torque: {{channel: motor_torque, {}}}\n" \
      "  motor_speed: motor_speed\n"


def written(name, made, unit="A", scale=K, write=write_parquet, **more):
    write(name, {"motor_torque": (made.signals["motor_torque"] / scale, unit),
                 "motor_speed": (made.signals["motor_speed"], "rad/s"), **more}, made.step)


@pytest.fixture
def here(here):
    a = record("a", 1, 2.0)
    written("a.parquet", a)
    written("nm.parquet", a, "Nm", 1.0)
    written("b.parquet", record("b", 2, 2.0))
    Path("scaled.yaml").write_text(MAP.format(f"unit: Nm, scale: {K}"))
    return a


def plateaus(name, factor):
    """Four speeds of both signs, each held until all is steady."""
    speed = np.repeat([10.0, -10.0, 30.0, -30.0], 3000)
    torque = 0.05 * speed + 0.3 * np.sign(speed) + 0.01 * np.random.default_rng(2).standard_normal(len(speed))
    write_parquet(name, {"motor_torque": (torque / factor, "A"), "motor_speed": (speed, "rad/s")}, 0.002)


def content(path):
    return yaml.safe_load(Path(path).read_text())


def numbers_by_place(node, where=""):
    """Every number of a file by its place, but for what only a recording in A has."""
    if isinstance(node, dict):
        return {k: v for key, each in node.items() if "torque_constant" not in key and key not in ("inputs", "set")
                for k, v in numbers_by_place(each, f"{where}.{key}").items()}
    if isinstance(node, list):
        return {k: v for i, each in enumerate(node) for k, v in numbers_by_place(each, f"{where}.{i}").items()}
    return {where: node} if isinstance(node, float) else {}


def torque_and_current_files(call, step, *words, file="x.yaml"):
    """The files of a step for the recording as torques by its map, and as A with a constant."""
    found = []
    for way, more in (("map", ("--map", "scaled.yaml")), ("a", SET if step != "validate" else ())):
        params = ("--params", f"{way}-{file}") if step in ("validate", "greybox") and file else ()
        code, _, err = call(step, "a.parquet", *more, *params, *words, "--out", f"{way}-{step}.yaml")
        assert code == 0, err
        found.append(numbers_by_place(content(f"{way}-{step}.yaml")))
    assert found[0] and found[0] == pytest.approx(found[1], rel=1e-9)
    return content(f"a-{step}.yaml")


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_a_recording_in_amperes_is_one_in_torques(call):
    """Fit and free runs are the same to the last digit written."""
    fit = torque_and_current_files(call, "greybox", *START, *FIT, file="")
    assert fit["drive"]["torque_unit"] == "Nm" and fit["drive"]["input_unit"] == "A"
    line = fit["parameters"]["motor.torque_constant"]
    assert (line["value"], line["unit"], line["std"], line["status"]) == (K, "Nm/A", None, "held")
    assert fit["parameters"]["motor.inertia"]["unit"] == "kg m^2"
    torque_and_current_files(call, "validate", file="greybox.yaml")


@pytest.mark.slow
@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("step, words", [
    ("steady", ("--drive", "one-body")), ("blackbox", ("--drive", "one-body")), ("greybox", START),
    ("greybox", (*START, "--criterion", "inverse")), ("greybox", (*START, "--criterion", "simulation")),
    ("greybox", (*START, "--criterion", "frequency"))])
def test_every_step_sees_torques(call, step, words):
    if step == "steady":
        plateaus("a.parquet", K)
    torque_and_current_files(call, step, *words, file="")


def test_a_chain_of_steps_carries_the_constant(call, here):
    """Fitted where a held inertia identifies it, held from then on; not used by recordings in Nm; a pipe; MCAP."""
    code, _, err = call("greybox", "a.parquet", "--drive", "one-body", "--set", "motor.inertia=0.02", *FIT,
                        "--hold", "motor.inertia", "--free", "motor.torque_constant",
                        "--set", "motor.torque_constant=410 mNm/A", "--out", "fit.yaml")
    assert code == 0, err
    line = content("fit.yaml")["parameters"]["motor.torque_constant"]
    assert abs(line["value"] - K) < 3.0 * line["std"] < 0.05 * K
    assert (line["status"], line["start"]) == ("fitted", 0.41)
    assert "motor.torque_constant" in content("fit.yaml")["covariance"]["names"]
    code, _, err = call("validate", "b.parquet", "--params", "fit.yaml", "--out", "check.yaml")
    assert code == 0 and content("check.yaml")["checks"][0]["simulation_fit_percent"] > 98.0, err
    written("b.mcap", record("b", 2, 2.0), write=write_mcap)
    Path("map.yaml").write_text(MAP.format("unit: A"))
    said = [call("simulate", log, *more, "--params", "fit.yaml", "--out", "x.parquet")[2]
            for log, *more in (("b.parquet",), ("b.mcap", "--map", "map.yaml"))]
    rmse = [line for line in said[0].splitlines() if "rmse" in line]
    assert rmse and rmse == [line for line in said[1].splitlines() if "rmse" in line]
    code, out, err = call("greybox", "nm.parquet", "--params", "-", *FIT, "--out", "-",
                          stdin=Path("fit.yaml").read_bytes())
    kept = yaml.safe_load(out)
    assert code == 0 and kept["parameters"]["motor.torque_constant"]["value"] == line["value"], err
    assert kept["drive"]["input_unit"] == "A" and kept["parameters"]["motor.torque_constant"]["status"] == "held"
    assert abs(kept["parameters"]["motor.inertia"]["value"] - 0.02) < 0.0006


@pytest.mark.parametrize("unit, scale, given, raw", [
    ("V", K, "0.35 Nm/V", "unit: V"), ("%", K, "350 mNm/%", "unit: '%'"), ("%", 100 * K, "0.35 Nm/%", "unit: pu"),
    ("mV", 1e-3 * K, "350 mNm/V", "unit: mV"), ("kA", 1e3 * K, "350 Nm/kA", "unit: kA")])
def test_volts_and_per_cent(call, here, unit, scale, given, raw):
    written("v.parquet", here, unit, scale)
    Path("v.yaml").write_text(MAP.format(raw))
    constant = ("--set", f"motor.torque_constant={given}")
    code, _, err = call("simulate", "v.parquet", "--map", "v.yaml", *START, *constant, "--out", "x.parquet")
    assert code == 0, err
    code, _, other = call("simulate", "nm.parquet", *START, "--out", "x.parquet")
    assert code == 0 and [line for line in err.splitlines() if "rmse" in line] == [
        line for line in other.splitlines() if "rmse" in line] != []


@pytest.mark.parametrize("unit", [pytest.param("V", marks=pytest.mark.slow), "%"])
def test_without_a_constant_all_is_in_that_unit(call, here, unit):
    written("v.parquet", here, unit)
    code, _, err = call("greybox", "v.parquet", *START, *FIT, "--set", "motor.inertia=0.08", "--out", "fit.yaml")
    assert code == 0, err
    found = content("fit.yaml")
    line = found["parameters"]["motor.inertia"]
    assert abs(line["value"] - 0.02 / K) < 0.002 and line["unit"] == f"{unit} s^2/rad"
    assert found["drive"]["torque_unit"] == unit and "input_unit" not in found["drive"]
    code, _, err = call("validate", "v.parquet", "--params", "fit.yaml", "--out", "check.yaml")
    assert code == 0, err
    assert call("convert", "v.parquet", "--out", "c.parquet")[0] == 0
    code, _, err = call("validate", "c.parquet", "--params", "fit.yaml", "--out", "again.yaml")
    assert code == 0 and content("again.yaml")["checks"][0]["rmse"] == content("check.yaml")["checks"][0]["rmse"]


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_recordings_in_amperes_and_in_torques_are_fitted_together(call):
    code, _, err = call("greybox", "b.parquet", "nm.parquet", *START, *FIT, *SET, "--out", "fit.yaml")
    assert code == 0, err
    line = content("fit.yaml")["parameters"]["motor.inertia"]
    assert abs(line["value"] - 0.02) < 0.0006
    code, _, err = call("greybox", "b.parquet", "nm.parquet", *START, *FIT, "--record", "b.parquet",
                        "motor.torque_constant=0.7", "--out", "other.yaml")
    assert code == 0, err
    lines = content("other.yaml")["parameters"]
    assert lines["motor.torque_constant@b.parquet"]["value"] == 0.7 and "motor.torque_constant" not in lines
    code, _, err = call("validate", "b.parquet", "--params", "other.yaml", "--out", "check.yaml")
    assert code == 0, err


IN_AMPERES = """schema: drivetool/parameters/1
parameters:
  motor.inertia: 0.02
  load.inertia: 0.05
  shaft.stiffness: 200
  shaft.damping: 0.1
  motor.torque_constant: {value: 350, unit: mNm/A}
"""


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_gains_are_in_torques(call):
    """The torque constant has no part in them."""
    found = []
    for name, text in (("with.yaml", IN_AMPERES), ("without.yaml", IN_AMPERES.replace("  motor.torque", "# "))):
        Path(name).write_text(text)
        code, out, err = call("tune", "--params", name, "--converter", "433,0.69,2 ms")
        assert code == 0, err
        found.append(yaml.safe_load(out))
    assert found[0]["drive"].pop("input_unit") == "A"
    assert [{k: v for k, v in each.items() if k != "inputs"} for each in found] == [
        {k: v for k, v in found[1].items() if k != "inputs"}] * 2
    assert found[0]["designs"][0]["gains"]["kp"]["unit"] == "Nm s/rad"


IN_NM = "schema: drivetool/parameters/1\ndrive: {torque_unit: Nm, bodies: [motor]}\n" \
        "parameters: {motor.inertia: 0.02}\n"
FREE = ("--free", "motor.torque_constant")


@pytest.mark.parametrize("words, code, said", [
    (("greybox", "a.parquet", "--params", "nm.yaml"), 1, "Give motor.torque_constant in Nm/A, with --set or"),
    (("greybox", "a.parquet", *START, *FREE), 1, "a start value of motor.torque_constant in Nm/A for motor_torque"),
    (("greybox", "a.parquet", *START, *FREE, *SET), 2, "of known size beside a free motor.torque_constant"),
    (("greybox", "a.parquet", *START, *FREE, *SET, "--criterion", "inverse"), 2, "criterion inverse"),
    (("greybox", "nm.parquet", *START, *FREE, *SET), 2, "an input in A, V or % for a free motor.torque_constant"),
    (("greybox", "a.parquet", *START, "--set", "motor.torque_constant=1 Nm/V"), 2, "found unit 'Nm/V'"),
    (("greybox", "a.parquet", *START, "--set", "motor.torque_constant=1 Nm"), 2, "found unit 'Nm'"),
    (("greybox", "a.parquet", *START, "--set", "motor.torque_constant=-1"), 2, "motor.torque_constant between"),
    (("greybox", "a.parquet", *START, "--set", "load.torque_constant=1"), 2, "load.torque_constant"),
    (("greybox", "a.parquet", "nm.parquet", *START), 1, "motor_torque of a.parquet is in A and motor_torque of nm"),
    (("spectra", "a.parquet", "nm.parquet"), 1, "the torque in A, the unit of a.parquet; found Nm in nm.parquet"),
    (("greybox", "mixed.parquet", *START), 1, "motor_torque of mixed.parquet is in A and shaft_torque of mixed"),
    (("steady", "mixed.parquet", *START), 1, "--set motor.torque_constant=VALUE"),
    (("greybox", "a.parquet", "v.parquet", *START, *SET), 1, "the input in A, the unit of a.parquet; found V in v"),
    (("steady", "a.parquet", *SET, *FREE), 2, "motor.torque_constant held"),
    (("blackbox", "a.parquet", *SET, *FREE), 2, "motor.torque_constant"),
    (("backlash", "a.parquet", *SET, *FREE), 2, "motor.torque_constant held"),
    (("steady", "a.parquet", *SET, "--set", "load.torque_constant=1"), 1, "found load.torque_constant"),
])
def test_wrong_usage_is_one_sentence(call, here, words, code, said):
    Path("nm.yaml").write_text(IN_NM)
    written("v.parquet", replace(here), "V")
    written("mixed.parquet", here, shaft_torque=(np.zeros(here.size), "Nm"))
    found, out, err = call(*words)
    assert (found, out) == (code, "") and said in err and err.count("error:") == 1, err


def test_spectra_of_two_units_need_no_constant(call, here):
    written("mixed.parquet", here, shaft_torque=(here.signals["motor_torque"], "Nm"))
    for words, unit in (((), "rad/s/A"), (("--output", "shaft_torque"), "Nm/A")):
        code, out, err = call("spectra", "mixed.parquet", *words)
        assert code == 0 and yaml.safe_load(out)["unit"] == unit, err
    code, out, err = call("inspect", "mixed.parquet")
    assert code == 0 and yaml.safe_load(out)["experiment"]["input_units"] == {"motor_torque": "A"}, err
