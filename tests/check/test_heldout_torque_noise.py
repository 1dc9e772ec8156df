"""The torque noise of records held out, of which a fit has left none in its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.fit.model import all_samples, fit_from_start, masked_loss, over_traces, with_likeliest_noise
from drivetool.check.fit.residual_tests import run_residual_tests
from drivetool.check.heldout.between_records import change_between, share_beyond
from drivetool.check.heldout.samples import split_of
from drivetool.check.heldout.scores import Fold, over_all_records
from drivetool.identify.setup import Task, roles_of
from tests.recover import drive_like, linear_record
from tests.simulator.machine import machine_by_seed

FREE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "motor.viscous", "load.idle_torque")


@pytest.fixture(scope="module")
def absorbed():
    """(a base whose parameters have absorbed the torque noise of the first of two records, the split of both)."""
    machine = machine_by_seed(4)
    first, second = (linear_record(machine, seed, 6.0, 0.0015) for seed in (4, 1004))
    drive = drive_like(machine, list(FREE))
    task = Task(drive, FREE, roles_of([first], drive), (first,))
    split = split_of((first, second), 1, drive, task.roles)
    base = fit_from_start(task)
    return over_all_records(replace(base, noise=replace(base.noise, ratio=1e-3)), split), split


def test_the_noise_of_a_record_held_out_is_found_on_it(absorbed):
    base, _ = absorbed
    machine = machine_by_seed(4)
    held = over_traces(base, [1])
    found = with_likeliest_noise(held, all_samples(held.problem))
    true = 0.0015 / 0.002 * 4.0 * sum(machine.inertia)  # std over the rated torque, over that of the sensor
    assert found.noise.ratio == pytest.approx(true, rel=0.5)
    assert found.value < masked_loss(held.problem, held.point, held.noise, all_samples(held.problem)) - 25.0


def test_a_right_drive_leaves_nothing_of_it(absorbed):
    base, split = absorbed
    assert run_residual_tests(base).total > 25.0 and run_residual_tests(base, split.held).total == 0.0


def test_a_right_drive_keeps_its_values(absorbed):
    base, split = absorbed
    (one,) = split.folds
    assert change_between(base, [Fold(one.train, one.test, one.again, base, 0.0)]) is None


def test_halves_of_records_hold_none_out(absorbed):
    base, split = absorbed
    assert split_of(split.experiments, 2, base.task.drive, base.task.roles).held == []
    assert np.isfinite(run_residual_tests(base, []).total)


@pytest.mark.parametrize("factor, share", [(1e9, 1.0), (1.0, 0.5), (1.0 / 3.0, 0.25), (0.0, 0.0)])
def test_what_the_fit_left_open_counts_as_much_as_its_covariance(factor, share):
    """Two estimates of one value: half their squared difference over the sum of both variances."""
    covariance = np.diag([4.0, 0.25])
    assert share_beyond(np.array([0.3, -2.0]), covariance, factor * covariance) == pytest.approx(share, abs=1e-8)
    assert share_beyond(np.zeros(2), covariance, np.eye(2)) == 0.0


@pytest.mark.parametrize("correlation", [0.0, 1.0 - 1e-10, 1.0])
def test_a_direction_that_the_fit_did_not_identify_may_have_any_value(correlation):
    """The training records identify the sum of two values, the held-out record their difference."""
    before = np.array([[1.0, correlation], [correlation, 1.0]])
    change = np.array([1.0, -1.0])
    share = share_beyond(change, 100.0 * np.outer(change, change), before)
    assert share == pytest.approx((1.0 - correlation) / (1.0 - correlation + 200.0), abs=1e-9)


def test_the_gain_beyond_is_that_of_one_value_for_both_records():
    """Values of their own over the best common ones, by two quadratic forms."""
    rng = np.random.default_rng(3)
    a, b = (m @ m.T for m in rng.standard_normal((2, 3, 3)))
    change = rng.standard_normal(3)
    common = np.linalg.solve(a + b, b @ change)  # of the first's values, which are zero
    cost = 0.5 * common @ a @ common + 0.5 * (change - common) @ b @ (change - common)
    whole = 0.5 * change @ b @ change
    assert share_beyond(change, b, a) * whole == pytest.approx(cost)
