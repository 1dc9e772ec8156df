"""Coast-downs with hidden effects, by the command line and records alone; labels are opened afterwards."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
import yaml

from tests.hidden.command import run
from tests.places import FIXTURES
from tests.simulator.coasting import RPM, Motor, driven, motion, numbers
from tests.simulator.records import write_parquet

PAPER, STEP, RATIO = Motor(), 1e-4, 2.5
COAST = ("--method", "coast-down", "--drive", "one-body")
MAP = """\
schema: drivetool/channel-map/1
roles:
  motor_angle: {channel: motor_angle, unit: counts, per_rev: 1000}
"""


def write(path, angle, seed, torque=None, wrap=None):
    """An angle as a counter has it, with the torque if one was logged."""
    counted = numbers(angle, seed)
    record = {"motor_angle": (counted if wrap is None else np.mod(counted, wrap), "counts")}
    write_parquet(path, record | ({} if torque is None else {"motor_torque": (torque, "Nm")}), STEP)
    (path.parent / "map.yaml").write_text(MAP)
    (path.parent / "driven.yaml").write_text(MAP + "  motor_torque: {channel: motor_torque}\n")


def write_coast_down(path, motor, seed, fast=2240.0, end=80.0 * RPM):
    """A coast-down without a torque channel."""
    write(path, motion(motor, lambda t: 0.0, fast * RPM, end, 5.0, STEP)[0], seed)


def steady(folder, *words, names="map.yaml"):
    """(what it wrote, what it said) of steady."""
    done = run(folder, ["steady", *words, "--map", names, "--out", "out.yaml"])
    assert done.returncode == 0, done.stderr
    return yaml.safe_load((folder / "out.yaml").read_text()), done.stderr


def finding(file, code):
    """The one finding of a code."""
    (found,) = (f for f in file["findings"] if f["code"] == code)
    return found


@pytest.fixture
def label(tmp_path):
    """Writes and reads what is true, where no command looks."""
    path = tmp_path / "label" / "label.json"
    path.parent.mkdir()

    def label(**truth):
        if truth:
            path.write_text(json.dumps(truth))
        return json.loads(path.read_text())
    return label


@pytest.mark.slow
@pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.long), 2])
def test_breakaway_friction_is_named_and_its_gain_is_that_of_another_run(tmp_path, label, seed):
    folder = tmp_path / "records"
    folder.mkdir()
    hidden = replace(PAPER, surplus=0.5 * PAPER.coulomb, breakaway_speed=5.0)
    label(law="breakaway", breakaway_over_inertia=hidden.surplus / hidden.inertia, breakaway_speed=5.0)
    write_coast_down(folder / "coast.parquet", hidden, seed, end=1e-3)
    write_coast_down(folder / "another.parquet", hidden, 100 + seed, end=1e-3)
    # A known inertia is not required: whatever is held, the drive coasts down the same.
    known = ("--set", "motor.inertia=1", "--hold", "motor.inertia")
    plain, _ = steady(folder, "coast.parquet", *COAST, *known)
    (folder / "out.yaml").rename(folder / "plain.yaml")
    said = finding(plain, "nonlinear-friction")
    options = shlex.split(said["action"].partition("with ")[2].rstrip("."))
    full, _ = steady(folder, "coast.parquet", "--method", "coast-down", *options, *known)
    done = run(folder, ["validate", "another.parquet", "--map", "map.yaml", "--params", "plain.yaml", "--params",
                        "out.yaml", "--out", "checked.yaml"])
    assert done.returncode == 0, done.stderr
    checked = yaml.safe_load((folder / "checked.yaml").read_text())
    assert finding(checked, "coast-down-assumed")
    before, after = (check["rmse"] for check in checked["checks"] if check["output"] == "motor_angle")
    evidence, truth = said["evidence"], label()
    assert evidence["law"] == truth["law"]
    assert evidence["gain_low"] < 100.0 * (1.0 - after / before) < evidence["gain_high"]
    assert evidence["gain_high"] - evidence["gain_low"] < 25.0  # most of it is where the drive stops in a count
    assert "nonlinear-friction" not in [f["code"] for f in full["findings"]]
    surplus, speed = full["derived"]["breakaway_over_inertia"], full["parameters"]["motor.breakaway_speed"]
    assert abs(surplus["value"] - truth["breakaway_over_inertia"]) < 3.5 * surplus["std"]
    assert abs(speed["value"] - truth["breakaway_speed"]) < 3.5 * speed["std"]


@pytest.mark.parametrize(("hidden", "law"), [
    pytest.param({"drag": 2e-8}, "drag", marks=pytest.mark.slow),
    pytest.param({"surplus": 0.3 * PAPER.coulomb, "breakaway_speed": 10.0, "drag": 2e-8}, "drag breakaway",
                 marks=pytest.mark.slow),
    ({}, None)], ids=["drag", "both", "none"])
def test_other_laws_are_distinguished_from_it_and_none_is_found_in_noise(tmp_path, hidden, law):
    write_coast_down(tmp_path / "coast.parquet", replace(PAPER, **hidden), 3,
                     end=1e-3 if "surplus" in hidden else 80 * RPM)
    file, _ = steady(tmp_path, "coast.parquet", *COAST)
    found = [f["evidence"].get("law") for f in file["findings"] if f["code"] == "nonlinear-friction"]
    assert found == ([law] if law else [])


@pytest.mark.slow
@pytest.mark.parametrize("fall", [0.0, 0.01])
def test_a_friction_that_falls_from_run_to_run_is_said_with_its_size(tmp_path, label, fall):
    folder = tmp_path / "records"
    folder.mkdir()
    label(fall_percent=100.0 * (1.0 - (1.0 - fall) ** 3))
    logs = [f"run{k}.parquet" for k in range(4)]
    for k, log in enumerate(logs):
        warm = (1.0 - fall) ** k
        write_coast_down(folder / log, replace(PAPER, viscous=warm * PAPER.viscous, coulomb=warm * PAPER.coulomb),
                         k)
    file, _ = steady(folder, *logs, *COAST)
    if not fall:
        assert "scatter-beyond-noise" not in [f["code"] for f in file["findings"]]
        return
    said = finding(file, "scatter-beyond-noise")
    for name in ("viscous", "coulomb", "together"):
        assert said["evidence"][name] == pytest.approx(-label()["fall_percent"], abs=0.02), name
    assert "temperature" in said["action"]
    assert "nonlinear-friction" not in [f["code"] for f in file["findings"]]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_records_with_and_without_a_belt_identify_the_ratio_of_the_inertias(tmp_path, label, seed):
    folder = tmp_path / "records"
    folder.mkdir()
    behind = 3e-4 * (1.0 + 0.2 * seed)
    label(ratio=behind / RATIO**2 / PAPER.inertia)
    write_coast_down(folder / "motor.parquet", PAPER, seed)
    write_coast_down(folder / "belt.parquet", replace(PAPER, inertia=PAPER.inertia + behind / RATIO**2), 10 + seed)
    file, _ = steady(folder, "motor.parquet", "belt.parquet", *COAST, "--record", "belt.parquet",
                     "free=motor.added_inertia")
    found = file["derived"]["added_inertia_in_belt.parquet_over_inertia"]
    assert abs(found["value"] - label()["ratio"]) < 3.0 * found["std"] < 1e-3 * found["value"]
    assert file["parameters"]["motor.inertia"]["std"] is None


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_of_a_load_behind_a_belt_a_known_pulley_identifies_the_inertia(tmp_path, label, seed):
    """Motor alone, then with the known pulley on it, then with belt and load: the load as a second body."""
    folder = tmp_path / "records"
    folder.mkdir()
    pulley, behind = 5e-5, 3e-4
    label(motor=PAPER.inertia, load=behind)
    write_coast_down(folder / "motor.parquet", PAPER, seed)
    write_coast_down(folder / "pulley.parquet", replace(PAPER, inertia=PAPER.inertia + pulley), 10 + seed)
    whole = replace(PAPER, inertia=PAPER.inertia + behind / RATIO**2)
    torque, angle, _ = driven(whole, 0.06, 100.0, 80 * RPM, 0.5, STEP)
    write(folder / "belt.parquet", angle, 20 + seed, torque)
    alone, _ = steady(folder, "motor.parquet", "pulley.parquet", *COAST, "--record", "pulley.parquet",
                      f"motor.added_inertia={pulley}")
    motor = alone["parameters"]["motor.inertia"]
    assert abs(motor["value"] - label()["motor"]) < 3.0 * motor["std"]
    (folder / "drive.yaml").write_text(yaml.safe_dump({
        "schema": "drivetool/parameters/1", "drive": {"name": "two-mass", "bodies": ["motor", "load"],
                                                      "shafts": ["shaft"]},
        "parameters": {"shaft.ratio": {"value": RATIO, "unit": "1"},
                       "motor.inertia": {"value": motor["value"], "unit": "kg m^2"}}}))
    file, _ = steady(folder, "belt.parquet", "--method", "coast-down", "--params", "drive.yaml", "--hold",
                     "motor.inertia", names="driven.yaml")
    load = file["parameters"]["load.inertia"]
    spread = np.hypot(load["std"], RATIO**2 * motor["std"])  # the held one has an uncertainty of its own
    assert abs(load["value"] - label()["load"]) < 3.0 * spread


def bad(name, folder):
    """(further words, the words that the message must have) of a recording without information."""
    angle = motion(PAPER, lambda t: 0.0, 2240 * RPM, 80 * RPM, 5.0, STEP)[0]
    log, zero = folder / "coast.parquet", np.zeros(len(angle))
    steadily = 150.0 * STEP * np.arange(len(angle))
    if name == "always driven":
        torque, angle, _ = driven(PAPER, 0.06, 100.0, 80 * RPM, 0.5, STEP)
        write(log, angle[torque > 0.0], 1, torque[torque > 0.0])
    elif name == "one speed":
        write(log, steadily, 1)
    elif name == "zeros and one speed":
        write(log, steadily, 1, zero)
    elif name == "zeros and standing":
        write(log, zero, 1, zero)
    elif name == "sixteen bits":
        write(log, angle + 370.0, 1, wrap=65536)
    elif name == "twelve bits":
        write(log, angle, 1, wrap=4096)
    elif name == "nothing added":
        write(log, angle, 1)
        write(folder / "disc.parquet", angle[50:], 2)
    elif name == "more than the whole":
        torque, angle, _ = driven(PAPER, 0.06, 100.0, 80 * RPM, 0.5, STEP)
        write(log, angle, 1, torque)
    return BAD[name]


NO_COAST_DOWN = ("coasts down without torque", "Switch the drive off at speed and record until it stands")
BAD = {
    "always driven": ((*COAST,), NO_COAST_DOWN),
    "one speed": ((*COAST,), NO_COAST_DOWN),
    "zeros and one speed": ((*COAST,), NO_COAST_DOWN),
    "zeros and standing": ((*COAST,), ("only constant signals", "record while the drive is excited")),
    "sixteen bits": ((*COAST,), ("an unwrapped angle", "`wrap: 65536`")),
    "twelve bits": ((*COAST,), ("an unwrapped angle", "`wrap: 4096`")),
    "nothing added": (
        ("disc.parquet", *COAST, "--record", "disc.parquet", "motor.added_inertia=5e-5"),
        ("in the coast-down with the added inertia", "record again with one about as large")),
    "more than the whole": (
        ("--method", "coast-down", "--drive", "two-mass", "--set", "motor.inertia=2e-4", "--hold", "motor.inertia"),
        ("8.75e-05 kg m^2", "a record of the motor alone")),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD)
def test_an_uninformative_recording_is_refused_with_what_to_record(tmp_path, name):
    words, parts = bad(name, tmp_path)
    torque = name.startswith(("always", "zeros", "more"))
    done = run(tmp_path, ["steady", "coast.parquet", *words, "--map", "driven.yaml" if torque else "map.yaml",
                          "--out", "out.yaml"])
    assert done.returncode == 1 and not (tmp_path / "out.yaml").exists()
    (line,) = (line for line in done.stderr.splitlines() if "error:" in line)
    assert all(part in line for part in parts), line


@pytest.mark.slow
def test_an_added_inertia_with_a_wrong_unit_beside_a_held_one_is_said(tmp_path):
    write_coast_down(tmp_path / "motor.parquet", PAPER, 1)
    write_coast_down(tmp_path / "disc.parquet", replace(PAPER, inertia=PAPER.inertia + 5e-5), 2)
    file, _ = steady(tmp_path, "motor.parquet", "disc.parquet", *COAST, "--record", "disc.parquet",
                     "motor.added_inertia=5e-3", "--set", "motor.inertia=8.75e-5", "--hold", "motor.inertia")
    assert "its unit" in finding(file, "scatter-beyond-noise")["action"]


@pytest.mark.slow
@pytest.mark.parametrize(("command", "words", "says"), [
    ("diagnose", (), "which identifies the missing friction law"),
    ("greybox", ("--set", "motor.inertia=1"), "use steady --method coast-down")])
def test_other_commands_say_what_to_take_for_a_coast_down(tmp_path, command, words, says):
    write_coast_down(tmp_path / "coast.parquet", PAPER, 1)
    steady(tmp_path, "coast.parquet", *COAST)
    done = run(tmp_path, [command, "coast.parquet", "--map", "map.yaml", "--params", "out.yaml", *words])
    assert done.returncode == 1
    (line,) = (line for line in done.stderr.splitlines() if "error:" in line)
    assert says in line


@pytest.mark.slow
@pytest.mark.parametrize("known", [False, True])
def test_a_belt_with_friction_of_its_own_widens_the_interval(tmp_path, label, known):
    """A tenth more Coulomb friction with the belt than without: the inertia is known no better than that."""
    folder = tmp_path / "records"
    folder.mkdir()
    label(added=5e-5, motor=PAPER.inertia)
    write_coast_down(folder / "motor.parquet", PAPER, 1)
    belt = replace(PAPER, inertia=PAPER.inertia + 5e-5, coulomb=1.1 * PAPER.coulomb)
    write_coast_down(folder / "belt.parquet", belt, 2)
    file, _ = steady(folder, "motor.parquet", "belt.parquet", *COAST, "--record", "belt.parquet",
                     "motor.added_inertia=5e-5" if known else "free=motor.added_inertia")
    assert finding(file, "scatter-beyond-noise")
    found = (file["parameters"]["motor.inertia"] if known else
             file["derived"]["added_inertia_in_belt.parquet_over_inertia"])
    truth = label()["motor"] if known else label()["added"] / label()["motor"]
    assert abs(found["value"] - truth) < 3.0 * found["std"]
    assert found["std"] > 0.02 * truth


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mcap", "parquet"])
def test_the_fixtures_identify_the_truth_in_both_formats(tmp_path, kind):
    (tmp_path / "coast").symlink_to(FIXTURES / "coast")
    stated = yaml.safe_load((FIXTURES / "coast/truth.yaml").read_text())["parameters"]
    truth = {name: entry["value"] for name, entry in stated.items()}
    disc, words = f"coast/disc.{kind}", ("--record", f"coast/disc.{kind}", "motor.added_inertia=5e-5")
    counter = (f"coast/plain.{kind}", disc, *words, "--map", "coast/map.yaml")
    for given in (counter, (f"coast/speed.{kind}",)):
        done = run(tmp_path, ["steady", *given, *COAST, "--out", "out.yaml"])
        assert done.returncode == 0, done.stderr
        file = yaml.safe_load((tmp_path / "out.yaml").read_text())
        for name, value in truth.items():
            entry = file["parameters"][name]
            assert abs(entry["value"] - value) < 3.0 * entry["std"] < 1e-3 * value, name
