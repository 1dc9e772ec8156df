"""The filter where friction holds a body and torque noise may release it."""

import numpy as np
import pytest

from drivetool.drive.assemble import Layout
from drivetool.drive.chain import one_body, two_mass
from drivetool.drive.kernel.filter import HOLDING_SIGMAS
from drivetool.drive.kernel.run import RESTICK_FRACTION
from drivetool.drive.simulation.augment import plant_of
from drivetool.drive.simulation.simulate import ObserverGains, Trace

STEP, INERTIA, COULOMB = 1e-3, 0.01, 1.0


def plant(sensor, drive=None):
    drive = drive or one_body().with_values(
        {"motor.inertia": INERTIA, "motor.coulomb": COULOMB, "motor.viscous": 0.01})
    return plant_of(drive, Layout((), ("motor_torque",), (sensor,), STEP, gradient=False))


def filtered(found, torque, measured, sensor_std, noise_std):
    return found.filter(Trace(torque[:, None], measured[:, None], STEP), np.zeros(found.nx),
                        np.array([sensor_std**2]), noise_std**2, np.zeros(found.nx))


def released_by_noise(sensor, held, noise, n=4000, quiet=1e-3, seed=1):
    """The filter pass over a body that noise moves from near standstill, with sensor noise."""
    rng, found = np.random.default_rng(seed), plant(sensor)
    commanded = held * np.sign(np.sin(2.0 * np.pi * np.arange(n) / 800.0))
    actual_torque = commanded + noise * rng.standard_normal(n)
    y = found.outputs(Trace(actual_torque[:, None], np.zeros((n, 1)), STEP), np.zeros(found.nx))[:, 0]
    return filtered(found, commanded, y + quiet * rng.standard_normal(n), quiet, noise)


@pytest.mark.parametrize(("sensor", "quiet"), [("motor_speed", 5e-3), ("motor_angle", 5e-6)])
@pytest.mark.parametrize(("held", "noise"), [(0.9, 0.3), (0.5, 0.5), (0.0, 0.8), (1.2, 0.3)])
def test_a_body_that_noise_breaks_loose_is_followed(sensor, quiet, held, noise):
    """Errors match the filter's standard deviation; a filter that holds the body errs by 1e2 to 1e5 of its own."""
    found = released_by_noise(sensor, held, noise, quiet=quiet)
    z = found.innovations[100:, 0] / np.sqrt(found.variance[100:, 0])
    assert 0.3 < np.mean(z**2) < 2.0
    assert np.abs(z).max() < 12.0


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_what_is_held_for_good_has_no_variance(share):
    """Above so many standard deviations of the noise friction always holds; below, the body may move."""
    noise = COULOMB / (share * HOLDING_SIGMAS)
    found = filtered(plant("motor_speed"), np.zeros(50), np.zeros(50), 1e-9, noise)
    assert bool(np.all(found.variance == 1e-18)) == (share > 1.0)


def test_the_first_push_has_the_variance_of_the_torque_that_friction_leaves():
    """By Monte Carlo: a body at rest under 0.5 +- 0.4 Nm, friction 1 Nm, after one sample."""
    drawn = 0.5 + 0.4 * np.random.default_rng(2).standard_normal(1_000_000)
    speed = (np.maximum(drawn - COULOMB, 0.0) + np.maximum(-drawn - COULOMB, 0.0)) * STEP / INERTIA
    found = filtered(plant("motor_speed"), np.full(3, 0.5), np.zeros(3), 1e-9, 0.4)
    assert found.variance[1, 0] == pytest.approx(np.mean(speed**2), rel=1e-2)


def test_an_angle_knows_of_the_speed_that_it_may_have():
    """A body that accelerates uniformly for a sample travels half as far as at its final speed."""
    found = filtered(plant("motor_angle"), np.full(3, 0.9), np.zeros(3), 1e-12, 0.4)
    gain = found.gains.gain[1, 0]
    assert gain[1] == pytest.approx(1.0, rel=1e-6) and gain[0] == pytest.approx(2.0 / STEP, rel=1e-6)


@pytest.mark.parametrize("scale", [1e-6, 1e5])
def test_units_do_not_matter(scale):
    """All torques and the inertia times a factor: the same motion."""
    other = one_body().with_values({"motor.inertia": scale * INERTIA, "motor.coulomb": scale * COULOMB,
                                    "motor.viscous": scale * 0.01})
    torque, y = np.full(200, 0.9), 0.01 * np.random.default_rng(3).standard_normal(200)
    one = filtered(plant("motor_speed"), torque, y, 0.01, 0.3)
    two = filtered(plant("motor_speed", other), scale * torque, y, 0.01, scale * 0.3)
    np.testing.assert_allclose(two.variance, one.variance, rtol=1e-9)
    np.testing.assert_allclose(two.innovations, one.innovations, atol=1e-12)


def test_a_load_that_sticks_is_broken_loose_through_its_shaft():
    """The load is held; where the shaft's torque comes near its friction, the noise in that torque moves it."""
    drive = two_mass().with_values({
        "motor.inertia": INERTIA, "load.inertia": INERTIA, "shaft.stiffness": 40.0, "shaft.damping": 0.02,
        "load.coulomb": COULOMB})
    found = plant("load_speed", drive)
    near, far = (filtered(found, np.full(400, t), np.zeros(400), 1e-4, 0.2).variance[-1, 0] for t in (0.9, 0.0))
    assert near > 1.5 * far


@pytest.mark.parametrize(("share", "moves"), [(0.9, 0), (1.1, 1)])
def test_what_friction_takes_back_in_a_moment_is_no_motion(share, moves):
    """A speed corrected from rest: below a tenth of the speed that friction stops in a sample no event is located.

    In both cases the body travels v^2 J / 2 Tc until it stops.
    """
    found, n = plant("motor_angle"), 4
    speed = share * RESTICK_FRACTION * COULOMB * STEP / INERTIA
    gain, y = np.zeros((n, 1, found.nx)), np.zeros((n, 1))
    gain[1, 0, 0], y[1] = speed, 1.0  # an error of one
    trace = Trace(np.zeros((n, 1)), y, STEP)
    _, states, events = found.simulate(trace, np.zeros(found.nx), ObserverGains(gain, np.ones((n, 1))), keep=True)
    assert events == moves
    assert states[2, 0] == 0.0
    # The event is exact, viscous friction included.
    assert states[2, 1] == pytest.approx(0.5 * speed**2 * INERTIA / COULOMB, rel=1e-3)
