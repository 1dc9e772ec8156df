"""simulate and effects: the simulation as a recording, the catalogue of effects as a list."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from drivetool.check.causes import CAUSES, chosen_causes, size_parameters
from drivetool.check.validation import run_model
from drivetool.drive import one_body, two_mass
from drivetool.drive.chain import three_mass
from drivetool.drive.effects import EFFECTS
from drivetool.errors import BadOption, BadParameters
from drivetool.identify.estimate import Parameter
from drivetool.logs import Experiment
from drivetool.logs.door import open_experiment
from tests.places import FIXTURES
from tests.simulator.experiments import multisine
from tests.simulator.machine import machine_by_seed, running
from tests.simulator.records import write_parquet
from tests.simulator.simulate import simulate_linear

STEP = 1e-3


def fixture_file(folder, room="rig"):
    """A parameter file with the true values of a fixture."""
    truth = yaml.safe_load((FIXTURES / room / "truth.yaml").read_text())["parameters"]
    path = folder / f"{room}.yaml"
    drive = {"name": "one-body", "torque_unit": "N", "motion_unit": "m"} if room == "axis" else {}
    path.write_text(yaml.safe_dump({"schema": "drivetool/parameters/1", "drive": drive, "parameters": {
        name: float(entry["value"]) for name, entry in truth.items()}}))
    return path


def linear(n=1500, seed=3):
    """(experiment, drive, run) of a linear machine of the independent simulator, without noise."""
    machine = machine_by_seed(seed)
    start = running(machine, 20.0)
    torque = start.torque + multisine(np.arange(2.0, 30.0, 4.0), 0.1 * machine.rated_torque, n * STEP, STEP, seed)
    run = simulate_linear(machine, torque, STEP, start)
    values = {"shaft.stiffness": machine.stiffness[0], "shaft.damping": machine.damping[0]}
    for i, body in enumerate(("motor", "load")):
        values |= {f"{body}.{name}": getattr(machine, name)[i]
                   for name in ("inertia", "viscous", "idle_torque")}
    signals = {"motor_torque": torque, "motor_speed": run.speeds[:, 0]}
    return Experiment("r", "r", STEP, 0.0, signals, ((0, n),)), two_mass().with_values(values), run


@pytest.mark.parametrize("segment", [0.0, 0.5])
def test_every_role_agrees_with_an_independent_simulator(segment):
    experiment, drive, truth = linear()
    found = run_model(experiment, drive, segment)
    assert list(found.simulated) == ["motor_speed", "load_speed", "motor_angle", "load_angle", "shaft_torque"]
    assert len(found.pieces) == (3 if segment else 1) and found.pieces[-1][1] == 1500
    size = float(np.ptp(truth.speeds[:, 0]))
    np.testing.assert_allclose(found.simulated["motor_speed"], truth.speeds[:, 0], atol=1e-6 * size)
    np.testing.assert_allclose(found.simulated["load_speed"], truth.speeds[:, 1], atol=1e-5 * size)
    torque = truth.shaft_torques[:, 0]
    np.testing.assert_allclose(found.simulated["shaft_torque"], torque, atol=1e-5 * np.ptp(torque))
    for body, role in enumerate(("motor_angle", "load_angle")):
        angle = found.simulated[role]
        assert angle[0] == 0.0
        # Pieces are joined with the mean speed of the sample between them.
        np.testing.assert_allclose(angle, truth.angles[:, body] - truth.angles[0, body], atol=1e-4)
    assert [found.unit(role) for role in ("load_speed", "load_angle", "shaft_torque")] == ["rad/s", "rad", "Nm"]


def test_an_angle_that_was_measured_keeps_its_zero():
    experiment, drive, truth = linear()
    angle = truth.angles[:, 1] + 5.0
    angle[100:120] = np.nan
    found = run_model(replace(experiment, signals={**experiment.signals, "load_angle": angle}), drive)
    np.testing.assert_allclose(found.simulated["load_angle"], truth.angles[:, 1] + 5.0, atol=1e-5)
    assert np.isnan(found.measured["load_angle"][100:120]).all()


def test_three_bodies_have_two_shaft_torques():
    values = {"motor.inertia": 0.5, "gear.inertia": 0.8, "arm.inertia": 2.0, "shaft.stiffness": 3000.0,
              "shaft.damping": 2.0, "shaft2.stiffness": 5000.0, "shaft2.damping": 3.0, "shaft2.half_gap": 0.002}
    drive = three_mass().with_values(values)
    t = np.arange(1000) * STEP
    torque = 30.0 * np.sign(np.sin(9.0 * t))
    e = Experiment("r", "r", STEP, 0.0, {"motor_torque": torque, "motor_speed": np.zeros(1000)}, ((0, 1000),))
    found = run_model(e, drive).simulated
    arm = np.gradient(found["load_speed"], STEP) * 2.0
    carried = found["shaft2_torque"]
    inside = np.abs(np.diff(carried, prepend=0.0)) < 5.0  # away from impacts, where differences are inexact
    np.testing.assert_allclose(carried[inside][2:-2], arm[inside][2:-2], atol=0.02 * np.ptp(carried))
    assert np.mean(carried == 0.0) > 0.02  # the gap opens


def test_what_cannot_be_simulated():
    experiment, drive, _ = linear(200)
    with pytest.raises(BadParameters, match=r"load\.inertia"):
        run_model(experiment, two_mass())
    with pytest.raises(BadOption, match="20 samples"):
        run_model(experiment, drive, 0.01)


def test_the_table_is_a_recording(here, call):
    model = fixture_file(here)
    words = ["simulate", FIXTURES / "rig" / "steps_holdout.parquet", "-p", model, "--segment", 2]
    assert call(*words, "--out", "new/sim.parquet")[0] == 0
    Path("new/sim.parquet").rename("sim.parquet")
    code, out, err = call(*words, "--out", "sim.parquet", "--plot", "p")
    assert (code, out) == (0, "") and "motor_speed: fit 99." in err and "wrote sim.parquet" in err
    assert [path.name for path in Path("p").iterdir()] == ["simulate-record.png"]
    table = pq.read_table("sim.parquet")
    assert table.schema.field("load_angle").metadata[b"unit"] == b"rad"
    assert table.schema.metadata[b"models"] == b"rig.yaml"
    assert "motor_speed_measured" in table.column_names and table.num_rows > 1000
    again = open_experiment("sim.parquet")
    assert {"motor_torque", "motor_speed", "load_speed", "shaft_torque", "load_angle"} <= set(again.signals)
    before = Path("sim.parquet").read_bytes()
    assert call(*words, "--out", "sim.parquet", "--quiet") == (0, "", "")
    assert Path("sim.parquet").read_bytes() == before and str(here).encode() not in before


@pytest.mark.parametrize("words, code, message", [
    (["--out", "sim.csv"], 2, "ends in .parquet"), ([], 2, "--out"),
    (["--out", "rig.yaml/s.parquet"], 2, "no folder"),
    (["--out", "s.parquet", "--set", "load.inertia=-1"], 2, "between"),
    (["--out", "s.parquet", "--segment", "0.001"], 2, "20 samples"),
])
def test_nothing_is_written_when_it_fails(here, call, words, code, message):
    model = fixture_file(here)
    found, out, err = call("simulate", FIXTURES / "rig" / "steps_holdout.parquet", "-p", model, *words)
    assert found == code and message in out + err and "Traceback" not in err
    assert [path.name for path in here.iterdir()] == [model.name]


def test_a_constant_channel_has_no_fit_figure_and_the_line_says_why(tmp_path, call):
    n = 400
    torque = np.sin(20.0 * np.arange(n) * STEP)
    # A tenth has no exact mean, so that rounding would give the channel a variance.
    write_parquet(tmp_path / "r.parquet", {
        "motor_torque": (torque, "Nm"), "motor_speed": (np.cumsum(torque) * STEP, "rad/s"),
        "load_speed": (np.full(n, 0.1), "rad/s")}, STEP)
    code, _, err = call("simulate", tmp_path / "r.parquet", "-p", fixture_file(tmp_path),
                        "--out", tmp_path / "s.parquet", "--plot", tmp_path / "p")
    assert code == 0 and "nan" not in err
    assert "load_speed: fit undefined (the signal is constant), rmse 0." in err


def test_an_axis_is_simulated_from_its_angle(tmp_path, call):
    out = tmp_path / "s.parquet"
    code, _, err = call("simulate", FIXTURES / "axis" / "moves_holdout.mcap", "-p", fixture_file(tmp_path, "axis"),
                        "--out", out)
    assert code == 0 and "rmse" in err and " m\n" in err
    assert pq.read_schema(out).field("motor_speed").metadata[b"unit"] == b"m/s"


def test_effects_are_listed_with_all_they_say(call):
    listed = yaml.safe_load(call("effects")[1])["effects"]
    assert [e["code"] for e in listed][:len(EFFECTS)] == [e.code for e in EFFECTS]
    assert json.loads(call("effects", "--json")[1])["effects"] == listed
    gap = yaml.safe_load(call("effects", "backlash")[1])
    assert gap["parameters"]["half_gap"] == {
        "unit": "rad", "meaning": "backlash half gap", "bounds": [0.0, 1000.0], "neutral": 0.0}
    assert "Nordin" in gap["source"] and "shaft torque" in gap["needs"]
    assert yaml.safe_load(call("effects", "coulomb-load")[1])["code"] == "coulomb"
    code, out, err = call("effects", "backlas")
    assert (code, out) == (2, "") and "Did you mean 'backlash'?" in err
    table = re.sub(r"\x1b\[[0-9;]*m", "", call("effects", terminal=True)[1])
    assert all(e["code"] in table for e in listed) and max(map(len, table.splitlines())) <= 80
    assert "half_gap" in call("effects", "backlash", terminal=True)[1]


def test_every_cause_points_to_what_there_is():
    codes = {effect.code: effect for effect in EFFECTS}
    assert {cause.effect for cause in CAUSES.values()} >= {None, "backlash", "coulomb", "stribeck"}
    for code, cause in CAUSES.items():
        assert cause.text.endswith(".") and cause.look.endswith(".") and cause.name[0].islower(), code
        if cause.effect is None:
            assert cause.needs
        else:
            assert set(cause.sizes) <= set(codes[cause.effect].quantities), code


def test_causes_are_chosen_by_code():
    assert chosen_causes([], two_mass()) == ()
    assert chosen_causes(["backlash", "coulomb-motor", "backlash"], two_mass()) == ("backlash", "coulomb-motor")
    assert chosen_causes(["backlash", "coulomb-motor"], one_body()) == ("coulomb-motor",)
    with pytest.raises(BadOption, match="Did you mean 'backlash'"):
        chosen_causes(["baklash"], two_mass())
    with pytest.raises(BadOption, match="one-body drive cannot have"):
        chosen_causes(["backlash"], one_body())


def test_sizes_are_those_of_the_cause():
    fitted = tuple(Parameter(name=name, value=1.0, unit="Nm")
                   for name in ("load.inertia", "motor.coulomb", "load.coulomb"))
    assert [p.name for p in size_parameters("coulomb-load", fitted)] == ["load.coulomb"]
    assert [p.name for p in size_parameters("coulomb-motor", fitted)] == ["motor.coulomb"]
    assert size_parameters("unheard-of", fitted) == fitted
