"""Inverse dynamics at the command line: a fit, a validation on another record, and what is refused."""

import numpy as np
import pytest
import yaml

from tests.identify.loop import MACHINES, loop_record, open_record
from tests.simulator.records import write_parquet

UNITS = {"torque": "Nm", "angle": "rad", "speed": "rad/s"}
AXIS = MACHINES[3]


def logged(folder, name, made, leave=()):
    channels = {r: (v, UNITS[r.rpartition("_")[2]]) for r, v in made.signals.items() if r not in leave}
    write_parquet(folder / name, channels, made.step)
    return folder / name


def fitted(call, folder, *words, log="a.parquet"):
    start = f"motor.inertia={1.3 * AXIS.values[0]}"
    return call("greybox", folder / log, "--drive", "one-body", "--set", start, "--criterion", "inverse",
                "--out", folder / "fit.yaml", *words)


@pytest.fixture
def site(tmp_path):
    logged(tmp_path, "a.parquet", loop_record(AXIS, 1, 0.01, seconds=8.0))
    logged(tmp_path, "b.parquet", loop_record(AXIS, 2, 0.01, seconds=8.0))
    return tmp_path


def test_a_fit_is_true_on_another_record(call, site):
    code, _, err = fitted(call, site)
    assert code == 0, err
    content = yaml.safe_load((site / "fit.yaml").read_text())
    for name, true in AXIS.truth.items():
        line = content["parameters"][name]
        assert abs(line["value"] - true) < 4.0 * line["std"] and line["std_noise"] > 0.0
    assert content["details"]["instruments"] == "reference_angle"
    code, _, err = call("validate", site / "b.parquet", "--params", site / "fit.yaml", "--criterion", "inverse",
                        "--out", site / "check.yaml")
    assert code == 0, err
    check = yaml.safe_load((site / "check.yaml").read_text())["checks"][0]
    assert check["output"] == "motor_torque" and check["simulation_fit_percent"] > 90.0
    # What is left is the disturbance, 1 % of the fastest move's torque, and what the loop answers to it.
    assert 0.005 * AXIS.rated < check["rmse"] < 0.03 * AXIS.rated


def test_a_wrong_model_misses_its_limit(call, site):
    fitted(call, site, "--hold", "motor.coulomb", "--set", "motor.coulomb=0.1")
    code, _, err = call("validate", site / "b.parquet", "--params", site / "fit.yaml", "--criterion", "inverse",
                        "--min-fit", "95", "--out", site / "check.yaml")
    assert code == 3 and "limit-missed" in err


def test_least_squares_says_so(call, site):
    made = loop_record(AXIS, 1, 0.01, seconds=8.0)
    logged(site, "c.parquet", made, leave=("reference_angle", "reference_speed"))
    code, _, err = fitted(call, site, log="c.parquet")
    assert code == 0 and "weak-instrument" in err


def test_friction_by_direction_requires_a_reversal(call, site):
    made = open_record(AXIS, 3)
    speed = 1.0 + 0.5 * np.sin(np.arange(made.size) * 0.01)
    one_way = {"motor_torque": 2.0 * np.gradient(speed, made.step) + 6.0 * speed + 6.0, "motor_angle":
               np.cumsum(speed) * made.step}
    logged(site, "d.parquet", type(made)(**{**vars(made), "signals": one_way}))
    _, _, err = fitted(call, site, "--free", "motor.coulomb", log="d.parquet")
    content = yaml.safe_load((site / "fit.yaml").read_text())
    assert content["parameters"]["motor.coulomb"]["status"] == "not-identifiable"
    assert "correlated with that of motor.idle_torque" in err


@pytest.mark.slow
@pytest.mark.parametrize("words, said", [
    (["greybox", "a.parquet", "--drive", "one-body", "--set", "motor.inertia=1", "--criterion", "inverse",
      "--set", "converter.dead_time=0.01"], "converter.dead_time"),
    (["greybox", "a.parquet", "--drive", "one-body", "--set", "motor.inertia=1", "--criterion", "inverse",
      "--start", "rest"], "start state"),
    (["validate", "a.parquet", "--params", "fit.yaml", "--criterion", "inverse", "--segment", "1"], "free runs")])
