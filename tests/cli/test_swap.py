"""compare --swap: one drive identified with either machine as its motor, the whole way by the command line."""

import json
from dataclasses import replace

import pytest
import yaml

from tests.light_rigs import TABLE, from_the_load, steps_record, torque_steps, write

ROLES = ("motor_torque", "motor_speed", "load_speed", "shaft_torque")
PARAMETERS = ("motor.inertia", "load.inertia", "motor.viscous", "load.viscous", "shaft.stiffness", "shaft.damping")
# The rig turns one way: an idle torque is one with the Coulomb friction, and has a row among the figures.
SUMS = ("motor.idle_torque + motor.coulomb", "load.idle_torque + load.coulomb")
MOTOR = {"motor.inertia": (4.78, "kg m^2", 0.02), "load.inertia": (0.646, "kg m^2", 0.003),
         "shaft.stiffness": (3770.0, "Nm/rad", 8.0), "motor.coulomb": (0.0, "Nm", None)}
LOAD = {"motor.inertia": (0.649, "kg m^2", 0.004), "load.inertia": (4.80, "kg m^2", 0.01),
        "shaft.stiffness": (3765.0, "Nm/rad", 6.0), "load.coulomb": (0.0, "Nm", None)}


def file_of(values, drive=None):
    parameters = {n: {"value": v, "unit": unit, "std": std} for n, (v, unit, std) in values.items()}
    return yaml.safe_dump({"schema": "drivetool/parameters/1", "drive": drive or {"name": "two-mass"},
                           "parameters": parameters})


