"""A drive's own parameters beside laws: friction as the nearest line, the mean of the inertia and of the torque."""

import numpy as np
import pytest

from drivetool.identify.laws.laws import Law, law_library, measurement_noise_law
from drivetool.identify.laws.projected_parameters import projected_within_bounds, projection_of_laws
from drivetool.identify.motion.motion import motions_of
from drivetool.identify.plateaus.points import STANDSTILL_SPEED_SHARE
from tests.identify.swing import TRUTH, record, swing, task_of

S = swing()
SEEN = motions_of([record(S)], "motor_speed")
LAWS = {law.name: law for law in (*law_library(SEEN, True),
                                  *measurement_noise_law((np.random.default_rng(1).standard_normal(4000),)))}
FACTOR = 0.15


def own(*names, task=None, factors=None, seen=SEEN, laws=LAWS):
    chosen = [laws[n] for n in names]
    width = sum(law.size for law in chosen)
    task = task or task_of(record(S))
    return dict(zip(task.free, projection_of_laws(task, chosen, {"motor": seen}) @ np.concatenate(
        [[TRUTH[n] for n in task.free], np.full(width, FACTOR) if factors is None else factors]), strict=True))


def test_without_laws_they_are_what_was_fitted():
    assert own() == pytest.approx(TRUTH)


@pytest.mark.parametrize("name", ["Stribeck friction with a Stribeck speed of 0.1 times the maximum speed",
                                  "friction that grows with the square of the speed"])
def test_friction_is_the_line_nearest_to_the_curve_over_the_speeds_visited(name):
    found = own(name)
    m = SEEN.each[0]
    moving = np.abs(m.speed) > STANDSTILL_SPEED_SHARE * SEEN.top
    speed, law = np.abs(m.speed[moving]), np.sign(m.speed[moving]) * LAWS[name].columns[0][moving, 0]
    curve = TRUTH["motor.coulomb"] + TRUTH["motor.viscous"] * speed + FACTOR * law
    slope, level = np.polyfit(speed, curve, 1)
    assert abs(slope / TRUTH["motor.viscous"] - 1.0) > 0.05
    # The motion is hardly the same in both directions, and a reversal counts for less than a sample.
    assert found["motor.viscous"] == pytest.approx(slope, rel=2e-2)
    assert found["motor.coulomb"] == pytest.approx(level, rel=2e-2)
    assert found["motor.inertia"] == TRUTH["motor.inertia"]


def test_the_idle_torque_has_the_mean_of_what_differs_by_direction():
    name = "direction-dependent friction"
    found = own(name)
    m = SEEN.each[0]
    moving = np.abs(m.speed) > STANDSTILL_SPEED_SHARE * SEEN.top
    mean = FACTOR * np.mean(LAWS[name].columns[0][moving, 0])
    assert mean > 0.05
    assert found == pytest.approx({**TRUTH, "motor.idle_torque": TRUTH["motor.idle_torque"] + mean})


def test_the_inertia_has_its_mean_over_the_angles():
    narrow = swing(parts=((0.8, 1.0, 0.0),))
    seen = motions_of([record(narrow, "motor_angle")], "motor_angle")
    laws = {law.name: law for law in law_library(seen, True)}
    law = laws["inertia varying twice per turn"]
    found = own(law.name, seen=seen, laws=laws, factors=[FACTOR, 0.0], task=task_of(record(narrow, "motor_angle")))
    assert found == pytest.approx(
        {**TRUTH, "motor.inertia": TRUTH["motor.inertia"] + FACTOR * law.inertia[0]})


def test_measurement_noise_of_the_torque_is_part_of_no_parameter():
    assert own("measurement noise of the logged torque") == pytest.approx(TRUTH)


def test_with_one_direction_the_idle_torque_is_the_level_of_friction():
    one_way = swing(offset=30.0)
    seen = motions_of([record(one_way)], "motor_speed")
    speed = seen.each[0].speed
    law = Law("bent", (speed[:, None] ** 2 / 900.0,), "friction")
    task = task_of(record(one_way), free=("motor.inertia", "motor.viscous", "motor.idle_torque"))
    found = own("bent", seen=seen, laws={"bent": law}, task=task)
    slope, level = np.polyfit(speed, FACTOR * speed**2 / 900.0, 1)
    assert found["motor.viscous"] == pytest.approx(TRUTH["motor.viscous"] + slope)
    assert found["motor.idle_torque"] == pytest.approx(TRUTH["motor.idle_torque"] + level)


def test_of_friction_that_falls_over_the_speed_the_nearest_level_is_left():
    task, m = task_of(record(S)), SEEN.each[0]
    found = projected_within_bounds(task, np.array([0.02, -0.01, 0.4, 0.1]), {"motor": SEEN})
    moving = np.abs(m.speed) > STANDSTILL_SPEED_SHARE * SEEN.top
    nearest = np.mean(0.4 - 0.01 * np.abs(m.speed[moving]))  # the constant of least squares
    assert found == pytest.approx([0.02, 0.0, nearest, 0.1], rel=1e-2)
    inside = np.array([0.02, 0.05, 0.4, -3.0])
    assert projected_within_bounds(task, inside, {"motor": SEEN}) == pytest.approx(inside)
    low = task.drive.quantity("motor.inertia").bounds[0]
    found = projected_within_bounds(task, np.array([-1.0, 0.05, -0.4, 0.1]), {"motor": SEEN})
    assert found == pytest.approx([low, 0.05, 0.0, 0.1])