def test_what_it_cannot_do_is_one_sentence(call, site, words, said):
    fitted(call, site)
    words = [site / w if w in ("a.parquet", "fit.yaml") else w for w in words]
    code, _, err = call(*words)
    assert code == 2 and said in err and err.count("error:") == 1


@pytest.mark.slow
@pytest.mark.parametrize("role, value, code, said", [
    ("motor_angle", 0.0, 1, "in which the motor moves"), ("motor_torque", 0.1, 3, "explains-nothing")])
def test_a_signal_that_never_changes_is_said_in_one_sentence(call, site, role, value, code, said):
    made = loop_record(AXIS, 1, seconds=4.0)
    made.signals[role][:] = value
    logged(site, "e.parquet", made)
    found, _, err = fitted(call, site, log="e.parquet")
    assert found == code and said in err
    fitted(call, site)
    found, _, err = call("validate", site / "e.parquet", "--params", site / "fit.yaml", "--criterion", "inverse",
                         "--out", site / "check.yaml")
    assert found == code and ("motor moves" in err) == (code == 1)


def test_a_short_record_is_refused(call, site):
    logged(site, "f.parquet", loop_record(AXIS, 1, seconds=0.13))
    found, _, err = fitted(call, site, log="f.parquet")
    assert found == 1 and "independent samples" in err


@pytest.mark.slow
def test_a_diagnosis_by_the_torque_names_what_the_base_lacks(call, site):
    fitted(call, site, "--hold", "motor.coulomb", "--set", "motor.coulomb=0")
    code, _, err = call("diagnose", site / "a.parquet", "--holdout", site / "b.parquet", "--criterion", "inverse",
                        "--params", site / "fit.yaml", "--candidates", "coulomb-motor,quadratic-drag",
                        "--plot", site, "--report", site / "page.html", "--out", site / "extended.yaml")
    assert code == 0, err
    content = yaml.safe_load((site / "extended.yaml").read_text())
    section = content["diagnosis"]
    assert (section["verdict"] == "named" and section["causes"] == ["coulomb-motor"]
            and section["gain"]["of"] == "torque")
    assert section["gain"]["held_out_rmse_after"] < 0.5 * section["gain"]["held_out_rmse_before"]
    line = content["parameters"]["motor.coulomb"]
    assert abs(line["value"] - AXIS.truth["motor.coulomb"]) < 4.0 * line["std"]
    assert "orque that the motion requires" in (site / "page.html").read_text()
    assert list(site.glob("*diagnosis-record.png")) and list(site.glob("*diagnosis-candidates.png"))


@pytest.mark.slow
def test_what_a_judging_record_has_of_its_own_is_fitted_to_it_and_to_no_other(call, site):
    fitted(call, site, "--hold", "motor.coulomb", "--set", "motor.coulomb=0")
    words = ("diagnose", site / "a.parquet", "--holdout", site / "b.parquet", "--params", site / "fit.yaml",
             "--candidates", "coulomb-motor", "--out", site / "extended.yaml", "--record")
    code, _, err = call(*words, site / "b.parquet", "free=friction.factor", "--criterion", "inverse")
    assert code == 0 and "held-out-own-values" in err
    evidence = next(f for f in yaml.safe_load((site / "extended.yaml").read_text())["findings"]
                    if f["code"] == "held-out-own-values")["evidence"]
    assert abs(evidence["friction.factor@b.parquet"] - 1.0) < 0.05  # the machine is the same
    code, _, err = call(*words, site / "a.parquet", "free=friction.factor", "--criterion", "inverse")
    assert code == 2 and "--holdout" in err
    code, _, err = call(*words, site / "b.parquet", "free=friction.factor")
    assert code == 2 and "free=" in err


@pytest.mark.slow
def test_a_simulation_of_a_base_that_was_fitted_to_the_torque_is_warned_of(call, site):
    fitted(call, site)
    words = ("diagnose", site / "a.parquet", "--params", site / "fit.yaml", "--candidates", "quadratic-drag",
             "--out", site / "extended.yaml")
    for more, warned in (((), True), (("--criterion", "inverse"), False)):
        _, _, err = call(*words, *more)
        assert ("biased-base" in err) == warned
