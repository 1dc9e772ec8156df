"""A load much faster than the sampling, with dry friction: a slider behind a spring, in closed form."""

import numpy as np
import pytest

from drivetool.drive.assemble import Layout
from drivetool.drive.chain import two_mass
from drivetool.drive.simulation.augment import plant_of
from drivetool.drive.simulation.simulate import Trace
from drivetool.identify.noise import minus_log_likelihood

STEP, HEAVY = 1e-3, 1e6
FRICTION, STIFFNESS = 5.0, 1000.0
TIME = STEP * np.arange(3000)
MOTION = 0.03 * np.sin(2.0 * np.pi * TIME)


def slider():
    """(n,) torque of a spring that ends on a slider: it follows the motion until friction gives."""
    held, found = 0.0, np.zeros(len(MOTION))
    for i, way in enumerate(MOTION):
        held = np.clip(held, way - FRICTION / STIFFNESS, way + FRICTION / STIFFNESS)
        found[i] = STIFFNESS * (way - held)
    return found


@pytest.mark.parametrize("inertia", [1e-4, 1e-5, 3e-6, 1e-7, 1e-10])
def test_a_load_too_quick_for_the_record_sticks_and_slides_as_a_slider_does(inertia):
    drive = two_mass().with_values({
        "motor.inertia": HEAVY, "load.inertia": inertia, "load.coulomb": FRICTION, "shaft.stiffness": STIFFNESS,
        "shaft.damping": 1.0})
    plant = plant_of(drive, Layout((), ("motor_torque",), ("shaft_torque",), STEP, gradient=False))
    speed = np.diff(MOTION, append=MOTION[-1]) / STEP
    torque = HEAVY * np.diff(speed, append=speed[-1]) / STEP
    start = np.zeros(plant.nx)
    start[0] = speed[0]
    found = plant.outputs(Trace(torque[:, None], np.zeros((len(MOTION), 1)), STEP), start)[:, 0]
    # The damper adds up to its share of the motor's speed while the load sticks.
    assert np.abs(found - slider()).max() < 1.2 * np.abs(speed).max()
    assert np.abs(found).max() < 1.005 * FRICTION


def test_a_covariance_below_its_rounding_errors_gives_an_infinite_variance():
    """A motor of no inertia on a held load: the noise of the torque, when it slips, is a variance of 1e24."""
    drive = two_mass().with_values({
        "motor.inertia": 1e-12, "load.inertia": 1e12, "motor.coulomb": 20.0, "shaft.stiffness": 1.7e7,
        "shaft.damping": 1e5})
    plant = plant_of(drive, Layout((), ("motor_torque",), ("motor_speed",), 0.005, gradient=False))
    rng = np.random.default_rng(5)
    torque = np.where(rng.random(2000) < 0.5, 236.7, 83.3)
    trace = Trace(torque[:, None], 0.04 * rng.standard_normal((2000, 1)), 0.005)
    found = plant.filter(trace, np.zeros(plant.nx), np.array([1.7e-3]), 1e4, np.zeros(plant.nx))
    assert (found.variance > 0.0).all() and np.isfinite(found.gains.weight).all()
    assert np.isinf(found.variance).any() and minus_log_likelihood([found]) == np.inf
