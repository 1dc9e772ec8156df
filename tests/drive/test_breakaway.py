"""Breakaway friction without a standstill against a general solver that shares no code with the kernel."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.drive.chain import one_body
from drivetool.drive.simulation.simulate import Trace
from drivetool.identify.setup import Roles, problem_of
from tests.coasting import RPM, STEP, Motor, motion

FREE = ("motor.coulomb", "motor.breakaway", "motor.breakaway_speed")


def problem_for(motor, torque):
    """(problem, its values) of the motor's friction, angle measured."""
    drive = one_body().with_values({
        "motor.inertia": motor.inertia, "motor.viscous": motor.viscous, "motor.coulomb": motor.coulomb,
        "motor.breakaway": motor.surplus, "motor.breakaway_speed": motor.breakaway_speed})
    trace = Trace(torque[:, None], np.zeros((len(torque), 1)), STEP)
    values = np.array([motor.coulomb, motor.surplus, motor.breakaway_speed])
    return problem_of(drive, FREE, Roles(("motor_torque",), ("motor_angle",)), (trace,)), values


@pytest.mark.parametrize("speed", [0.5, 5.0, 40.0])
def test_a_coast_down_is_that_of_a_general_solver(speed):
    motor = Motor(surplus=0.5 * Motor().coulomb, breakaway_speed=speed)
    angle, turning = motion(motor, lambda t: 0.0, 2240 * RPM, 0.0, 2.0)
    problem, values = problem_for(motor, np.zeros(len(angle)))
    out, states, _ = problem.plants(values, False)[0].simulate(
        problem.traces[0], np.array([2240 * RPM, 0.0]), keep=True)
    np.testing.assert_allclose(out[:, 0], angle, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(states[:, 0], turning, rtol=0.0, atol=1e-6)


def test_driven_to_and_fro_through_zero():
    motor, n = Motor(surplus=0.5 * Motor().coulomb, breakaway_speed=5.0), 20_000
    torque = 0.03 * np.sign(np.sin(2.0 * np.pi * 5.0 * STEP * (np.arange(n) + 0.5)))
    problem, values = problem_for(motor, torque)
    out = problem.plants(values, False)[0].outputs(problem.traces[0], np.zeros(2))[:, 0]
    # Between two reversals the torque is constant: each stretch is solved by itself, from where the last one ended.
    turns = np.flatnonzero(np.diff(torque)) + 1
    at, speed, angle = 0, 0.0, 0.0
    for end in [*turns, n - 1]:
        there, turning = motion(motor, lambda t, k=torque[at]: k, speed, 0.0, (end - at + 1.5) * STEP)
        np.testing.assert_allclose(out[at:end + 1], angle + there[:end - at + 1], rtol=0.0, atol=1e-7)
        at, speed, angle = end, float(turning[end - at]), angle + float(there[end - at])


@pytest.mark.parametrize("speed", [0.5, 5.0])
def test_its_derivatives_are_differences(speed):
    motor = Motor(surplus=0.5 * Motor().coulomb, breakaway_speed=speed)
    problem, values = problem_for(motor, np.zeros(40_000))
    trace, start = problem.traces[0], np.array([2000 * RPM, 0.0])
    rows = problem.plants(values, True)[0].jacobian(trace, start)[1][:, 0]
    assert len(values) == len(FREE) and len(rows) == 40_000
    for i, value in enumerate(values):
        step = np.eye(3)[i] * 1e-4 * value
        up, down = (problem.plants(values + s * step, False)[0].outputs(trace, start)[:, 0] for s in (1.0, -1.0))
        slope = (up - down) / (2e-4 * value)
        np.testing.assert_allclose(rows[:, i], slope, rtol=0.0, atol=2e-6 * np.abs(slope).max())
