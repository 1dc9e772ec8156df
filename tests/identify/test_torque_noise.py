"""Torque noise as it is drawn, against the closed forms of its model."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz

from drivetool.drive import Layout, one_body
from drivetool.drive.simulation import Trace, plant_of
from drivetool.identify.noise.noise import Noise, with_torque_noise
from tests.recover import STEP

RATIO, SENSOR, INERTIA = 3.0, 0.5, 2.0
SIZE, DRAWS = 40, 6000
MODELS = pytest.mark.parametrize(("memory", "slow"), [
    (None, None), (0.9, None), (0.995, None), (0.9, 0.3), (0.5, 0.0), (0.995, 0.1)])


def covariance(memory, slow, size):
    """(size, size) of the torque over its variance per sample, by the sum over all that came before.

    White; sum of m^i w[k-i] sqrt(1 - m^2); w[k] - (1 - s) (1 - m) sum of m^i w[k-1-i].
    """
    m, lags = memory or 0.0, np.arange(size)
    if slow is None:
        return toeplitz(m**lags) if memory else np.eye(size)
    noise_gain = (slow - 1.0) * (1.0 - m)
    return toeplitz(noise_gain**2 / (1.0 - m**2) * m**lags
                    + np.where(lags > 0, noise_gain * m ** (lags - 1.0), 1.0))


@pytest.mark.slow
@MODELS
def test_torque_noise_and_its_motion_are_those_of_the_model_from_the_first_sample_on(memory, slow):
    """Torque, and the speed of a free body that sums it up: T R T' of both, all draws together."""
    rng, noise = np.random.default_rng(1), Noise(RATIO, memory, np.ones(1), slow=slow)
    drive = one_body().with_values({"motor.inertia": INERTIA})
    plant = plant_of(drive, Layout((), ("motor_torque",), ("motor_speed",), STEP, gradient=False))
    still = Trace(np.full((SIZE, 1), 7.0), np.zeros((SIZE, 1)), STEP)
    calm = plant.outputs(still, np.zeros(1))[:, 0]
    torque, speed = np.empty((2, DRAWS, SIZE))
    for k in range(DRAWS):
        made = with_torque_noise(still, noise, SENSOR, rng)
        torque[k], speed[k] = made.inputs[:, 0] - 7.0, plant.outputs(made, np.zeros(1))[:, 0] - calm
    assert np.all(still.inputs == 7.0)
    expected = (RATIO * SENSOR) ** 2 * covariance(memory, slow, SIZE)
    summed = STEP / INERTIA * np.tri(SIZE, k=-1)
    for drawn, wanted in ((torque, expected), (speed, summed @ expected @ summed.T)):
        found, std = drawn.T @ drawn / DRAWS, np.sqrt(np.diag(wanted))
        # An entry errs by sqrt(1 + r^2) sigma sigma / sqrt(DRAWS); five of these are exceeded by none of 1600.
        assert np.all(np.abs(found - wanted) <= 5.0 * np.sqrt(2.0 / DRAWS) * np.outer(std, std) + 1e-15)


@MODELS
def test_sums_over_many_time_constants_are_those_of_white_noise_of_the_level_at_frequency_zero(memory, slow):
    noise, size = Noise(RATIO, memory, np.ones(1), slow=slow), 1000
    still = Trace(np.zeros((400 * size, 1)), np.zeros((400 * size, 1)), STEP)
    drawn = with_torque_noise(still, noise, SENSOR, np.random.default_rng(2)).inputs[:, 0]
    sums = RATIO * SENSOR * np.sqrt(covariance(memory, slow, size).sum())
    assert np.std(drawn.reshape(-1, size).sum(axis=1)) == pytest.approx(sums, rel=0.12)
    if memory == 0.9:  # the ends of a sum, over which the noise is not made up for, count little
        level = np.sqrt(1.9 / 0.1) if slow is None else slow
        assert sums == pytest.approx(RATIO * SENSOR * np.sqrt(size) * level, rel=0.06)
