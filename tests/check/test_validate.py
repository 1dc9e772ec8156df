"""validate: true models pass, wrong ones are caught, and chance raises the alarm as often as it says."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from drivetool.check.validation.free_run_validation import validate
from drivetool.check.validation.remarks import ranking_findings
from drivetool.check.validation.result import ValidateOptions
from drivetool.cli import command_line
from drivetool.drive import one_body, two_mass
from drivetool.drive.chain import vehicle
from drivetool.errors import BadOption, BadParameters, NotEnoughData
from drivetool.logs import Experiment
from drivetool.logs.door import open_experiment
from tests.places import FIXTURES
from tests.simulator.experiments import multisine
from tests.simulator.machine import machine_by_seed, running
from tests.simulator.simulate import simulate_linear

NOISE = {"sensor_std.motor_speed": 0.02, "torque_std": 0.3}
STEP = 1e-3


BODIES = {"axis": one_body("N", "m"), "bus": vehicle()}


def truth(room, **factors):
    """The true drive of a fixture, some values multiplied; '__' stands for the dot."""
    text = yaml.safe_load((FIXTURES / room / "truth.yaml").read_text())["parameters"]
    values = {name: entry["value"] for name, entry in text.items()}
    for name, factor in factors.items():
        values[name.replace("__", ".")] *= factor
    return BODIES.get(room, two_mass()).with_values(values)


def record(room, name):
    return open_experiment(FIXTURES / room / f"{name}.parquet")


def validated(room, name, noise=NOISE, options=None, **factors):
    """Validation of one model on one fixture record."""
    return validate([record(room, name)], [("m.yaml", truth(room, **factors), noise)],
                    options or ValidateOptions())


def codes(validation):
    return {finding.code for finding in validation.findings}


def linear(seed, n=2000, step=STEP):
    """(machine, drive, torque, run, noise of its file) of a linear machine under a coloured torque."""
    machine, rng = machine_by_seed(seed), np.random.default_rng(seed)
    start, rated = running(machine, 30.0), machine.rated_torque
    slow = np.cumsum(rng.normal(0.0, 1.0, n))
    torque = start.torque + 0.2 * rated * (slow - slow.mean()) / slow.std() + multisine(
        np.arange(2.0, 30.0, 4.0), 0.03 * rated, n * step, step, seed)
    run = simulate_linear(machine, torque, step, start, rng.normal(0.0, 0.02 * rated, n))
    values = {"shaft.stiffness": machine.stiffness[0], "shaft.damping": machine.damping[0]}
    for i, body in enumerate(("motor", "load")):
        values |= {f"{body}.{name}": getattr(machine, name)[i]
                   for name in ("inertia", "viscous", "idle_torque")}
    noise = {"sensor_std.motor_speed": 0.02, "torque_std": 0.02 * rated}
    return machine, two_mass().with_values(values), torque, run, noise


def experiment(torque, segments=None, name="r.parquet", **signals):
    signals = {"motor_torque": torque, **signals}
    return Experiment(name, name, STEP, 0.0, signals, segments or ((0, len(torque)),))


def noisy(values, seed, std=0.02):
    return values + np.random.default_rng([seed, 7]).normal(0.0, std, len(values))


# room, record, options, noise of the file, least fit
TRUE = {
    "steps": ("rig", "steps_holdout", ValidateOptions(99.8), NOISE),
    "steps without noise": ("rig", "steps_holdout", ValidateOptions(99.8), {}),
    "gap": ("rig", "gap_holdout", ValidateOptions(99.0, segment=1.0), NOISE),
    "reversing": ("reversing", "moves_holdout", ValidateOptions(98.0), NOISE),
    "axis": ("axis", "moves_holdout", ValidateOptions(99.9), {}),
}


@pytest.mark.parametrize("room, name, options, noise", TRUE.values(), ids=TRUE)
def test_true_model_passes(room, name, options, noise):
    found = validated(room, name, noise, options)
    check, = found.checks
    assert check.passed and check.max_correlation < 0.1 and check.correlation_p > 0.05
    assert check.one_step_fit_percent >= check.simulation_fit_percent - 0.1
    assert not [f for f in found.findings if f.severity != "note"]
    assert found.verdict.startswith("Passed") and "the residual does not depend" in found.verdict
    plots = {e.kind: e.curves for e in found.exhibits}
    y, s = plots["record"]["measured"][1], plots["record"]["simulated"][1]
    e = y - s
    assert check.n == len(y)
    assert check.rmse == pytest.approx(np.sqrt(np.mean(e**2)))
    assert check.nrmse == pytest.approx(check.rmse / (y.max() - y.min()))
    assert check.r2 == pytest.approx(1 - np.sum(e**2) / np.sum((y - y.mean()) ** 2))
    assert check.simulation_fit_percent == pytest.approx(
        100 * (1 - np.sqrt(np.sum(e**2)) / np.sqrt(np.sum((y - np.mean(y)) ** 2))))
    lags, r = plots["correlation"]["residual with torque"]
    assert np.abs(r[lags > 0]).max() == pytest.approx(check.max_correlation)
    assert plots["correlation"]["band 97 % for one lag"][1].max() == pytest.approx(check.band)


# room, record, what is wrong, findings that must be there
WRONG = {
    "stiffness": ("rig", "steps_holdout", {"shaft__stiffness": 1.2}, {"residual-depends-on-input"}),
    "stiffness, gap": ("rig", "gap_holdout", {"shaft__stiffness": 1.2}, {"limit-missed"}),
    "stiffness, reversing": ("reversing", "moves_holdout", {"shaft__stiffness": 1.2},
                             {"residual-depends-on-input"}),
    "gap": ("rig", "gap_holdout", {"shaft__half_gap": 0.0}, {"limit-missed"}),
    "gap, reversing": ("reversing", "moves_holdout", {"shaft__half_gap": 0.0}, {"residual-depends-on-input"}),
    "inertia": ("rig", "steps_holdout", {"motor__inertia": 1.05}, {"limit-missed"}),
    "inertia, gap": ("rig", "gap_holdout", {"motor__inertia": 1.05}, {"limit-missed"}),
    "inertia, reversing": ("reversing", "moves_holdout", {"motor__inertia": 1.05},
                           {"limit-missed"}),
    "Coulomb": ("reversing", "moves_holdout", {"motor__coulomb": 0.0}, {"limit-missed"}),
    "idle torque": ("rig", "steps_holdout", {"load__idle_torque": 1.01}, {"simulation-drifts"}),
}


@pytest.mark.parametrize("room, name, factors, wanted", WRONG.values(), ids=WRONG)
def test_wrong_model_is_caught(room, name, factors, wanted):
    found = validated(room, name, **factors)
    assert codes(found) >= wanted | {"residual-depends-on-input"}
    assert found.checks[0].correlation_p < 0.01 and found.unexplained
    assert found.checks[0].passed == ("limit-missed" not in codes(found))
    assert found.checks[0].passed or found.verdict.startswith("Not passed")
    if "load__idle_torque" not in factors:  # which torque noise estimated here takes for its own
        assert validated(room, name, {}, **factors).checks[0].correlation_p < 0.01


def test_drift_names_the_torque_that_is_missing():
    found = validated("rig", "steps_holdout", load__idle_torque=1.05)
    drift, = (f for f in found.findings if f.code == "simulation-drifts")
    assert drift.evidence["torque"] == pytest.approx(-0.05 * 15.14, rel=0.15)
    assert "too high" in drift.text and "0.7" in drift.text
    lower = validated("rig", "steps_holdout", load__idle_torque=0.95)
    assert any("too low" in f.text for f in lower.findings)


def test_drift_of_a_body_that_carries_a_mass():
    """500 of the 1089 Nm on the wheels of the bus are missing; behind a gear of 8.79 the motor gives less."""
    found = validated("bus", "prbs1", {}, wheels__idle_torque=589.0 / 1089.0)
    drift, = (f for f in found.findings if f.code == "simulation-drifts")
    assert drift.evidence["torque"] == pytest.approx(500.0 / 8.79, rel=0.02)


@pytest.mark.parametrize("min_fit", [None, -200.0, -100.0])
def test_a_model_that_explains_less_than_a_constant_fails_unless_requested(min_fit):
    """A wrong idle torque of the bus, which the test of the residual takes for torque noise."""
    found = validated("bus", "prbs1", {}, ValidateOptions(min_fit), wheels__idle_torque=589.0 / 1089.0)
    check, = found.checks
    assert check.simulation_fit_percent == pytest.approx(-172.6, abs=0.1)
    assert check.passed == (min_fit == -200.0) == found.verdict.startswith("Passed")
    failures = [f for f in found.findings if f.severity == "failure"]
    assert [f.code for f in failures] == {None: ["explains-nothing"], -200.0: [], -100.0: ["limit-missed"]}[
        min_fit]
    if min_fit is None:
        assert "the motor speed in prbs1" in failures[0].text and "-172.6 %" in failures[0].text
        assert found.verdict.startswith("Not passed: the simulation explains nothing (fit -172.6 %)")


def test_noise_across_a_gap_limits_the_free_run():
    found = validated("rig", "gap_holdout", options=ValidateOptions(90.0, segment=1000.0))
    assert codes(found) == {"limit-missed", "free-run-noise-limited"}
    assert not found.checks[0].passed and "limited by the torque noise" in found.verdict
    note, = (f for f in found.findings if f.code == "free-run-noise-limited")
    low, fit, middle = (note.evidence[k] for k in (
        "attainable_fit_low", "simulation_fit_percent", "attainable_fit_median"))
    assert low < fit < 60.0 and low < middle < 60.0


@pytest.mark.parametrize("noise", [NOISE, {}])
def test_across_a_gap_free_runs_are_as_long_as_a_true_model_follows(noise):
    """Over the whole record the true model has a fit below 60 %, and a wrong one is caught as before."""
    found = validated("rig", "gap_holdout", noise)
    check, = found.checks
    assert check.simulation_fit_percent > 95.0 and check.passed and check.free_run_length in (0.2, 1.0)
    assert f"in free runs of {check.free_run_length:g} s, as long as noise across the gap allows" in found.verdict
    assert found.verdict.startswith("Passed") and not codes(found)
    assert not validated("rig", "gap_holdout", noise, shaft__stiffness=1.2).checks[0].passed


@pytest.mark.parametrize("noise_factor, explained", [(0.0, False), (0.01, False), (1.0, True)])
def test_a_low_fit_passes_only_if_noise_explains_it(noise_factor, explained):
    """One body in a random walk by torque noise ten times the command; the file states a part of that noise."""
    rng, n = np.random.default_rng(4), 4000
    torque = np.sin(0.05 * np.arange(n))
    speed = np.cumsum(torque + 10.0 * rng.standard_normal(n)) * STEP
    noise = {"sensor_std.motor_speed": 1e-3, "torque_std": 10.0 * noise_factor} if noise_factor else {}
    e = experiment(torque, motor_speed=speed + 1e-3 * rng.standard_normal(n))
    drive = one_body().with_values({"motor.inertia": 1.0})
    found = validate([e], [("m", drive, noise)], ValidateOptions())
    check, = found.checks
    assert 0.0 < check.simulation_fit_percent < 50.0
    assert check.passed == explained == ("free-run-not-explained" not in codes(found))
    assert found.verdict.startswith("Passed" if explained else "Not passed")


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_stated():
    from scipy.stats import binom

    p, above = [], 0
    for seed in range(120):
        _, drive, torque, run, noise = linear(seed, 1600)
        e = experiment(torque, motor_speed=noisy(run.speeds[:, 0], seed))
        check, = validate([e], [("m", drive, noise if seed % 2 else {})], ValidateOptions()).checks
        p.append(check.correlation_p)
        above += check.max_correlation > 0.15
    for level in (0.01, 0.05, 0.2):
        assert np.sum(np.array(p) <= level) <= binom.isf(1e-3, len(p), level)
    assert np.sum(np.array(p) <= 0.5) >= binom.ppf(1e-3, len(p), 0.2)  # not blind either
    assert above == 0


def test_other_sensors_are_checked_and_leave_the_motor_alone():
    machine, drive, torque, run, noise = linear(11, 4000)
    motor, load = noisy(run.speeds[:, 0], 1), noisy(run.speeds[:, 1], 2)
    angle = noisy(run.angles[:, 1] + 7.0, 3, 1e-4)
    shaft = noisy(run.shaft_torques[:, 0], 4, 1e-3 * machine.rated_torque)
    alone = validate([experiment(torque, motor_speed=motor)], [("m", drive, noise)], ValidateOptions())
    options = ValidateOptions(min_fit=90.0)

    def both(**more):
        return validate([experiment(torque, motor_speed=motor, **more)], [("m", drive, noise)], options)

    found = both(load_speed=load, shaft_torque=shaft)
    assert [c.output for c in found.checks] == ["motor_speed", "load_speed", "shaft_torque"]
    assert [c.unit for c in found.checks] == ["rad/s", "rad/s", "Nm"]
    assert all(c.passed and c.correlation_p > 0.01 for c in found.checks)
    assert [e.kind for e in found.exhibits] == ["record", "correlation"] * 3
    wrong = both(load_speed=1.1 * load)
    assert not wrong.checks[1].passed and wrong.checks[1].simulation_fit_percent < 50.0
    for other in (found, wrong):
        assert other.checks[0].replace(passed=True) == alone.checks[0]
    turned = both(load_angle=angle).checks[1]
    assert turned.output == "load_angle" and turned.unit == "rad"
    assert turned.passed and turned.correlation_p > 0.01 and turned.rmse < 0.05


def test_angle_only_slow_sensor_and_interrupted_record():
    _, drive, torque, run, _ = linear(5, 4000)
    angle = noisy(run.angles[:, 0], 1, 1e-4)
    e = experiment(torque, motor_angle=angle)
    whole, = validate([e], [("m", drive, {})], ValidateOptions(99.0)).checks
    assert whole.passed and whole.output == "motor_angle" and whole.correlation_p > 0.01
    slow = np.where(np.arange(4000) % 5 == 0, noisy(run.speeds[:, 0], 2), np.nan)
    slow[1000:1020] = np.nan
    cut = ((0, 1800), (2100, 4000))
    found = validate([experiment(torque, cut, motor_speed=slow)], [("m", drive, {})], ValidateOptions(90.0))
    check, = found.checks
    assert check.passed and check.n == 3700 // 5 - 4 and check.correlation_p > 0.01
    time = found.exhibits[0].curves["simulated"][0]
    assert len(time) == 3700 and time[1800] == pytest.approx(2.1)
    pieces = validate([experiment(torque, cut, motor_speed=slow)], [("m", drive, {})],
                      ValidateOptions(segment=0.3)).checks[0]
    assert pieces.simulation_fit_percent > check.simulation_fit_percent


def test_records_the_fit_has_seen_and_ranges_it_has_not():
    _, drive, torque, run, noise = linear(7)
    motor = noisy(run.speeds[:, 0], 1)
    first = experiment(torque, name="first", motor_speed=motor)
    other = experiment(torque, name="other", motor_speed=motor + 0.0)
    models = [("a.yaml", drive, noise), ("a.yaml", drive, {})]
    found = validate([first, other], models, ValidateOptions(), [["first"], ["first", "other"]])
    used = [f for f in found.findings if f.code == "not-held-out"]
    assert [f.text.split()[0] for f in used] == ["first", "first", "other"]
    assert [c.model for c in found.checks] == ["a.yaml (1)"] * 2 + ["a.yaml (2)"] * 2
    assert [c.file for c in found.checks] == ["first", "other"] * 2 and "not a validation" not in found.verdict
    seen = validate([first], models[:1], ValidateOptions(), [["first"]])
    assert "this is not a validation" in seen.verdict
    half = experiment(torque[:800], name="half", motor_speed=motor[:800])
    beyond = validate([half, first], models[:1], ValidateOptions(), [["half"]])
    assert "extrapolation" in codes(beyond) and "extrapolation" not in codes(found)


def test_a_torque_that_never_changes_cannot_be_tested():
    machine, drive, torque, _, noise = linear(9)
    torque = np.full_like(torque, torque[0])
    run = simulate_linear(machine, torque, STEP, running(machine, 10.0))
    still = experiment(torque, motor_speed=noisy(run.speeds[:, 0], 1))
    found = validate([still], [("m", drive, noise)], ValidateOptions())
    assert "residual-not-testable" in codes(found) and found.checks[0].passed
    assert np.isnan(found.checks[0].correlation_p) and "the residual does not" not in found.verdict


def test_a_signal_that_never_changes_has_no_fit_and_the_verdict_says_so():
    _, drive, torque, run, noise = linear(5)
    quiet = experiment(torque, motor_speed=run.speeds[:, 0], load_speed=np.full(len(torque), 0.1))
    found = validate([quiet], [("m.yaml", drive, noise)], ValidateOptions(50.0))
    constant = next(check for check in found.checks if check.output == "load_speed")
    assert np.isnan(constant.simulation_fit_percent) and np.isnan(constant.r2) and not constant.passed
    assert constant.rmse > 0.0
    texts = [found.verdict, *(f.text for f in found.findings), *(e.title for e in found.exhibits)]
    assert sum("undefined (the signal is constant)" in text for text in texts) == 3
    assert not [text for text in texts if "nan" in text.split()]


@pytest.mark.parametrize("errors, turned", [
    (((1.0, 4.0), (2.0, 3.0)), True), (((1.0, 3.0), (2.0, 4.0)), False),
    (((1.0, 3.1), (2.0, 3.0)), False), (((1.0, 4.0), (1.04, 3.0)), False), (((1.0, 4.0),), False)])
def test_a_ranking_that_depends_on_the_start_state_is_reported(errors, turned):
    check = validated("rig", "steps_holdout").checks[0]
    checks = [check.replace(model=f"{i}.yaml", rmse=fitted, measured_start_rmse=measured)
              for i, (fitted, measured) in enumerate(errors)]
    found = ranking_findings([*checks, check.replace(file="other.parquet")])
    assert [f.code for f in found] == ["ranking-depends-on-start"] * turned
    assert not turned or "0.yaml has the smallest error with a fitted start state and 1.yaml" in found[0].text


def test_what_cannot_be_validated():
    _, drive, torque, run, _ = linear(9)
    e = experiment(torque, motor_speed=run.speeds[:, 0])
    with pytest.raises(BadParameters, match=r"values of load.inertia, shaft.stiffness for a simulation"):
        validate([e], [("m", two_mass().with_values({"motor.inertia": 1.0}), {})], ValidateOptions())
    with pytest.raises(BadOption, match="20 samples"):
        validate([e], [("m", drive, {})], ValidateOptions(segment=0.01))
    with pytest.raises(NotEnoughData):
        validate([], [("m", drive, {})], ValidateOptions())


def test_exit_codes_and_files_at_the_command_line(here, capfd):
    log = str(FIXTURES / "rig" / "steps_holdout.parquet")
    sha = record("rig", "steps_holdout").sha256
    values = {k: float(v) for k, v in truth("rig").values.items()}
    file = {"schema": "drivetool/parameters/1", "parameters": values, "noise": NOISE}
    Path("good.yaml").write_text(yaml.safe_dump(file))
    Path("seen.yaml").write_text(yaml.safe_dump(file | {"data": [{"file": "x", "sha256": sha}]}))
    part = {"data": [{"file": "x", "sha256": sha}], "options": {"condition": ["keep to=4", "omit from=1 to=2"]}}
    Path("part.yaml").write_text(yaml.safe_dump(file | part))
    Path("bad.yaml").write_text(yaml.safe_dump(file | {"parameters": values | {"motor.inertia": 0.7}}))
    idle = {"parameters": values | {"load.idle_torque": 60.0, "load.inertia": 0.5}}
    Path("idle.yaml").write_text(yaml.safe_dump(file | idle))

    def call(*words):
        with pytest.raises(SystemExit) as left:
            command_line.app(["validate", log, *words, "-o", "v.yaml"], prog_name="drivetool")
        written = yaml.safe_load(Path("v.yaml").read_text())
        Path("v.yaml").unlink()
        return left.value.code or 0, written, capfd.readouterr().err

    code, file, talk = call("-p", "good.yaml", "--min-fit", "99", "--plot", "p", "--segment", "2")
    assert code == 0 and file["passed"] and "Passed" in talk and file["options"]["segment"] == 2.0
    assert sorted(p.name for p in Path("p").iterdir()) == [
        "validate-steps_holdout-correlation.png", "validate-steps_holdout-record.png"]
    code, content, talk = call("-p", "idle.yaml", "--max-correlation", "1")
    assert code == 3 and not content["passed"] and "failure" in talk and "worse than its mean" in talk
    assert call("-p", "idle.yaml", "--max-correlation", "1", "--min-fit", "-100")[0] == 0
    for limit in (("--min-fit", "99.99"), ("--max-correlation", "0.001")):
        code, file, talk = call("-p", "good.yaml", *limit)
        assert code == 3 and not file["passed"] and "Not passed" in file["verdict"] and "failure" in talk
    code, file, _ = call("-p", "good.yaml", "-p", "bad.yaml")
    assert code == 3 and [c["passed"] for c in file["checks"]] == [True, False]
    code, file, talk = call("-p", "seen.yaml")
    assert code == 0 and "not-held-out" in talk and "not a validation" in file["verdict"]
    assert call("-p", "seen.yaml", "--strict")[0] == 3
    for condition, said in (("keep from=4", False), ("keep from=1 to=2", False), ("keep from=3.5", True)):
        talk = call("-p", "part.yaml", "--condition", condition)[2]
        assert ("not-held-out" in talk) == said, condition
    assert call("-p", "good.yaml", "--quiet") == call("-p", "good.yaml", "--quiet")
