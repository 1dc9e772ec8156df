"""Intervals where sensor noise hides the torque noise: its strength is averaged over, not taken as zero."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import binom, norm

from drivetool.drive import one_body
from drivetool.identify.estimate.interval_and_status import Z95, covariance_of
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.outcome.noise_ratio_uncertainty import noise_ratio_covariance
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from tests.recover import experiment

STEP, INERTIA, IDLE, SIZE = 0.01, 2.0, 0.5, 400  # s, kg m^2, N m, samples
NATURAL = INERTIA / STEP  # torque noise, over the sensor's, that moves the speed by the sensor's in one sample


def coasting(seed, ratio, sensor=0.02):
    """A body under constant torque and idle torque, with white torque noise and white noise of its speed."""
    rng = np.random.default_rng(seed)
    torque = np.full(SIZE, 1.0)
    push = torque - IDLE + ratio * sensor * rng.standard_normal(SIZE)
    speed = 3.0 + STEP / INERTIA * np.concatenate(([0.0], np.cumsum(push)[:-1]))
    return experiment(torque, speed + sensor * rng.standard_normal(SIZE), step=STEP)


def fitted(record):
    drive = one_body().with_values({"motor.inertia": INERTIA, "motor.viscous": 0.0, "motor.idle_torque": 0.4})
    task = Task(drive, ("motor.idle_torque",), roles_of([record], drive), (record,))
    return by_innovations(task, [{}])


def by_dense_algebra(record, estimate, most=0.3, count=400):
    """Square of the standard error of which 1.96 to either side hold 95 %, over evenly spaced ratios from zero.

    Generalised least squares on the whole covariance matrix of the record, no filter.
    """
    speed = record.signals["motor_speed"] - STEP / INERTIA * np.arange(SIZE)  # less what a torque of one does
    design = np.column_stack([-STEP / INERTIA * np.arange(SIZE), np.ones(SIZE)])
    walk = np.tril(np.ones((SIZE, SIZE)), -1)
    squares, vectors = np.linalg.eigh(walk @ walk.T)
    y, x, degrees = vectors.T @ speed, vectors.T @ design, SIZE - 2
    values, centres, spreads = [], [], []
    for share in np.linspace(0.0, most, count):
        white = 1.0 + share**2 * squares
        normal = x.T @ (x / white[:, None])
        best = np.linalg.solve(normal, x.T @ (y / white))
        left = np.sum((y - x @ best) ** 2 / white) / degrees
        values.append(-0.5 * (degrees * np.log(left) + np.sum(np.log(white)) + np.linalg.slogdet(normal)[1]))
        centres.append(best[0] - estimate)
        spreads.append(np.sqrt(left * np.linalg.inv(normal)[0, 0]))
    weights = np.exp(np.array(values) - max(values))
    assert weights[-1] < 1e-3

    def missed(end):
        return np.average(norm.cdf(-end, centres, spreads) + norm.sf(end, centres, spreads), weights=weights) - 0.05

    return float((brentq(missed, 0.0, 20.0 * max(spreads)) / Z95) ** 2)


def mean_square(outcome):
    """(by the covariance of the fit alone, with the uncertainty of the noise)."""
    own, _, _ = covariance_of(outcome.problem, outcome.solution)
    extra = noise_ratio_covariance(outcome.problem, outcome.fit)
    return own[0, 0], own[0, 0] + (0.0 if extra is None else extra[0, 0])


@pytest.mark.parametrize("seed", [1, 2, 5, 9])
def test_the_interval_is_that_of_dense_algebra(seed):
    # The ratio is taken in doublings, which is good to a tenth of its square.
    record = coasting(seed, 0.03 * NATURAL)
    outcome = fitted(record)
    dense = by_dense_algebra(record, outcome.solution.point.values[0])
    assert mean_square(outcome)[1] == pytest.approx(dense, rel=0.1)


def test_a_strong_torque_noise_adds_no_uncertainty():
    outcome = fitted(coasting(3, 3.0 * NATURAL))
    assert noise_ratio_covariance(outcome.problem, outcome.fit) is None


@pytest.mark.slow
def test_intervals_hold_where_the_likeliest_torque_noise_is_often_none():
    count, errors, squares = 120, [], []
    for seed in range(count):
        outcome = fitted(coasting(100 + seed, 0.02 * NATURAL))
        errors.append(outcome.solution.point.values[0] - IDLE)
        squares.append(mean_square(outcome))
    alone, averaged = (np.sum(np.abs(errors) < Z95 * np.sqrt(s)) for s in np.transpose(squares))
    least = binom.ppf(1e-3, count, 0.95)
    assert averaged >= least > alone


def test_greybox_states_the_averaged_interval():
    record = coasting(104, 0.02 * NATURAL)
    drive = one_body().with_values({"motor.inertia": INERTIA, "motor.viscous": 0.0, "motor.idle_torque": 0.4})
    (line,) = greybox([record], drive, Options(
        hold=("motor.inertia", "motor.viscous"), free=("motor.idle_torque",))).ratios  # with Coulomb friction
    alone, averaged = mean_square(fitted(record))
    assert line.std == pytest.approx(np.sqrt(averaged), rel=1e-3)
    assert averaged > 1.2 * alone
