"""What a fit leaves open: the strength of its torque noise, and its values inside their region."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from drivetool.check.validation.fit_confidence_region import CONFIDENCE_LEVEL, _step_in_region, ratio_interval
from drivetool.check.validation.free_run_validation import validate
from drivetool.check.validation.result import ValidateOptions
from drivetool.drive import one_body
from drivetool.identify.estimate import Covariance
from tests.recover import experiment

STEP, INERTIA, VISCOUS, SENSOR, SIZE = 2e-3, 0.02, 0.015, 0.01, 3000  # s, kg m^2, N m s/rad, rad/s, samples
NAMES = ("motor.inertia", "motor.viscous")


def test_the_interval_of_a_ratio():
    natural, count = 10.0, 2000
    for looks, (low, high) in {0.0: (0.0, 26.5), 400.0: (310.0, 517.0), 1e6: (0.995e6, 1.005e6)}.items():
        ends = np.array(ratio_interval(looks * natural / count, natural, count)) * count / natural
        assert ends == pytest.approx((low, high), rel=0.01, abs=0.01)


@pytest.mark.parametrize("size", [0.1, 1.0, 30.0])
def test_a_step_ends_at_the_minimum_or_on_the_edge_of_the_region(size):
    rng = np.random.default_rng(3)
    half = rng.standard_normal((3, 3))
    bend, slope = half @ half.T, size * rng.standard_normal(3)
    step = _step_in_region(bend, slope)
    free, limit = -np.linalg.solve(bend + np.eye(3), slope), chi2.ppf(CONFIDENCE_LEVEL, 3)
    if free @ free <= limit:
        assert step == pytest.approx(free)
        return
    assert step @ step == pytest.approx(limit, rel=1e-6)
    push = -(bend @ step + slope)  # what is left of the slope pushes outwards, square to the edge
    assert push == pytest.approx(step * (push @ step) / limit, rel=1e-6)


def record(ratio=0.0, seed=1, sensor=SENSOR):
    """A body under steps of torque, exact from sample to sample, with torque noise over SENSOR."""
    rng = np.random.default_rng(seed)
    torque = np.repeat(rng.uniform(-0.25, 0.25, SIZE // 100), 100)
    pushed, speed = torque + ratio * SENSOR * rng.standard_normal(SIZE), np.zeros(SIZE)
    keep = np.exp(-VISCOUS / INERTIA * STEP)
    for k in range(SIZE - 1):
        speed[k + 1] = keep * speed[k] + (1.0 - keep) / VISCOUS * pushed[k]
    return experiment(torque, speed + sensor * rng.standard_normal(SIZE), step=STEP)


def finding_of_record(e, off, std, ratio=0.0):
    """Validation of a drive whose values are off by so many of their (2,) standard deviations."""
    values = np.array([INERTIA, VISCOUS]) + np.array(off) * std
    drive = one_body().with_values(dict(zip(NAMES, values.tolist(), strict=True)))
    noise = {"sensor_std.motor_speed": SENSOR, "torque_std": ratio * SENSOR}
    return validate([e], [("m", drive, noise)], ValidateOptions(), known=[Covariance(NAMES, np.diag(std**2))])


@pytest.mark.parametrize("off", [(1.5, -1.0), (-1.0, -1.5), (0.5, 1.5)])
def test_values_within_their_intervals_raise_no_finding(off):
    std = np.array([0.02 * INERTIA, 0.03 * VISCOUS])
    found = finding_of_record(record(), off, std)
    assert found.checks[0].passed and found.checks[0].correlation_p > 0.01
    assert not [f for f in found.findings if f.code == "residual-depends-on-input"]
    # The free run is that of the values as they are.
    true = finding_of_record(record(), (0.0, 0.0), std)
    assert found.checks[0].simulation_fit_percent < true.checks[0].simulation_fit_percent


@pytest.mark.parametrize("off", [(15.0, 0.0), (0.0, -20.0)])
def test_values_that_are_off_by_far_more_are_seen(off):
    found = finding_of_record(record(), off, np.array([0.002 * INERTIA, 0.003 * VISCOUS]))
    assert not found.checks[0].passed and "limit-missed" in {f.code for f in found.findings}


def test_torque_noise_too_weak_for_the_fit_raises_no_finding():
    natural = INERTIA / STEP
    e = record(20.0 * natural / SIZE, seed=4)
    found = finding_of_record(e, (0.0, 0.0), np.array([1e-9, 1e-9])).checks[0]
    assert found.passed and found.correlation_p > 0.01 and found.whiteness_p > 1e-3


@pytest.mark.parametrize("single", [False, True])
def test_a_record_without_noise_is_explained_to_rounding(single):
    e = record(sensor=0.0)
    if single:
        speed = e.signals["motor_speed"].astype(np.float32).astype(float)
        e = replace(e, signals={**e.signals, "motor_speed": speed})
    found = finding_of_record(e, (0.0, 0.0), np.array([1e-9, 1e-9]))
    assert found.checks[0].passed and "the residual is at rounding level" in found.verdict
    assert [f.code for f in found.findings] == ["residual-not-testable"]
    off = finding_of_record(e, (1.0, 0.0), np.array([1e-4 * INERTIA, 1e-9]))
    assert "residual-not-testable" not in {f.code for f in off.findings} and "rounding level" not in off.verdict
