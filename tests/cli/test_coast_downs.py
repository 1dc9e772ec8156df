"""Coast-downs at the process boundary: `validate` without a torque, by files of ratios and of values."""

import json

import numpy as np
import pytest
import yaml

from tests.coasting import RPM, STEP, Motor, coast_down, driven_then_off
from tests.simulator.records import write_mcap, write_parquet

TOP_SPEED = 2240 * RPM
STEADY = ("--method", "coast-down", "--drive", "one-body")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Counts at supplies of 40, 45, 50 and 55 Hz as Parquet, some as MCAP; one under torque first."""
    path = tmp_path_factory.mktemp("coast")
    for hertz in (40, 45, 50, 55):
        angle = {"motor_angle": (coast_down(hertz, fast=TOP_SPEED * hertz / 40).signals["motor_angle"], "rad")}
        write_parquet(path / f"run{hertz}.parquet", angle, STEP)
        if hertz in (40, 50):
            write_mcap(path / f"run{hertz}.mcap", angle, STEP)
    units = {"motor_torque": "Nm", "motor_angle": "rad"}
    write_parquet(path / "driven.parquet", {n: (v, units[n]) for n, v in driven_then_off(1).signals.items()}, STEP)
    return path


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


def written(call, *words, fails=0):
    code, out, err = call(*words, "--out", "-")
    assert code == fails, err
    return yaml.safe_load(out)


@pytest.fixture
def coast(here, call):
    if not (here / "coast.yaml").exists():
        assert call("steady", "run40.parquet", *STEADY, "--out", "coast.yaml")[0] == 0
    return "coast.yaml"


def test_other_coast_downs_of_a_model_of_ratios(coast, call):
    content = written(call, "validate", "run45.parquet", "run50.parquet", "run55.parquet", "--params", coast)
    assert content["passed"] and content["options"]["criterion"] == "coast-down"
    angles = [c for c in content["checks"] if c["output"] == "motor_angle"]
    speeds = [c for c in content["checks"] if c["output"] == "motor_speed"]
    assert len(angles) == len(speeds) == 3
    assert all(c["rmse_counts"] <= 1.05 and "nrmse_mean" not in c for c in angles)
    assert all(c["nrmse"] < c["nrmse_mean"] < 1e-3 and "rmse_counts" not in c for c in speeds)
    assert [f["code"] for f in content["findings"]] == ["ratios-only", "coast-down-assumed"]


def test_mcap_and_parquet_say_the_same(here, coast, call):
    first, second = (written(call, "validate", f"run50.{kind}", "--params", coast)["checks"]
                     for kind in ("parquet", "mcap"))
    for a, b in zip(first, second, strict=True):
        assert {**a, "file": ""} == {**b, "file": ""}
    again = written(call, "steady", "run40.mcap", *STEADY)
    assert again["derived"] == yaml.safe_load((here / coast).read_text())["derived"]


def test_the_table_names_both_kinds_of_nrmse_and_rpm(coast, call, here):
    assert call("validate", "run50.parquet", "--params", coast, "--out", "v.yaml", "--plot", "pictures")[0] == 0
    out = call("show", "v.yaml")[1]
    for word in ("coast-downs: motor_angle", "count /sqrt(12)", "rpm", "NRMSE", "range %", "mean", "R2"):
        assert word in out
    assert (here / "pictures" / "validate-run50-record.png").exists()
    checks = json.loads(call("validate", "run50.parquet", "--params", coast, "--json", "-q")[1])["checks"]
    assert checks == yaml.safe_load((here / "v.yaml").read_text())["checks"]


def test_a_model_with_its_scale_on_coast_downs_and_ratios_on_a_record_under_torque(here, coast, call):
    assert call("steady", "driven.parquet", *STEADY, "--flux-decay", "0.02", "--out", "scaled.yaml")[0] == 0
    content = written(call, "validate", "run50.parquet", "--params", "scaled.yaml")
    assert content["options"]["flux_decay"] == 0.02  # as the fit left it out
    assert content["checks"][0]["rmse_counts"] <= 1.05
    assert "ratios-only" not in [f["code"] for f in content["findings"]]
    assert written(call, "validate", "run50.parquet", "--params", "scaled.yaml", "--flux-decay", "0.1")[
        "checks"][0]["n"] < content["checks"][0]["n"] - 1000
    by_ratios = written(call, "validate", "driven.parquet", "--params", coast)
    by_values = written(call, "validate", "driven.parquet", "--params", "scaled.yaml", "--criterion", "coast-down")
    for found in (by_ratios, by_values):
        assert found["options"]["criterion"] == "coast-down" and found["checks"][0]["rmse_counts"] <= 1.05


def test_the_record_of_the_fit_is_no_validation(coast, call):
    content = written(call, "validate", "run40.parquet", "--params", coast)
    assert "not-held-out" in [f["code"] for f in content["findings"]]
    assert content["verdict"].endswith("this is not a validation.")


def test_start_values_beside_ratios_are_no_model(here, call):
    """The file states its start values; it identifies the ratios."""
    assert call("steady", "run40.parquet", *STEADY, "--set", "motor.inertia=1e-3", "--set", "motor.viscous=5e-3",
                "--set", "motor.coulomb=0.9", "--out", "started.yaml")[0] == 0
    angle, _ = written(call, "validate", "run45.parquet", "--params", "started.yaml")["checks"]
    assert angle["rmse_counts"] <= 1.05


def test_a_slide_by_a_ruler(here, call):
    """Motion in m, no torque with the unit N."""
    step, mass = 1e-3, Motor(inertia=1.0, viscous=1.0, coulomb=0.5)
    t = step * np.arange(3000)
    for name, speed in (("a", 3.0), ("b", 4.0)):
        x = (speed + 0.5) / mass.viscous * (1.0 - np.exp(-t)) - 0.5 * t
        t_stop = np.log((speed + 0.5) / 0.5)
        kept = np.floor(x[t < t_stop - 0.05] / 1e-5) * 1e-5
        write_parquet(here / f"{name}.parquet", {"motor_angle": (kept, "m")}, step)
    assert call("steady", "a.parquet", *STEADY, "--out", "slide.yaml")[0] == 0
    content = written(call, "validate", "b.parquet", "--params", "slide.yaml")
    assert content["checks"][0]["rmse_counts"] <= 1.05 and "rpm" not in content["verdict"]


@pytest.mark.parametrize("words, says", [
    (("--segment", "0.1"), "no --segment"), (("--start", "rest"), "no --start"),
    (("--criterion", "inverse", "--flux-decay", "0.1"), "--criterion coast-down")])
def test_what_a_coast_down_does_not_take_is_refused(coast, call, words, says):
    code, _, err = call("validate", "run50.parquet", "--params", coast, *words)
    assert code == 2 and says in err and "Traceback" not in err


def test_a_ratio_in_a_strange_unit_is_refused(here, coast, call):
    content = yaml.safe_load((here / coast).read_text())
    content["derived"]["viscous_over_inertia"]["unit"] = "Nm"
    (here / "strange.yaml").write_text(yaml.safe_dump(content))
    code, _, err = call("validate", "run50.parquet", "--params", "strange.yaml")
    assert code in (1, 2) and "viscous_over_inertia" in err and "strange.yaml" in err


def test_stages_state_their_bias_and_validation_shows_it(here, call):
    content = written(call, "steady", "run40.parquet", *STEADY, "--stages", "1600:750,750:300")
    (finding,) = (f for f in content["findings"] if f["code"] == "staged-fit")
    assert finding["severity"] == "warning" and content["options"]["stages"] == "1600:750,750:300"
    assert content["derived"]["viscous_over_inertia"]["std"] is None
    assert content == written(call, "steady", "run40.mcap", *STEADY, "--stages", "1600:750,750:300 rpm") | {
        key: content[key] for key in ("data", "details", "options")}
    (here / "staged.yaml").write_text(yaml.safe_dump(content))
    judged = written(call, "validate", "run50.parquet", "--params", "staged.yaml")
    assert judged["checks"][0]["rmse_counts"] > 100.0
    code, _, err = call("steady", "run40.parquet", *STEADY, "--stages", "750:1600")
    assert code == 2 and "two or three windows" in err


def test_a_torque_that_may_be_forgotten_is_required(here, call):
    (here / "hand.yaml").write_text(yaml.safe_dump({
        "schema": "drivetool/parameters/1", "drive": {"bodies": ["motor"], "shafts": []},
        "parameters": {"motor.inertia": 8.7499e-5, "motor.viscous": 1.0791e-4, "motor.coulomb": 0.012998}}))
    code, _, err = call("validate", "run50.parquet", "--params", "hand.yaml")
    assert code == 1 and "motor_torque" in err and "--criterion coast-down" in err
    angle, _ = written(call, "validate", "run50.parquet", "--params", "hand.yaml", "--criterion", "coast-down")[
        "checks"]
    assert angle["rmse_counts"] <= 1.05 and "parameters_rmse" not in angle


def test_what_a_record_adds_to_an_inertia_that_is_not_known_is_refused(coast, call):
    code, _, err = call("validate", "run50.parquet", "--params", coast, "--record", "run50.parquet",
                        "motor.added_inertia=5e-5")
    assert code == 1 and "a known inertia in addition to motor.added_inertia" in err


def test_ratios_have_their_covariance_in_the_file(here, coast, call):
    content = yaml.safe_load((here / coast).read_text())
    known = content["details"]["ratio_covariance"]
    for i, name in enumerate(known["names"]):
        assert np.sqrt(known["matrix"][i][i]) == pytest.approx(content["derived"][name]["std"])
    angle = written(call, "validate", "run55.parquet", "--params", coast)["checks"][0]
    assert 0.0 < angle["parameters_rmse"] < 0.5 * angle["sensor_rmse"]
    del content["details"]["ratio_covariance"]["matrix"]
    (here / "bare.yaml").write_text(yaml.safe_dump(content))
    bare = written(call, "validate", "run55.parquet", "--params", "bare.yaml")["checks"][0]
    assert "parameters_rmse" not in bare


@pytest.mark.parametrize("change", [
    {"ratio_covariance": 3}, {"ratio_covariance": {"names": [[1], "x"], "matrix": 1}},
    {"ratio_covariance": {"names": ["viscous_over_inertia"], "matrix": [["a"]]}},
    {"ratio_covariance": {"names": ["viscous_over_inertia"], "matrix": [[-1.0]]}},
    {"sensor": "none"}, {"sensor": [{"error_beyond_counts": "much"}, 3]}])
def test_details_that_a_hand_has_spoilt_stop_nothing(here, coast, call, change):
    content = yaml.safe_load((here / coast).read_text())
    content["details"] |= change
    content["options"]["flux_decay"] = -1.0
    (here / "spoilt.yaml").write_text(yaml.safe_dump(content))
    found = written(call, "validate", "run50.parquet", "--params", "spoilt.yaml")
    assert found["checks"][0]["rmse_counts"] <= 1.05 and found["options"]["flux_decay"] == 0.0


def test_the_same_bytes_twice_and_a_ratio_out_of_bounds(here, coast, call):
    words = ("validate", "run50.parquet", "--params", coast, "--out", "-")
    assert call(*words)[1] == call(*words)[1]
    content = yaml.safe_load((here / coast).read_text())
    content["derived"]["viscous_over_inertia"]["value"] = -1.0
    (here / "below.yaml").write_text(yaml.safe_dump(content))
    code, _, err = call("validate", "run50.parquet", "--params", "below.yaml")
    assert code == 1 and "below.yaml" in err and "motor.viscous" in err
