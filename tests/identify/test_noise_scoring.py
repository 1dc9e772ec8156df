"""Noise parameters by scoring, compared with likelihoods whose optimum is a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.check.fit import all_samples, masked_loss
from drivetool.drive.simulation import Filtered, ObserverGains
from drivetool.identify.noise.noise import Noise, filtered, minus_log_likelihood
from drivetool.identify.noise.noise_scoring import likelihood_of_passes, minimise_by_scoring
from drivetool.identify.setup.setup import first_point, roles_of
from drivetool.identify.setup.task import Task
from tests.recover import drive_like, linear_record
from tests.simulator.machine import machine_by_seed

SIZE = 2000
BOUND = np.array([9.0])


def passes(innovations, variance):
    return [Filtered(ObserverGains(np.empty((0, 1, 0)), np.empty((0, 1))), innovations, variance, np.empty((0, 0)))]


def profiled(found):
    """-log likelihood of Gaussian innovations, one variance of all profiled out."""
    return 0.5 * len(found.innovations) * np.log(np.mean(found.innovations**2 / found.variance)) + 0.5 * np.sum(
        np.log(found.variance))


def two_sensors(true, calls=None, share=None):
    """A likelihood of two sensors, the second with e^true times the noise of the first; that log is estimated."""
    rng = np.random.default_rng(5)
    e = rng.standard_normal((SIZE, 2)) * np.array([0.3, 0.3 * np.exp(true)])
    counted = e.copy() if share is None else e[np.arange(SIZE) < share * SIZE]
    e[len(counted):] = np.nan

    def listen(figures):
        if calls is not None:
            calls.append(figures.copy())
        v = np.broadcast_to(np.array([1.0, np.exp(2.0 * figures[0])]), e.shape)
        found = likelihood_of_passes(0.0, passes(e, v))
        return type(found)(float(profiled(found)), found.innovations, found.variance)

    return listen, 0.5 * np.log(np.mean(counted[:, 1] ** 2) / np.mean(counted[:, 0] ** 2))


@pytest.mark.parametrize("share", [None, 0.5])
@pytest.mark.parametrize("start", [-1.0, 0.0, 2.5, 4.0])
def test_the_likeliest_noise_ratio_is_reached(start, share):
    listen, best = two_sensors(1.2, share=share)
    found, value = minimise_by_scoring(listen, np.array([start]), -BOUND, BOUND)
    assert found[0] == pytest.approx(best, abs=2e-3)  # its standard error is 0.016
    assert value == pytest.approx(listen(np.array([best])).value, abs=5e-3)


def test_it_takes_a_handful_of_passes():
    calls = []
    listen, best = two_sensors(1.2, calls)
    minimise_by_scoring(listen, np.array([best + 0.5]), -BOUND, BOUND)
    assert len(calls) <= 8
    calls.clear()
    minimise_by_scoring(listen, np.array([best]), -BOUND, BOUND)
    assert len(calls) == 2  # where it is, and the slope


def test_a_noise_parameter_on_its_bound_stays_there_and_the_others_go_on():
    listen, best = two_sensors(1.2)

    def both(figures):
        one = listen(figures[1:])
        return type(one)(one.value + figures[0], one.innovations, one.variance)  # less is always better

    found, _ = minimise_by_scoring(both, np.array([-2.0, 0.0]), np.array([-2.0, -9.0]), np.array([2.0, 9.0]))
    assert found[0] == -2.0
    assert found[1] == pytest.approx(best, abs=2e-3)


def test_an_unidentifiable_noise_parameter_is_unchanged():
    listen, _ = two_sensors(0.0)

    def deaf(figures):
        one = listen(figures)
        return type(one)(np.inf, one.innovations, one.variance)

    found, value = minimise_by_scoring(deaf, np.array([0.7]), -BOUND, BOUND)
    assert found[0] == 0.7
    assert value == np.inf


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_a_filter_that_diverges_beside_the_start_moves_nothing(lost):
    """A diverging filter may leave as many innovations, or fewer."""
    listen, _ = two_sensors(1.2)

    def fragile(figures):
        one = listen(figures)
        if figures[0] == 0.5:
            return one
        return type(one)(np.inf, np.where(np.arange(one.innovations.size) > 9, one.innovations, lost), one.variance)

    def fewer(figures):
        one = fragile(figures)
        known = np.isfinite(one.innovations)
        return type(one)(one.value, one.innovations[known], one.variance[known])

    for each in (fragile, fewer):
        found, value = minimise_by_scoring(each, np.array([0.5]), -BOUND, BOUND)
        assert found[0] == 0.5
        assert value == listen(found).value


def test_a_filter_that_diverges_after_a_few_samples_explains_none_of_the_rest():
    """NaN means a missing value: taken so, two diverged samples of 2000 would cost next to nothing."""
    machine = machine_by_seed(2)
    record = linear_record(machine, 3, 2.0)
    free = ["motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping"]
    drive = drive_like(machine, free).with_values({
        "load.inertia": 1e-12, "shaft.stiffness": 1e-9, "shaft.damping": 0.0, "shaft.hardening": -0.03,
        "shaft.hardening_twist": 1e-3, "shaft.hardening_power": 2.0})
    task = Task(drive, tuple(free), roles_of([record], drive), (record,))
    problem = task.problem()
    point, noise = first_point(drive, problem, task.roles), Noise(1.0, None, problem.scale)
    assert minus_log_likelihood(filtered(problem, point, noise)) == np.inf
    assert masked_loss(problem, point, noise, all_samples(problem)) == np.inf
