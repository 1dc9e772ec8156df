"""A given Coulomb friction is fitted where a record contradicts it, though the drive never turns back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import reverses
from tests.recover import STEP, drive_like, experiment, truth
from tests.simulator.machine import Machine, at_rest, machine_by_seed, running
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate

SIZE = 6000


def dry(seed: int) -> Machine:
    machine = machine_by_seed(seed)
    return replace(machine, coulomb=(0.05 * machine.rated_torque, 0.0), idle_torque=(0.0, 0.0))


def record(machine: Machine, torque: np.ndarray, start, seed: int):
    """A record under torque noise, the sensor noise a thousandth of the top speed."""
    run = simulate(machine, torque, STEP, start, None, white_noise(len(torque), 0.002 * machine.rated_torque, seed))
    speed = run.speeds[:, 0]
    return experiment(torque, speed + white_noise(len(speed), 1e-3 * np.abs(speed).max(), seed + 1)), run


def fit_of(machine: Machine, given: float, one, hold=()):
    """The line of the Coulomb friction, and that of its sum with the idle torque where there is one."""
    values = truth(machine)
    drive = drive_like(machine, ["motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping"], 0.1, 3)
    drive = drive.with_values({"motor.coulomb": given, "total.viscous": values["total.viscous"],
                               "total.idle_torque": 0.0})
    estimate = greybox([one], drive, Options(hold=hold))
    return estimate.line("motor.coulomb"), next(iter(estimate.ratios), None)


def pushes(machine: Machine, back: float) -> np.ndarray:
    """Torque of pushes, each followed by coasting to a stop and a short pull back (share of the rated torque)."""
    parts = [np.r_[np.full(300, share), np.zeros(860), np.full(40, -back), np.zeros(300)]
             for share in (0.15, 0.25, 0.2, 0.3)]
    return machine.rated_torque * np.concatenate(parts)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, pytest.param(9, marks=pytest.mark.long)])
def test_it_is_fitted_where_the_drive_hardly_turns_back(seed):
    machine = dry(seed)
    one, run = record(machine, pushes(machine, 0.08), at_rest(machine), seed)
    assert not reverses([one]) and run.speeds[:, 0].min() < 0.0
    true = machine.coulomb[0]
    line, total = fit_of(machine, 0.8 * true, one)
    assert total is None and line.status == "fitted" and abs(line.value - true) < min(4.0 * line.std, 0.05 * true)
    held, _ = fit_of(machine, 0.8 * true, one, hold=("motor.coulomb",))
    assert held.status == "held" and held.value == 0.8 * true


@pytest.mark.slow
def test_of_a_drive_that_stops_but_never_turns_back_the_sum_is_found():
    # In one direction friction and idle torque add up; that it stands says only that the one outweighs the other.
    machine = dry(4)
    one, run = record(machine, pushes(machine, 0.0), at_rest(machine), 4)
    assert run.speeds[:, 0].min() > -1e-3 * run.speeds[:, 0].max() and np.mean(run.stuck[:, 0]) > 0.02
    line, total = fit_of(machine, 0.8 * machine.coulomb[0], one)
    assert line.status == "not-identifiable" and abs(total.value - machine.coulomb[0]) < 4.0 * total.std


@pytest.mark.slow
def test_a_drive_that_never_stops_keeps_what_was_given():
    machine = dry(4)
    rng = np.random.default_rng(1)
    start = running(machine, 30.0)
    torque = start.torque + 0.05 * machine.rated_torque * np.repeat(rng.choice([-1.0, 1.0], SIZE // 100), 100)
    one, run = record(machine, torque, start, 5)
    assert run.speeds[:, 0].min() > 0.0
    # What that value lacks is in the idle torque: neither has an interval, their sum has one, whatever was given.
    for given in (0.8 * machine.coulomb[0], 0.0):
        line, total = fit_of(machine, given, one)
        assert (line.value, line.status) == (given, "not-identifiable")
        assert total.name == "total.idle_torque + motor.coulomb"
        assert abs(total.value - machine.coulomb[0]) < 4.0 * total.std < 0.2 * machine.coulomb[0]
