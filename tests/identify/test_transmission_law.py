"""The law of a transmission loss in the default fit: its size, and where it cannot be told."""

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.laws.candidates import motions_of_bodies
from drivetool.identify.laws.transmission import NAME, transmission_law
from drivetool.identify.motion import motions_of
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from tests.recover import STEP, experiment
from tests.simulator.effects import Effects
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise

EFFICIENCY = 0.9
MACHINE = Machine((0.02,), (0.002,), (0.05,), rated_torque=1.0, effects=Effects(
    loss_driving=(1.0 - EFFICIENCY,), loss_driven=(1.0 / EFFICIENCY - 1.0,)))


def outcome_of(torque):
    """The innovations fit of inertia and friction to a record without the loss in the model."""
    speed = simulate_fast(MACHINE, torque, STEP).speeds[:, 0]
    record = experiment(torque, speed + white_noise(len(torque), 1e-3, 5))
    drive = one_body().with_values({"motor.inertia": 0.02, "motor.viscous": 0.002, "motor.coulomb": 0.05})
    free = ("motor.inertia", "motor.coulomb")
    return by_innovations(Task(drive, free, roles_of([record], drive), (record,)), [{}])


def laws_of(outcome):
    seen = motions_of(outcome.task.experiments, "motor_speed")
    return transmission_law(outcome, motions_of_bodies(outcome, seen))


def test_what_is_lost_is_a_share_of_the_mean_of_the_torques_before_and_behind():
    """Of one efficiency e that share is 2 (1 - e)/(1 + e) in both directions."""
    levels = np.random.default_rng(3).uniform(-1.0, 1.0, 40)
    outcome = outcome_of(np.repeat(levels, 100))
    law, = laws_of(outcome)
    assert law.name == NAME and law.body == "motor" and law.size == 2
    column = law.columns[0][:, 0]
    motion = motions_of(outcome.task.experiments, "motor_speed").each[0]
    torque = outcome.task.experiments[0].signals["motor_torque"]
    lost = torque - 0.02 * motion.acceleration - 0.002 * motion.speed - 0.05 * motion.side
    mean = 0.5 * (torque + torque - lost)
    away = ~motion.slow & (np.abs(np.diff(torque, prepend=0.0)) == 0.0)
    share = np.sum((column * lost)[away]) / np.sum((column * motion.side * np.sign(mean) * mean)[away])
    np.testing.assert_allclose(share, 2.0 * (1.0 - EFFICIENCY) / (1.0 + EFFICIENCY), rtol=0.05)


@pytest.mark.parametrize("offset", [0.6, -0.6])
def test_of_driving_motion_alone_it_is_no_law(offset):
    """Then the torque transmitted is proportional to all other torques together."""
    torque = offset + np.repeat(np.random.default_rng(4).uniform(-0.1, 0.3, 40) * np.sign(offset), 100)
    assert laws_of(outcome_of(torque)) == ()
