"""Free-run error: what counts as an error of a drive, and what does not."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.identify.laws.free_run_test import FreeRunTest
from drivetool.identify.motion.motion import Smoothing, smoothing_of
from drivetool.identify.noise.noise import Noise
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from tests.identify.swing import TRUTH, record, swing, task_of
from tests.recover import experiment

S = swing()
ROLES = pytest.mark.parametrize("role", ["motor_speed", "motor_angle"])


def free_run_error(made, role, **values):
    judge = FreeRunTest({made.step: smoothing_of([made], role)}, Noise(1.0, None, np.ones(1)))
    task = task_of(made, **values)
    return judge.error(task), float(np.std(S.speed))


@ROLES
def test_the_true_drive_makes_no_error(role):
    error, spread = free_run_error(record(S, role), role)
    assert error < 1e-3 * spread


@ROLES
def test_a_constant_torque_does_not_count(role):
    error, spread = free_run_error(record(S, role, more=0.5), role)
    assert error < 1e-3 * spread
    assert free_run_error(record(S, role), role, idle_torque=-3.0)[0] < 1e-3 * spread


@ROLES
@pytest.mark.parametrize("name, factor", [("inertia", 1.2), ("coulomb", 1.5), ("viscous", 3.0)])
def test_a_wrong_drive_counts(role, name, factor):
    error, spread = free_run_error(record(S, role), role, **{name: factor * TRUTH[f"motor.{name}"]})
    assert error > 0.01 * spread


@ROLES
def test_the_worse_the_drive_the_larger_the_error(role):
    made = record(S, role)
    found = [free_run_error(made, role, inertia=f * TRUTH["motor.inertia"])[0] for f in (1.0, 1.05, 1.1, 1.3)]
    assert found == sorted(found) and found[3] > 2.0 * found[2]


def test_an_error_of_the_angle_counts_as_its_speed():
    # Both sensors see the same drive err by as much, in rad/s.
    values = {"inertia": 1.2 * TRUTH["motor.inertia"]}
    speed, angle = (free_run_error(record(S, role), role, **values)[0] for role in ("motor_speed", "motor_angle"))
    assert angle == pytest.approx(speed, rel=0.5)


def test_straight_lines_err_by_what_a_motion_bends():
    n, step = 4000, 1e-3
    bent = swing(n, step, parts=((1.0 / np.pi, 0.5, 0.0),))  # the speed is cos(pi t): half a period in each run
    made = record(bent, step=step)
    judge = FreeRunTest({made.step: smoothing_of([made], "motor_speed")}, Noise(1.0, None, np.ones(1)))
    t = (np.arange(1000) + 0.5) / 1000.0
    left = np.cos(np.pi * t) - np.polyval(np.polyfit(t, np.cos(np.pi * t), 1), t)
    assert judge.straight_line_error(task_of(made)) == pytest.approx(np.sqrt(np.mean(left**2)), rel=0.02)


@ROLES
def test_straight_lines_of_a_noisy_record_say_nothing(role):
    straight = swing(parts=((100.0, 0.004, 0.3),))
    noise = (1.0 if role == "motor_speed" else 0.01) * np.random.default_rng(1).standard_normal(4000)
    for made, says in ((record(S, role), True), (record(straight, role, noise=noise), False)):
        judge = FreeRunTest({made.step: smoothing_of([made], role)}, Noise(1.0, None, np.ones(1)))
        assert (judge.straight_line_error(task_of(made)) > 0.0) == says


def test_noise_above_the_cut_off_hardly_counts():
    noise = 0.2 * np.random.default_rng(1).standard_normal(4000)
    error, _ = free_run_error(record(S, noise=noise), "motor_speed")
    assert 0.0 < error < 0.1


def test_missing_values_do_not_count():
    made = record(S)
    speed = made.signals["motor_speed"].copy()
    speed[300:320] = np.nan
    error, spread = free_run_error(replace(made, signals={**made.signals, "motor_speed": speed}), "motor_speed")
    assert error < 1e-3 * spread


@pytest.mark.parametrize("step", [0.08, 0.25])
def test_a_slow_sampling_rate_is_judged_as_well(step):
    s = swing(1200, step, parts=((40.0, 0.01, 0.0), (10.0, 0.05, 1.0)))
    error, spread = free_run_error(record(s, step=step), "motor_speed")
    assert error < 0.05 * spread


@ROLES
def test_the_fit_is_that_of_the_speed(role):
    # Torque-free from a known speed, with viscous friction of another size: two exponentials.
    time = 2e-3 * np.arange(3000)
    true, wrong = (30.0 * np.exp(-rate * time) for rate in (0.5, 0.6))
    angle = 60.0 * (1.0 - np.exp(-0.5 * time))
    made = replace(experiment(np.zeros(3000), true, step=2e-3), signals={
        "motor_torque": np.zeros(3000), role: true if role == "motor_speed" else angle})
    judge = FreeRunTest({made.step: smoothing_of([made], role)}, Noise(1.0, None, np.ones(1)))
    drive = one_body().with_values({"motor.inertia": 0.02, "motor.viscous": 0.012})
    found = judge.fit_percent(Task(drive, ("motor.viscous",), roles_of([made], drive), (made,)))
    # The start state is fitted: the exponential of the wrong rate that is nearest (to the speed, or to its angle).
    if role == "motor_speed":
        rows = wrong[:, None]
        nearest = wrong * np.linalg.lstsq(rows, true, rcond=None)[0]
    else:
        rows = np.column_stack([np.ones(3000), 1.0 - np.exp(-0.6 * time)])
        nearest = 0.6 * np.exp(-0.6 * time) * np.linalg.lstsq(rows, angle, rcond=None)[0][1]
    expected = 100.0 * (1.0 - np.sqrt(np.mean((true - nearest) ** 2)) / np.std(true))
    assert found == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("window, size, wanted", [
    (5, 200, 5), (144, 20, 5), (144, 3, 1), (10, 40, 10), (11, 40, 10)])
def test_no_mean_is_as_long_as_a_run(window, size, wanted):
    judge = FreeRunTest({1.0: Smoothing(0.4 / window, 0.0)}, Noise(1.0, None, np.ones(1)))
    assert judge.window(size, 1.0) == wanted
    error = judge._as_speed(np.linspace(-1.0, 1.0, size), 1.0, False)
    assert len(error) == size - wanted + 1 and (size < 4 or np.std(error) > 0.3)
