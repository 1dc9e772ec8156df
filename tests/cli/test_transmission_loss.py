"""Each step with the loss of a transmission: it takes the law, or says by name that it does not."""

import pytest
import yaml

from tests.identify.test_loss_recovered import BODIES, FIRST_SEED, STEP, machine_of, record_of, values_of
from tests.simulator.records import write_parquet

SEEDS = {"one-body": FIRST_SEED, "two-mass": FIRST_SEED + 1}
EACH_DRIVE = pytest.mark.parametrize("drive", SEEDS)
REFUSING = {"steady": ("steady",), "of accelerations": ("steady", "--method", "acceleration"),
            "black box": ("blackbox",), "frequency": ("greybox", "--criterion", "frequency")}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Of each drive a record and a parameter file with the true values."""
    found = tmp_path_factory.mktemp("loss")
    for drive, seed in SEEDS.items():
        machine = machine_of(seed)
        values, given = values_of(machine)
        write_parquet(found / f"{drive}.parquet", {role: (signal, "Nm" if role == "motor_torque" else "rad/s")
                      for role, signal in record_of(machine, seed).signals.items()}, STEP)
        (found / f"{drive}.yaml").write_text(yaml.safe_dump({
            "schema": "drivetool/parameters/1", "drive": {"name": drive},
            "parameters": {n: float(v) for n, v in (values | given).items()}}))
    return found


def words_of(folder, drive, *words):
    return *words, folder / f"{drive}.parquet", "--params", folder / f"{drive}.yaml"


@EACH_DRIVE
def test_the_model_is_valid_and_the_loss_is_refined(call, folder, drive, tmp_path):
    code, _, err = call(*words_of(folder, drive, "validate"), "--min-fit", 99, "--start", "rest",
                        "--out", tmp_path / "valid.yaml")
    assert code == 0, err
    body, found = BODIES[drive == "two-mass"], tmp_path / "found.yaml"
    losses = [f"{body}.loss_driving", f"{body}.loss_driven"]
    code, _, err = call(*words_of(folder, drive, "greybox"), "--hold", f"{body}.inertia", "--free", losses[0],
                        "--free", losses[1], "--criterion", "innovations", "--out", found)
    assert code == 0, err
    lines, true = yaml.safe_load(found.read_text())["parameters"], values_of(machine_of(SEEDS[drive]))[0]
    for name in losses:
        assert abs(lines[name]["value"] - true[name]) < 4.0 * lines[name]["std"] < 0.02, name


@EACH_DRIVE
@pytest.mark.parametrize("step", REFUSING)
def test_a_step_without_the_law_refuses_it_by_name(call, folder, drive, step):
    code, _, err = call(*words_of(folder, drive, *REFUSING[step]))
    assert code == 2 and f"found {BODIES[drive == 'two-mass']}.loss_driving, " in err and "Traceback" not in err


def test_a_loss_that_is_free_is_refused_too(call, folder):
    code, _, err = call(*words_of(folder, "one-body", *REFUSING["frequency"]), "--set", "motor.loss_driving=0",
                        "--set", "motor.loss_driven=0", "--free", "motor.loss_driven")
    assert code == 2 and "found motor.loss_driven." in err


@EACH_DRIVE
def test_the_loop_is_that_of_a_drive_without_it(call, folder, drive):
    code, _, err = call("tune", "--params", folder / f"{drive}.yaml", "--converter", "433,0.69,2 ms", "--out", "-")
    assert code == 0 and "note not-in-loop" in err and f"{BODIES[drive == 'two-mass']}.loss_driven" in err
