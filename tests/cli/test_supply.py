"""A run-up of an induction motor under supply at the process boundary, in both formats."""

from pathlib import Path

import pytest
import yaml

COAST = Path(__file__).parents[2] / "fixtures" / "coast"
MAP = ("--map", str(COAST / "supply_map.yaml"))
METHOD = ("--method", "coast-down", "--drive", "one-body", "--params", str(COAST / "electrical.yaml"))
TRUTH = {"motor.inertia": 8.7499e-5, "motor.viscous": 1.0791e-4, "motor.coulomb": 0.012998}


@pytest.fixture
def written(call):
    """The file of a command, as plain values."""
    def run(*words, fails=0):
        code, out, err = call(*words, "--out", "-")
        assert code == fails, err
        return yaml.safe_load(out)
    return run


@pytest.mark.parametrize("kind", ["parquet", "mcap"])
def test_a_run_up_identifies_inertia_and_friction(written, kind):
    content = written("steady", str(COAST / f"supply.{kind}"), *MAP, *METHOD)
    assert content["findings"] == []
    for name, truth in TRUTH.items():
        p = content["parameters"][name]
        assert abs(p["value"] - truth) < 4.0 * p["std"] and p["std"] < 1e-4 * truth


@pytest.mark.slow
def test_the_file_simulates_the_run_up_and_is_validated_on_the_coast_down(call, written, here):
    log = str(COAST / "supply.parquet")
    assert call("steady", log, *MAP, *METHOD, "--out", "supply.yaml")[0] == 0
    assert call("simulate", log, *MAP, "--params", "supply.yaml", "--out", "run.parquet")[0] == 0
    up = written("validate", log, *MAP, "--params", "supply.yaml")
    assert up["checks"][0]["simulation_fit_percent"] > 99.9
    assert "stretches-left-out" in [f["code"] for f in up["findings"]]
    down = written("validate", log, *MAP, "--params", "supply.yaml", "--criterion", "coast-down")
    assert down["checks"][0]["rmse_counts"] < 1.05


def test_without_its_electrical_values_a_supply_is_no_torque(call):
    code, _, err = call("greybox", str(COAST / "supply.parquet"), *MAP, "--drive", "one-body",
                        "--set", "motor.inertia=1e-4")
    assert code == 1 and "motor_torque" in err


def test_one_phase_alone_is_refused(call, tmp_path):
    (tmp_path / "map.yaml").write_text(
        "schema: drivetool/channel-map/1\nroles:\n"
        "  motor_angle: {channel: motor_angle, unit: counts, per_rev: 1000}\n"
        "  motor_voltage_a: {channel: supply_voltage, unit: V}\n")
    code, _, err = call("steady", str(COAST / "supply.parquet"), "--map", str(tmp_path / "map.yaml"), *METHOD)
    assert code == 1 and "motor_voltage_b" in err and err.count("error:") == 1
