"""The strength of the torque noise, near none and where there is none at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.identify.estimate.rounding import only_rounding, relative_resolution
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.noise.innovations import fit_innovations, refit_with_tight_tolerance
from drivetool.identify.noise.noise import likelier_ratio
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from drivetool.logs import UNIT_TABLE
from tests.recover import experiment

STEP, INERTIA, VISCOUS, SIZE = 2e-3, 0.02, 0.015, 2000  # s, kg m^2, N m s/rad, samples
NATURAL = INERTIA / STEP  # torque noise, over the sensor's, that moves the speed by the sensor's in one sample
FREE = ("motor.inertia", "motor.viscous")


def record(ratio=0.0, sensor=0.0, drag=0.0, seed=1):
    """A body under steps of torque, exact from sample to sample; drag [N m s^2/rad^2] is what a fit lacks."""
    rng = np.random.default_rng(seed)
    torque = np.repeat(rng.uniform(-0.25, 0.25, SIZE // 100), 100)
    pushed, speed = torque + ratio * sensor * rng.standard_normal(SIZE), np.zeros(SIZE)
    keep = np.exp(-VISCOUS / INERTIA * STEP)
    for k in range(SIZE - 1):
        push = pushed[k] - drag * speed[k] * abs(speed[k])
        speed[k + 1] = keep * speed[k] + (1.0 - keep) / VISCOUS * push
    return experiment(torque, speed + sensor * rng.standard_normal(SIZE), step=STEP)


def started():
    return one_body().with_values({"motor.inertia": 0.01, "motor.viscous": 0.01})


def task_of(e):
    return Task(started(), FREE, roles_of([e], started()), (e,))


@pytest.mark.parametrize("ratio", [0.1, 1.0])
def test_a_fit_started_without_torque_noise_finds_it(ratio):
    """Far below the sensor's the likelihood is flat: from there a search near the last ratio leads nowhere."""
    outcome = by_innovations(task_of(record(ratio * NATURAL, 0.01)), [{}])
    problem, point = outcome.problem, outcome.fit.point
    none = replace(outcome.fit.noise, ratio=1e-6 * NATURAL)
    initial = fit_innovations(problem, point, none, near_optimum=True)
    assert initial.noise.ratio < 1e-3 * NATURAL
    found = refit_with_tight_tolerance(problem, initial)
    assert found.noise.ratio == pytest.approx(outcome.fit.noise.ratio, rel=0.1) == pytest.approx(
        ratio * NATURAL, rel=0.3)
    assert found.point.values == pytest.approx(point.values, rel=1e-3)


def test_a_ratio_that_is_the_likeliest_is_left_as_it_is():
    for ratio in (0.0, 1.0):
        outcome = by_innovations(task_of(record(ratio * NATURAL, 0.01)), [{}])
        assert likelier_ratio(outcome.problem, outcome.fit.point, outcome.fit.noise) is None


@pytest.mark.parametrize("single", [False, True])
def test_a_record_without_noise_gives_exact_values_and_no_uncertainty(single):
    e = record()
    if single:
        speed = e.signals["motor_speed"].astype(np.float32).astype(float)
        e = replace(e, signals={**e.signals, "motor_speed": speed})
    found = greybox([e], started(), Options(criterion="innovations"))
    values = [found.drive.values[n] for n in FREE]
    assert values == pytest.approx([INERTIA, VISCOUS], rel=1e-6 if single else 1e-9)
    codes = {f.code for f in found.findings}
    assert "residual-not-testable" in codes and "innovations-correlated" not in codes


def test_a_law_that_is_missing_in_a_record_without_noise_is_no_rounding():
    found = greybox([record(drag=1e-6)], started(), Options(criterion="innovations"))
    codes = {f.code for f in found.findings}
    assert "residual-not-testable" not in codes and "innovations-correlated" in codes


@pytest.mark.parametrize("unit", ["rad/s", "rpm", "deg/s", "km/h", "mNm", "rev/s"])
def test_single_precision_is_known_behind_a_conversion(unit):
    factor = UNIT_TABLE[unit][2]
    logged = (1e3 * np.cos(np.linspace(0.0, 20.0, 4000))).astype(np.float32).astype(float)
    logged[100] = np.nan
    assert relative_resolution(logged * factor) == np.finfo(np.float32).eps
    assert relative_resolution(np.nextafter(logged * factor, np.inf)) == np.finfo(float).eps


def test_a_speed_in_single_rpm_is_explained_to_rounding():
    time, factor = np.linspace(0.0, 20.0, 4000), UNIT_TABLE["rpm"][2]
    fine = 40.0 * np.cos(time)
    logged = (fine / factor).astype(np.float32).astype(float) * factor
    assert only_rounding(logged, fine, np.sin(3.0 * time)[:, None])


def test_what_rounding_may_leave_is_of_the_digits_of_the_record():
    time = np.linspace(0.0, 20.0, 4000)
    torque, fine = np.sin(3.0 * time)[:, None], 40.0 * np.cos(time)
    coarse = fine.astype(np.float32).astype(float)
    assert only_rounding(coarse, fine, torque)
    assert not only_rounding(fine, coarse, torque)  # measured to the last digit of doubles, and off by far more
    assert not only_rounding(coarse, fine + 1e-5 * np.sin(time), torque)
    assert only_rounding(np.where(time < 3.0, np.nan, coarse), fine, torque)