@pytest.fixture
def folder(here):
    for name, values in (("motor", MOTOR), ("load", LOAD)):
        (here / f"{name}.yaml").write_text(file_of(values))
    return here


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Both sides of a rig, and its load side with a fifth more inertia at the load."""
    folder = tmp_path_factory.mktemp("rig")
    heavier = replace(TABLE, inertia=(TABLE.inertia[0], 1.2 * TABLE.inertia[1]))
    records = {"motor": steps_record(TABLE, 31, duration=4.0),
               "load": from_the_load(TABLE, torque_steps(32, 4.0), 110.0, 32),
               "heavier": from_the_load(heavier, torque_steps(33, 4.0), 110.0, 33)}
    return {name: write(folder, name, record, ROLES) for name, record in records.items()}


def identified(call, record):
    """The parameter file of a record, by black box and grey box."""
    start, found = record.with_suffix(".black.yaml"), record.with_suffix(".yaml")
    if not found.exists():
        code, _, err = call("blackbox", record, "--drive", "two-mass", "--out", start)
        assert code == 0, err
        code, _, err = call("greybox", record, "--params", start, "--out", found)
        assert code == 0, err
    return found


@pytest.mark.slow
def test_both_sides_of_one_rig_agree(call, rig):
    first, second = (identified(call, rig[name]) for name in ("motor", "load"))
    code, out, err = call("compare", "--swap", first, second, "--strict")
    assert code == 0 and "The estimates from the two motors agree" in err, err
    file = yaml.safe_load(out)
    found = file["swap"]
    compared = [line for line in found["lines"] if line["ratio"] is not None]
    assert tuple(line["first"] for line in compared) == PARAMETERS
    assert found["agree"] is True and found["degrees"] == len(PARAMETERS) and 0.0027 < found["p"] < 1.0
    assert [(d["first"], d["ratio"] is None) for d in found["derived"]] == [
        *((name, False) for name in SUMS), ("anti_resonance", True), ("anti_resonance_damping_ratio", True),
        ("resonance", False), ("resonance_damping_ratio", False), ("total_inertia_at_motor", False)]
    assert file["findings"] == [] and [entry["file"] for entry in file["inputs"]] == ["motor.yaml", "load.yaml"]


@pytest.mark.slow
def test_a_load_that_is_a_fifth_heavier_in_the_second_is_named(call, rig):
    first, second = (identified(call, rig[name]) for name in ("motor", "heavier"))
    code, out, err = call("compare", "--swap", first, second)
    found = yaml.safe_load(out)["swap"]
    line = next(line for line in found["lines"] if line["first"] == "load.inertia")
    assert code == 0 and found["agree"] is False and line["second"] == "motor.inertia"
    assert line["difference"] == pytest.approx(0.2 * TABLE.inertia[1], rel=0.02)
    named = [line["first"] for line in found["lines"] if line["differs"]]
    assert named == ["load.inertia"]
    assert "warning parameters-differ: The estimates from the two motors differ in" in err
    assert "load.inertia (+20 %" in err
    assert call("compare", "--swap", first, second, "--strict")[0] == 3


def test_file_json_table_and_picture_say_the_same(call, folder):
    code, out, err = call("compare", "--swap", "motor.yaml", "load.yaml", "-o", "swap.yaml", "--json",
                          "--plot", "pictures")
    assert code == 0 and "drew compare-ratios.png in pictures" in err
    assert json.loads(out) == yaml.safe_load((folder / "swap.yaml").read_text())
    assert (folder / "pictures" / "compare-ratios.png").read_bytes()[:4] == b"\x89PNG"
    before = (folder / "swap.yaml").read_bytes()
    call("compare", "--swap", "motor.yaml", "load.yaml", "-o", "swap.yaml")
    assert (folder / "swap.yaml").read_bytes() == before
    code, out, _ = call("show", "swap.yaml")
    rows = [line.split() for line in out.splitlines()]
    assert ["motor.inertia", "4.780", "0.020", "kg", "m^2"] in rows
    assert ["load.inertia", "4.800", "0.010", "0.020", "0.022", "0.89"] in rows
    text = " ".join(out.split())
    assert "motor.coulomb: the same value in both files, not fitted in both: no comparison" in text
    assert "The estimates from the two motors agree: chi-square 1.41 of 3, p 0.7." in out


@pytest.mark.parametrize("words", [("-", "load.yaml"), ("motor.yaml", "-")])
def test_one_of_the_files_may_come_from_standard_input(call, folder, words):
    name = ("motor.yaml", "load.yaml")[words.index("-")]
    code, out, err = call("compare", "--swap", *words, stdin=(folder / name).read_bytes())
    assert code == 0, err
    found = yaml.safe_load(out)["swap"]
    assert found["agree"] is True
    assert "standard input" in (found["first"], found["second"])


@pytest.mark.parametrize("words, message", [
    (["motor.yaml"], "found 1."), (["motor.yaml", "load.yaml", "load.yaml"], "found 3."),
    (["motor.yaml", "steps.parquet"], "found the recording steps.parquet"),
    (["motor.yaml", "."], "found the recording ."), (["-", "-"], "'-' twice"),
    (["motor.yaml", "load.yaml", "--structure", "oe"], "found --structure"),
    (["motor.yaml", "load.yaml", "--order", "3", "--noise-order", "0"], "found --order, --noise-order"),
    (["motor.yaml", "load.yaml", "--machine", "A=*"], "found --machine"),
    (["motor.yaml", "load.yaml", "--map", "map.yaml"], "found --map"),
    (["motor.yaml", "load.yaml", "--params", "load.yaml"], "found --params"),
    (["motor.yaml", "load.yaml", "--drive", "two-mass"], "found --drive"),
    (["motor.yaml", "load.yaml", "--condition", "detrend"], "found --condition"),
    (["motor.yaml", "load.yaml", "--set", "motor.inertia=1"], "found --set"),
    (["motor.yaml", "load.yaml", "--out", "load.yaml"], "inputs are never changed")])
def test_wrong_usage_is_said(call, folder, words, message):
    code, out, err = call("compare", "--swap", *words)
    assert (code, out) == (2, "") and message in err and err.count("\n") == 1, err


LINEAR = {"motor.inertia": (4.0, "kg", 0.1), "load.inertia": (2.0, "kg", 0.1), "shaft.stiffness": (1e4, "N/m", 9.0)}
DRIVE = {"torque_unit": "N", "motion_unit": "m"}


@pytest.mark.parametrize("second, message", [
    (file_of({}), "found none in second.yaml"),
    (file_of(LINEAR, {"name": "two-mass", **DRIVE}), "Nm in motor.yaml and N in second.yaml"),
    (file_of({"motor.inertia": (1.0, "kg m^2", 0.1)}, {"name": "three-mass"}), "motor, gear, arm in second.yaml"),
    (file_of(LOAD | {"shaft.ratio": (3.0, "", None)}), "wanted shaft.ratio of 1 in second.yaml"),
    (file_of(LOAD | {"shaft.ratio": (1.0, "", 0.1)}), "a fitted one in second.yaml"),
    (file_of(LOAD | {"shaft.half_gap": (0.1, "rad", None)}, {"name": "two-mass", "damping_law": "always"}),
     "inside in motor.yaml and always in second.yaml")])
def test_files_that_are_no_two_sides_are_refused(call, folder, second, message):
    (folder / "second.yaml").write_text(second)
    code, out, err = call("compare", "--swap", "motor.yaml", "second.yaml")
    assert (code, out) == (1, "") and message in err and err.count("\n") == 1, err


def test_one_recording_behind_both_files_is_refused(call, folder):
    for name in ("motor", "load"):
        path = folder / f"{name}.yaml"
        content = yaml.safe_load(path.read_text()) | {"data": [{"file": f"{name}.parquet", "sha256": "0" * 64}]}
        path.write_text(yaml.safe_dump(content))
    code, _, err = call("compare", "--swap", "motor.yaml", "load.yaml")
    assert code == 1 and "found motor.parquet as the source of both" in err


def test_inputs_in_ampere_are_of_two_machines(call, folder):
    for name in ("motor", "load"):
        content = {"motor.inertia": (0.2, "A s^2/rad", 0.01), "load.inertia": (0.2, "A s^2/rad", 0.01)}
        (folder / f"{name}.yaml").write_text(file_of(content, {"name": "two-mass", "torque_unit": "A"}))
    code, _, err = call("compare", "--swap", "motor.yaml", "load.yaml")
    assert code == 1 and "found A in motor.yaml and load.yaml" in err


def test_values_of_one_recording_are_listed_and_not_compared(call, folder):
    content = yaml.safe_load((folder / "load.yaml").read_text())
    content["records"] = [{"file": "b.parquet", "sha256": "1" * 64}]
    content["parameters"]["load.coulomb@b.parquet"] = 3.0
    (folder / "load.yaml").write_text(yaml.safe_dump(content))
    code, out, err = call("compare", "--swap", "motor.yaml", "load.yaml")
    line = next(x for x in yaml.safe_load(out)["swap"]["lines"] if "@" in x["second"])
    assert code == 0 and (line["first"], line["difference"]) == ("", None), err
    assert line["reason"] == "of one recording alone"


def test_a_variance_that_is_none_is_refused(call, folder):
    content = yaml.safe_load((folder / "load.yaml").read_text())
    content["covariance"] = {"names": ["motor.inertia"], "matrix": [[-1.0]]}
    (folder / "load.yaml").write_text(yaml.safe_dump(content))
    code, _, err = call("compare", "--swap", "motor.yaml", "load.yaml")
    assert code == 1 and "wanted variances above zero" in err and "motor.inertia" in err


def test_without_an_interval_nothing_is_decided(call, folder):
    (folder / "load.yaml").write_text(file_of({n: (v, unit, None) for n, (v, unit, _) in LOAD.items()}))
    code, out, err = call("compare", "--swap", "motor.yaml", "load.yaml", "--strict", "--plot", "pictures")
    found = yaml.safe_load(out)
    assert code == 3 and [f["code"] for f in found["findings"]] == ["sides-not-compared"]
    assert found["swap"]["agree"] is None and found["swap"]["chi_square"] is None
    assert "the two sides cannot be compared" in err
