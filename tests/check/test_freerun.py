"""The free run that torque noise allows, against a closed form."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.validation import CheckSection
from drivetool.check.validation.freerun import noise_limit_findings
from drivetool.check.validation.replay import replay
from drivetool.drive import one_body
from tests.recover import STEP, experiment

SIZE, PART, INERTIA, TORQUE, SENSOR = 12_000, 100, 2.0, 120.0, 0.01  # samples, samples, kg m^2, Nm, rad/s


@pytest.mark.slow
@pytest.mark.parametrize("time", [0.0, 0.02, 0.5])
def test_attainable_fit_of_short_free_runs(time):
    """A free body sums its torque up: its error after k samples is (h / J)^2 times the sum of all covariances."""
    t = STEP * np.arange(SIZE)
    torque = 400.0 * np.cos(2.0 * np.pi * 5.0 * t)
    clean = np.concatenate(([0.0], np.cumsum(torque)[:-1])) * STEP / INERTIA
    record = experiment(torque, clean + SENSOR * np.random.default_rng(1).standard_normal(SIZE))
    drive = one_body().with_values({"motor.inertia": INERTIA})
    noise = {"sensor_std.motor_speed": SENSOR, "torque_std": TORQUE, "torque_correlation_time": time}
    run = replace(replay(record, drive, noise, PART * STEP), sigma=SENSOR)  # the record has no torque noise
    lags = np.abs(np.subtract.outer(np.arange(PART), np.arange(PART)))
    summed = np.tri(PART, k=-1)
    each = np.exp(-lags * STEP / time) if time else np.eye(PART)
    error = (TORQUE * STEP / INERTIA) ** 2 * np.trace(summed @ each @ summed.T) / PART + SENSOR**2
    expected = 100.0 * (1.0 - np.sqrt(error / (error + np.var(clean))))
    check = CheckSection("m", "r", "motor_speed", "rad/s", expected, None, 0.0, 0.0, 0.0, SIZE, 0.0, 0.1, 0.0, 0.5,
                        None, True)
    found, = noise_limit_findings(run, check, 0.15, 1)
    # 120 pieces say the rms of an error to about 7 %, the median of 20 draws of it to 2 %.
    assert 100.0 - found.evidence["attainable_fit_median"] == pytest.approx(100.0 - expected, rel=0.08)
