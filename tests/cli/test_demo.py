"""The whole chain at the command line on the example drive; its truth is opened afterwards."""

from __future__ import annotations

import subprocess
import sys

import pytest
import yaml

from tests.places import RIG


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """Folder with the results of `make demo`."""
    folder = tmp_path_factory.mktemp("demo")
    done = subprocess.run([sys.executable, "-m", "drivetool.cli.demo", str(RIG), str(folder)],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "shaft.half_gap" in done.stdout and "Passed" in done.stdout
    return folder


def read(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_every_step_holds_the_truth(out):
    truth = read(RIG / "truth.yaml")["parameters"]
    values = {name: entry["value"] for name, entry in truth.items()}
    values["total.viscous"] = values["motor.viscous"] + values["load.viscous"]
    values["total.idle_torque"] = values["motor.idle_torque"] + values["load.idle_torque"]
    checked = 0
    for step in ("steady", "blackbox", "greybox", "backlash"):
        for name, entry in read(out / f"{step}.yaml")["parameters"].items():
            if entry["std"] is not None:
                assert abs(entry["value"] - values[name]) < 4.0 * entry["std"], f"{step}: {name}"
                checked += 1
    assert checked >= 15


def test_half_gap_is_found_to_a_tenth_of_a_per_cent(out):
    entry = read(out / "backlash.yaml")["parameters"]["shaft.half_gap"]
    assert entry["status"] == "fitted"
    assert entry["value"] == pytest.approx(0.07505, rel=1e-3)


def test_validation_passes_on_the_record_no_fit_has_seen(out):
    checks = read(out / "validation.yaml")["checks"]
    assert [check["passed"] for check in checks] == [True]
    assert checks[0]["simulation_fit_percent"] > 98.0
    assert checks[0]["correlation_p"] > 0.01


def test_pictures_lie_beside_the_files(out):
    assert len(list(out.glob("*-record.png"))) == 5


@pytest.mark.slow
def test_mcap_gives_the_same_estimate_as_parquet_and_repeats_to_the_byte(out, tmp_path):
    words = [sys.executable, "-m", "drivetool.cli.main", "greybox", "--params", str(out / "blackbox.yaml"), "--out"]
    for name in ("first.yaml", "again.yaml"):
        subprocess.run([*words, str(tmp_path / name), str(RIG / "steps.parquet")], check=True, capture_output=True)
    subprocess.run([*words, str(tmp_path / "mcap.yaml"), str(RIG / "steps.mcap")], check=True, capture_output=True)
    assert (tmp_path / "first.yaml").read_bytes() == (tmp_path / "again.yaml").read_bytes()
    parquet, mcap = read(tmp_path / "first.yaml"), read(tmp_path / "mcap.yaml")
    for key in ("parameters", "covariance", "fit", "noise"):
        assert parquet[key] == mcap[key]


@pytest.mark.slow
def test_reversing_drive_is_identified_from_an_inexact_data_sheet(tmp_path):
    """Gap, Coulomb friction and the bodies' shares of friction, from one record and an approximate data sheet."""
    folder = RIG.parent / "reversing"
    tool = [sys.executable, "-m", "drivetool.cli.main"]
    steady, result = tmp_path / "steady.yaml", tmp_path / "result.yaml"
    subprocess.run([*tool, "steady", str(folder / "steady.parquet"), "--out", str(steady)],
                   check=True, capture_output=True)
    data_sheet = ["motor.inertia=0.5", "load.inertia=5.8", "shaft.stiffness=3000", "shaft.damping=3"]
    subprocess.run([*tool, "backlash", str(folder / "moves.parquet"), "--params", str(steady), "--free", "all",
                    *(word for value in data_sheet for word in ("--set", value)), "--out", str(result)],
                   check=True, capture_output=True)
    values = {name: entry["value"] for name, entry in read(folder / "truth.yaml")["parameters"].items()}
    found = read(result)["parameters"]
    assert found["motor.viscous"]["status"] == "fitted"
    for name, entry in found.items():
        if entry["std"] is not None:
            assert abs(entry["value"] - values[name]) < 4.0 * entry["std"], name
        elif entry["status"] == "at-bound":
            assert entry["ci95"][0] <= values[name] <= entry["ci95"][1], name
    assert found["shaft.half_gap"]["value"] == pytest.approx(0.01, rel=0.01)
