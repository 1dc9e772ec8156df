"""Acceleration and clamped recordings at the process boundary, as Parquet and as MCAP, files or standard input."""


import pytest
import yaml

from tests.bus_fixtures import BUS
from tests.places import FIXTURES

FOLDER = FIXTURES / "bus"
DRIVE = ("--params", FOLDER / "drive.yaml")
METHOD = ("--method", "acceleration")


def content_of(path):
    return yaml.safe_load(path.read_text())


def clamped(log):
    return ("--record", log, "clamped=wheels")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["parquet", "mcap"])
def test_acceleration_in_both_formats(call, tmp_path, suffix):
    code, _, err = call("steady", FOLDER / f"acceleration.{suffix}", *METHOD, *DRIVE, "--set", "motor.inertia=4.5",
                        "--out", tmp_path / "out.yaml", "--plot", tmp_path / "pictures")
    assert code == 0, err
    found = content_of(tmp_path / "out.yaml")
    mass, force = found["parameters"]["wheels.carried_mass"], found["derived"]["constant_force_at_wheels"]
    assert abs(mass["value"] - BUS["wheels.carried_mass"]) < 3.0 * mass["std"] and mass["unit"] == "kg"
    assert abs(force["value"] - 2420.0) < 3.0 * force["std"] and force["unit"] == "N"
    assert found["options"]["method"] == "acceleration"
    assert {p.name for p in (tmp_path / "pictures").iterdir()} == {
        "steady-acceleration-steady.png", "steady-acceleration-record.png"}


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["parquet", "mcap"])
def test_a_clamped_record_in_both_formats_and_by_standard_input(call, tmp_path, suffix):
    log = FOLDER / f"held.{suffix}"
    code, _, err = call("greybox", log, *clamped(log), "--params", "-", "--out", tmp_path / "out.yaml",
                        stdin=(FOLDER / "drive.yaml").read_bytes())
    assert code == 0, err
    found = content_of(tmp_path / "out.yaml")["parameters"]
    for name in ("motor.inertia", "shaft.stiffness", "shaft.damping"):
        assert abs(found[name]["value"] - BUS[name]) < 3.0 * found[name]["std"], name
    assert found[f"wheels.clamped@held.{suffix}"]["value"] == 1.0
    # The next step recognises the clamped recording by its content.
    code, _, err = call("validate", log, "--params", tmp_path / "out.yaml", "--out", tmp_path / "check.yaml")
    (check,) = content_of(tmp_path / "check.yaml")["checks"]
    assert "Traceback" not in err and check["simulation_fit_percent"] > 85.0


@pytest.mark.slow
def test_the_mass_of_a_clamped_file_goes_into_the_rolling_one(call, tmp_path):
    log = FOLDER / "held.parquet"
    call("greybox", log, *clamped(log), *DRIVE, "--out", tmp_path / "held.yaml")
    code, _, err = call("steady", FOLDER / "acceleration.parquet", *METHOD, "--params", tmp_path / "held.yaml",
                        "--out", tmp_path / "out.yaml")
    assert code == 0, err
    plain = content_of(tmp_path / "out.yaml")["parameters"]
    mass, motor = plain["wheels.carried_mass"], content_of(tmp_path / "held.yaml")["parameters"]["motor.inertia"]
    assert abs(mass["value"] - BUS["wheels.carried_mass"]) < 3.0 * mass["std"]
    assert mass["std"] > motor["std"] * (8.79 / 0.45) ** 2
    assert plain["shaft.stiffness"]["value"] > 1e6 and "shaft.stiffness" in str(plain)


@pytest.mark.parametrize("words, message", [
    (("clamped=wheel",), "Did you mean 'wheels'"),
    (("clamped=motor",), "motor at standstill"), (("clamped=",), "a body after clamped="),
    (("wheels.clamped=1",), "clamped=BODY after --record FILE")])
def test_a_clamp_that_is_none(call, tmp_path, words, message):
    log = FOLDER / "held.parquet"
    code, _, err = call("greybox", log, "--record", log, *words, *DRIVE, "--out", tmp_path / "out.yaml")
    assert code not in (0, 3) and message in err and "Traceback" not in err and not (tmp_path / "out.yaml").exists()


def test_a_bus_that_rolls_is_not_clamped(call):
    log = FOLDER / "acceleration.parquet"
    code, _, err = call("greybox", log, *clamped(log), *DRIVE)
    assert code not in (0, 3) and "rotates at" in err and "clamp it and record again" in err


def test_steady_of_an_acceleration_names_the_method(call):
    code, _, err = call("steady", FOLDER / "acceleration.parquet", *DRIVE)
    assert code not in (0, 3) and "--method acceleration" in err


@pytest.mark.slow
def test_uphill_and_downhill(call, tmp_path):
    code, _, err = call("steady", FOLDER / "uphill.mcap", FOLDER / "downhill.parquet", *METHOD, *DRIVE, "--set",
                        "motor.inertia=4.5", "--out", tmp_path / "out.yaml")
    assert code == 0, err
    (slope,) = [f for f in content_of(tmp_path / "out.yaml")["findings"] if f["code"] == "constant-load"]
    assert slope["evidence"]["slope_percent"] == pytest.approx(0.5, abs=0.05)


@pytest.mark.slow
def test_diagnose_of_a_clamped_record_finds_nothing(call, tmp_path):
    """The friction that a clamp leaves out is a cause by its sum, which has no body to be referred to."""
    log = FOLDER / "held.parquet"
    call("greybox", log, *clamped(log), *DRIVE, "--out", tmp_path / "held.yaml")
    code, _, err = call("diagnose", log, "--params", tmp_path / "held.yaml", "--out", tmp_path / "found.yaml")
    assert code == 0 and "diagnosis-nothing-found" in err, err
