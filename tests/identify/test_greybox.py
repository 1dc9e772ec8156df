"""What a user can request of a grey-box fit, and what it reports."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.signal import lfilter

from drivetool.drive import two_mass
from drivetool.errors import BadOption, BadParameters
from drivetool.identify.fit.engine import free_run
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.noise.noise import Noise, filtered_normal_equations
from drivetool.identify.problem.least_squares import marquardt_step
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import Roles, first_point, problem_of, traces_of
from drivetool.identify.setup.task import Task
from drivetool.logs import Experiment
from tests.hidden import greybox_options, make_case, write_start
from tests.hidden.command import run
from tests.recover import STEP, drive_like, experiment, gap_record, joint_error, linear_record, truth
from tests.simulator.experiments import multisine, steps
from tests.simulator.machine import machine_by_seed, running
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

SHAPE = ["motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping"]
MACHINE = machine_by_seed(5)


def start(off=0.1):
    values = truth(MACHINE)
    return drive_like(MACHINE, SHAPE, off, 1).with_values(
        {n: values[n] for n in ("total.viscous", "total.idle_torque")})


@pytest.mark.slow
def test_two_recordings_fitted_together_are_more_accurate_than_one():
    one = linear_record(MACHINE, 51, 4.0)
    two = linear_record(MACHINE, 52, 4.0)
    single = greybox([one], start(), Options())
    both = greybox([one, replace(two, name="second")], start(), Options())
    square, limit = joint_error(both, truth(MACHINE))
    assert square < limit
    std = {e: {p.name: p.std_noise for p in est.parameters} for e, est in (("one", single), ("both", both))}
    for name in SHAPE:
        assert std["both"][name] < 0.9 * std["one"][name]
    assert [each.file for each in both.data] == ["simulated", "second"]


def test_held_parameter_keeps_its_value_and_the_others_move():
    drive = start().with_values({"shaft.stiffness": truth(MACHINE)["shaft.stiffness"]})
    estimate = greybox([linear_record(MACHINE, 51)], drive, Options(hold=("shaft.stiffness",)))
    lines = {p.name: p for p in estimate.parameters}
    assert lines["shaft.stiffness"].status == "held" and lines["shaft.stiffness"].std is None
    assert lines["shaft.stiffness"].value == drive.values["shaft.stiffness"]
    assert lines["motor.inertia"].value != drive.values["motor.inertia"]


@pytest.mark.slow
def test_both_criteria_are_reported_and_agree_where_the_model_is_right():
    fit = greybox([linear_record(MACHINE, 51)], start(), Options(criterion="innovations")).fit
    ours = fit["held_out_simulation_fit_percent_by_innovations"]
    theirs = fit["held_out_simulation_fit_percent_by_simulation"]
    assert ours > 95.0 and abs(ours - theirs) < 1.0
    assert fit["one_step_fit_percent"] >= fit["simulation_fit_percent"]


def test_simulation_criterion_says_what_its_intervals_assume():
    estimate = greybox([linear_record(MACHINE, 51, torque_noise=0.0)], start(), Options(criterion="simulation"))
    assert "simulation-criterion" in {f.code for f in estimate.findings}
    for name in SHAPE:
        assert estimate.drive.values[name] == pytest.approx(truth(MACHINE)[name], rel=0.05)


def disturbed_record(noise, sensor=0.002):
    """Torque steps and a multisine, with a torque noise in shares of the rated torque.

    sensor  noise over the speed that the rated torque gives in a quarter of a second
    """
    rated = MACHINE.rated_torque
    begin = running(MACHINE, 20.0)
    torque = steps(begin.torque, [0.1 * rated] * 8, (0.6, 1.0), 0.5, STEP, 3)[:6000]
    torque = torque + multisine(np.linspace(0.3, 2.0, 9) * 18.0, 0.01 * rated, 6.0, STEP, 4)[: len(torque)]
    speed = simulate_linear(MACHINE, torque, STEP, begin, noise[:len(torque)] * rated).speeds[:, 0]
    speed = speed + white_noise(len(torque), sensor * rated * 0.25 / sum(MACHINE.inertia), 6)
    return experiment(torque, speed)


@pytest.mark.slow
def test_coloured_torque_noise_is_noticed_and_modelled():
    memory = np.exp(-STEP / 0.03)
    noise = lfilter([1.0], [1.0, -memory], white_noise(6000, 0.03 * np.sqrt(1.0 - memory**2), 5))
    estimate = greybox([disturbed_record(noise)], start(0.05), Options())
    assert estimate.noise["torque_correlation_time"] == pytest.approx(0.03, rel=0.4)
    assert estimate.noise["torque_std"] == pytest.approx(0.03 * MACHINE.rated_torque, rel=0.4)
    square, limit = joint_error(estimate, truth(MACHINE))
    assert square < limit


@pytest.mark.slow
def test_torque_noise_that_is_weak_where_it_is_slow_is_noticed_and_modelled():
    """As the residual of an inexact mode. Modelled as white, it would make slow friction far more uncertain."""
    memory, slow = np.exp(-STEP / 0.005), 0.1
    white = white_noise(6000, 0.03, 5)
    noise = white + lfilter([0.0, (slow - 1.0) * (1.0 - memory)], [1.0, -memory], white)
    estimate = greybox([disturbed_record(noise, 0.0002)], start(0.05), Options())
    assert estimate.noise["torque_slow_share"] == pytest.approx(slow, rel=0.4)
    assert estimate.noise["torque_correlation_time"] == pytest.approx(0.005, rel=0.4)
    assert estimate.noise["torque_std"] == pytest.approx(0.03 * MACHINE.rated_torque, rel=0.2)
    square, limit = joint_error(estimate, truth(MACHINE))
    assert square < limit
    (idle,) = estimate.ratios  # with Coulomb friction: the drive turns one way
    # The mean of the noise, and the slope that viscous friction takes of it, whose size the record identifies.
    assert idle.std < 0.3 * 0.03 * MACHINE.rated_torque / np.sqrt(6000 / 16)


def test_normal_equations_of_forgetful_coloured_noise_are_those_of_white():
    """They carry the uncertainty of held values, under whichever noise model the fit ended with."""
    task = Task(start(), ("motor.inertia", "load.inertia"), Roles(("motor_torque",), ("motor_speed",)),
                (linear_record(MACHINE, 51, 3.0),))
    problem = task.problem()
    point = first_point(task.drive, problem, task.roles)
    scale = np.ones(1)
    white = filtered_normal_equations(problem, point, Noise(20.0, None, scale))
    almost = filtered_normal_equations(problem, point, Noise(20.0, 1e-9, scale))
    np.testing.assert_allclose(almost.shared, white.shared, rtol=1e-6)
    np.testing.assert_allclose(almost.cross[0], white.cross[0], rtol=1e-5, atol=1e-9 * np.abs(white.cross[0]).max())


@pytest.mark.slow
def test_motor_and_load_friction_are_not_separable_by_motor_speed_alone():
    drive = start().with_values({"motor.viscous": 0.02, "load.viscous": 0.02})
    estimate = greybox([linear_record(MACHINE, 51)], drive,
                       Options(free=("motor.viscous", "load.viscous")))
    lines = {p.name: p for p in estimate.parameters}
    for name in ("motor.viscous", "load.viscous"):
        assert lines[name].status == "not-identifiable" and lines[name].std is None
    assert any("shaft torque" in f.action for f in estimate.findings if f.code == "not-identifiable")


@pytest.mark.slow
def test_speeds_of_both_ends_do_not_separate_the_idle_torques():
    """A constant torque moved from one end to the other only moves the twist, which no speed shows."""
    record = linear_record(MACHINE, 51)
    run = simulate_linear(MACHINE, record.signals["motor_torque"], STEP, running(MACHINE, 20.0),
                          white_noise(record.size, 0.003 * MACHINE.rated_torque, 7 * 51 + 1))
    load = run.speeds[:, 1] + white_noise(record.size, 0.002, 98)
    record = replace(record, signals={**record.signals, "load_speed": load})
    parts = ("motor.idle_torque", "load.idle_torque")
    estimate = greybox([record], start().with_values({n: truth(MACHINE)[n] for n in parts}), Options(free=parts))
    lines = {p.name: p for p in estimate.parameters}
    for name, other in (parts, parts[::-1]):
        assert lines[name].status == "not-identifiable" and lines[name].std is None
        assert other in lines[name].reason
    assert lines["motor.inertia"].status == "fitted"


def with_load_angle(error):
    """A linear record with the angle of the load at every fourth sample, and an error of it."""
    record = linear_record(MACHINE, 51)
    run = simulate_linear(MACHINE, record.signals["motor_torque"], STEP, running(MACHINE, 20.0),
                          white_noise(record.size, 0.003 * MACHINE.rated_torque, 7 * 51 + 1))
    angle = np.cumsum(run.speeds[:, 1]) * STEP
    angle = angle - 0.5 * STEP * (run.speeds[:, 1] - run.speeds[0, 1])  # trapezoids
    angle = angle + error(angle) + white_noise(record.size, 1e-4, 98)
    angle[np.arange(record.size) % 4 != 0] = np.nan
    return replace(record, signals={**record.signals, "load_angle": angle})


@pytest.mark.slow
def test_a_sensor_with_a_value_at_every_fourth_sample_is_weighed_rightly():
    """Its noise, initially a hundred times too large, biased the torque noise, and all parameters."""
    record = with_load_angle(np.zeros_like)
    estimate = greybox([record], start(), Options())
    assert estimate.noise["sensor_std.load_angle"] == pytest.approx(1e-4, rel=0.2)
    assert not {"innovations-correlated", "not-converged"} & {f.code for f in estimate.findings}
    lines = {p.name: p for p in estimate.parameters}
    for name in ("motor.inertia", "load.inertia", "shaft.stiffness"):
        assert abs(lines[name].value - truth(MACHINE)[name]) < 4.0 * lines[name].std


@pytest.mark.slow
def test_repeating_errors_of_a_second_sensor_are_said_too():
    estimate = greybox([with_load_angle(lambda angle: 2e-3 * np.sin(angle))], start(), Options())
    assert "innovations-correlated" in {f.code for f in estimate.findings}


@pytest.mark.slow
def test_a_shaft_torque_sensor_separates_them():
    machine = replace(MACHINE, viscous=(0.4, 0.1))
    record = linear_record(machine, 51)
    run = simulate_linear(machine, record.signals["motor_torque"], STEP, running(machine, 20.0),
                          white_noise(record.size, 0.003 * machine.rated_torque, 7 * 51 + 1))
    shaft = run.shaft_torques[:, 0] + white_noise(record.size, 0.5, 99)
    record = replace(record, signals={**record.signals, "shaft_torque": shaft})
    drive = start().with_values({"motor.viscous": 0.2, "load.viscous": 0.2})
    estimate = greybox([record], drive, Options(free=("motor.viscous", "load.viscous")))
    lines = {p.name: p for p in estimate.parameters}
    for name, true in (("motor.viscous", 0.4), ("load.viscous", 0.1)):
        assert lines[name].status == "fitted"
        assert abs(lines[name].value - true) < 4.0 * lines[name].std
        assert lines[name].std < 0.03
    assert estimate.noise["sensor_std.shaft_torque"] == pytest.approx(0.5, rel=0.1)


@pytest.mark.slow
def test_a_speed_that_never_changes_is_fitted_without_a_division_by_zero():
    """The observer repeats it without an error, which leaves no variance; warnings are errors here."""
    t = np.arange(400) * 1e-3
    still = Experiment("r", "r", 1e-3, 0.0, {"motor_torque": np.sin(20.0 * t), "motor_speed": np.full(400, 5.0)},
                       ((0, 400),))
    rig = two_mass().with_values({"motor.inertia": 0.6, "load.inertia": 5.2, "shaft.stiffness": 3300.0,
                                  "shaft.damping": 3.0, "motor.viscous": 0.8, "load.viscous": 0.4})
    found = greybox([still], rig, Options())
    assert np.isnan(found.fit["simulation_fit_percent"]) and found.fit["rmse"] >= 0.0


def test_same_input_same_numbers():
    record = linear_record(MACHINE, 51, 3.0)
    first, second = (greybox([record], start(), Options()) for _ in range(2))
    assert first.drive.values == second.drive.values
    assert np.array_equal(first.covariance.matrix, second.covariance.matrix)


@pytest.mark.parametrize(("options", "error", "words"), [
    ({"free": ("motor.inertai",)}, BadParameters, "motor.inertia"),
    ({"hold": ("motor.inertia",), "free": ("motor.inertia",)}, BadOption, "both"),
    ({"free": ("converter.bandwidth",)}, BadOption, "finite start value"),
])
def test_options_that_cannot_be(options, error, words):
    with pytest.raises(error, match=words):
        greybox([linear_record(MACHINE, 51, 3.0)], start(), Options(**options))


@pytest.mark.slow
def test_a_linear_fit_that_went_astray_comes_in_another_way(tmp_path):
    """From 15 % off the direct way ends with a rigid drive, 1500 units of log likelihood below the optimum."""
    case = make_case((), 60812, seed=60812)
    logs, _ = case.write_records(tmp_path)
    begin = write_start(case, tmp_path)
    run(tmp_path, ["greybox", *(log.name for log in logs), "--params", begin.name, "--out", "base.yaml", "--quiet",
                   *greybox_options(case)])
    found = yaml.safe_load((tmp_path / "base.yaml").read_text())["parameters"]
    truth = case.label(False)["plain"]
    for name in ("motor.inertia", "load.inertia", "shaft.stiffness"):
        assert abs(found[name]["value"] - truth[name]) < 4.0 * found[name]["std"], name
        assert found[name]["std"] < 0.02 * truth[name]


def test_a_free_run_begins_at_its_first_guess_where_the_filter_runs_away():
    """Noise that no number holds leaves gains that are none; the run itself needs no filter."""
    record, values = linear_record(MACHINE, 51, 1.0), truth(MACHINE)
    drive = start(0.0).with_values(values)
    task = Task(drive, (), Roles(("motor_torque",), ("motor_speed",)), (record,))
    problem = task.problem(free=())
    _, point, runs = free_run(task, noise=Noise(1e153, None, problem.scale))
    assert len(runs[0]) == record.size and np.isfinite(runs[0]).all()
    assert point.starts[0].size and np.isfinite(point.starts[0]).all()


def test_the_start_speed_of_a_body_without_mass_stays():
    """Nothing depends on it: what rounding leaves of its sensitivity, divided by, would make it astronomic."""
    record = linear_record(MACHINE, 51, 2.0)
    speed = record.signals["motor_speed"]
    record = replace(record, signals={**record.signals, "motor_angle": np.cumsum(speed) * STEP})
    drive = replace(start(), values={**start().values, "motor.inertia": 1e-12})
    roles = Roles(("motor_torque",), ("motor_angle",))
    problem = problem_of(drive, SHAPE, roles, traces_of([record], roles))
    point = first_point(drive, problem, roles)
    _, (own,) = marquardt_step(problem, point, problem.normal(point), 1e-3)
    assert abs(own[0]) < np.abs(speed).max()


@pytest.mark.slow
def test_a_gap_that_the_drive_lacks_is_requested_and_not_suspected():
    machine = machine_by_seed(21, gap=0.2)
    values = truth(machine)
    drive = drive_like(machine, SHAPE).with_values({n: values[n] for n in ("total.viscous", "total.idle_torque")})
    record, _ = gap_record(machine, 21)
    said = {f.code for f in greybox([record], drive, Options()).findings}
    assert "gap-left-out" in said and "gap-may-open" not in said
    # A held stiffness cannot be fitted.
    said = {f.code for f in greybox([record], drive, Options(hold=("shaft.stiffness",))).findings}
    assert "gap-left-out" not in said and "gap-may-open" in said
    without = drive.with_values({"shaft.half_gap": 0.0})
    said = {f.code for f in greybox([record], without, Options()).findings}
    assert not said & {"gap-left-out", "gap-may-open"}
