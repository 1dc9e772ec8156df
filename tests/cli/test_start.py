"""--start at the command line: its words, its note in the files, and a run from rest in closed form."""

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from tests.simulator.records import write_parquet

STEP = 1e-3
N = 600
INERTIA, VISCOUS = 0.5, 0.8
T = np.arange(N) * STEP
TORQUE = 4.0


def model(folder, **values):
    values = {"motor.inertia": INERTIA, "motor.viscous": VISCOUS} | values
    path = folder / "model.yaml"
    path.write_text(yaml.safe_dump({"schema": "drivetool/parameters/1", "drive": {"name": "one-body"},
                                    "parameters": values}))
    return path


def speed_from(first):
    """(n,) closed form under a constant torque."""
    end = TORQUE / VISCOUS
    return end + (first - end) * np.exp(-VISCOUS / INERTIA * T)


def record(folder, measured, role="motor_speed", unit="rad/s", name="r.parquet"):
    write_parquet(folder / name, {"motor_torque": (np.full(N, TORQUE), "Nm"), role: (measured, unit)}, STEP)
    return folder / name


@pytest.mark.parametrize("words, first", [
    (["rest"], 0.0), (["motor.speed=30 rpm"], np.pi), (["rest", "motor.speed=-2"], -2.0)])
def test_a_run_from_a_stated_speed_is_the_closed_form(tmp_path, call, words, first):
    log, out = record(tmp_path, speed_from(1.0) + 0.5), tmp_path / "s.parquet"  # whatever was measured
    code, _, err = call("simulate", log, "-p", model(tmp_path), "--out", out,
                        *(word for state in words for word in ("--start", state)))
    assert code == 0, err
    table = pq.read_table(out)
    np.testing.assert_allclose(table["motor_speed"].to_numpy(), speed_from(first), rtol=1e-9, atol=1e-9)
    assert table.schema.metadata[b"start"].decode() == "; ".join(words)


def test_at_rest_the_angle_is_that_of_the_first_sample(tmp_path, call):
    angle = 7.0 + 0.01 * np.cos(40.0 * T)
    log, out = record(tmp_path, angle, "motor_angle", "rad"), tmp_path / "s.parquet"
    assert call("simulate", log, "-p", model(tmp_path), "--out", out, "--start", "rest")[0] == 0
    found = pq.read_table(out)["motor_angle"].to_numpy()
    rate = VISCOUS / INERTIA
    turned = TORQUE / VISCOUS * (T - (1.0 - np.exp(-rate * T)) / rate)
    np.testing.assert_allclose(found, 7.01 + turned, rtol=1e-9)


def test_an_unmeasured_angle_begins_where_it_is_stated(tmp_path, call):
    log, out = record(tmp_path, speed_from(0.0)), tmp_path / "s.parquet"
    assert call("simulate", log, "-p", model(tmp_path), "--out", out, "--start", "motor.angle=90 deg")[0] == 0
    assert pq.read_table(out)["motor_angle"][0].as_py() == pytest.approx(np.pi / 2.0)


@pytest.mark.parametrize("step", ["greybox", "backlash", "validate", "simulate"])
@pytest.mark.parametrize("words, message", [
    (["motor.sped=1"], "Did you mean 'motor.speed'"), (["rest", "rest"], "'rest' twice"),
    (["motor.speed=1", "motor.speed = 2"], "'motor.speed' twice"), (["motor.speed=inf"], "finite start value"),
    (["motor.speed=nan"], "finite number"), (["motor.speed"], "NAME=VALUE after --start"),
    (["motor.speed=1 kg"], "kg"), (["rest=1"], "'rest=1'")])
def test_a_start_that_cannot_be_is_wrong_usage(tmp_path, call, step, words, message):
    out = tmp_path / ("s.parquet" if step == "simulate" else "s.yaml")
    code, _, err = call(step, record(tmp_path, speed_from(0.0)), "-p", model(tmp_path), "--out", out,
                        *(word for state in words for word in ("--start", state)))
    assert code == 2 and message in " ".join(err.split()) and not out.exists()


def test_a_fit_says_what_it_took_as_known(tmp_path, call):
    rng = np.random.default_rng(3)
    log = record(tmp_path, speed_from(0.0) + rng.normal(0.0, 0.01, N))
    words = ["greybox", log, "-p", model(tmp_path), "--hold", "motor.idle_torque", "--out"]
    assert call(*words, tmp_path / "a.yaml", "--start", "rest")[0] == 0
    assert call(*words, tmp_path / "b.yaml")[0] == 0
    known, free = (yaml.safe_load((tmp_path / n).read_text()) for n in ("a.yaml", "b.yaml"))
    assert known["options"]["start"] == {"rest": True, "states": {}} and "start" not in free["options"]
    assert known["details"]["known_start"] == {"motor.speed": 0.0}
    stds = [[file["parameters"][f"motor.{n}"]["std"] for n in ("inertia", "viscous")] for file in (known, free)]
    assert np.all(np.array(stds[0]) <= np.array(stds[1]))


def test_validate_names_both_starts_and_sees_through_a_wrong_one(tmp_path, call):
    rng = np.random.default_rng(4)
    log = record(tmp_path, speed_from(2.0) + rng.normal(0.0, 0.005, N))
    out = tmp_path / "v.yaml"
    words = ["validate", log, "-p", model(tmp_path), "--out", out]
    call(*words)
    check, = yaml.safe_load(out.read_text())["checks"]
    assert check["rmse"] == pytest.approx(0.005, rel=0.1)
    # One sample in twenty determines the start: a line through them has 0.43 of the noise at its end.
    assert check["rmse"] < check["measured_start_rmse"] < 2.0 * check["rmse"]
    assert check["measured_start_fit_percent"] < check["simulation_fit_percent"]
    summary = call("show", out)[1]
    assert "start state fitted" in summary and "start state measured" in summary
    call(*words, "--segment", 0.1)  # pieces begin in any motion, which first samples of one sensor do not show
    check, = yaml.safe_load(out.read_text())["checks"]
    assert check["measured_start_rmse"] is None and "start state measured" not in call("show", out)[1]
    call(*words, "--start", "rest")
    file = yaml.safe_load(out.read_text())
    assert "held-value-rejected" in {f["code"] for f in file["findings"]}
    rms = np.sqrt(np.mean((speed_from(2.0) - speed_from(0.0)) ** 2))
    assert file["checks"][0]["rmse"] == pytest.approx(rms, rel=0.01)
    assert file["checks"][0]["measured_start_rmse"] == file["checks"][0]["rmse"]


def test_gains_are_replayed_from_where_the_record_begins(tmp_path, call):
    gains = tmp_path / "gains.yaml"
    gains.write_text("schema: drivetool/gains/1\n")
    code, _, err = call("validate", record(tmp_path, speed_from(0.0)), "-p", model(tmp_path), "--gains", gains,
                        "--start", "rest")
    assert code == 2 and "--start or --gains" in err
