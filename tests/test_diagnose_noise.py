"""The noise model under which causes are judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.model import everything, fit, listened
from drivetool.identify.noise import Noise, fit_ratio
from drivetool.identify.setup import first_point, roles_of
from drivetool.identify.task import Task
from tests.recover import STEP, drive_like, experiment, resonance
from tests.simulator.experiments import multisine
from tests.simulator.machine import machine_by_seed
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

FREE = ("motor.inertia", "load.inertia", "motor.viscous", "load.viscous", "load.idle_torque", "shaft.stiffness",
        "shaft.damping")
MOTOR, LOAD = 1e-3, 4e-5  # noise of the speeds over the top speed


def two_sensors(seed):
    """A record with motor and load speed, and their noises."""
    machine, size = machine_by_seed(seed), 4000
    rated = machine.rated_torque
    torque = multisine(np.linspace(0.05, 2.0, 12) * resonance(machine), 0.1 * rated, size * STEP, STEP, seed)[:size]
    run = simulate_linear(machine, torque, STEP, None, white_noise(size, 0.002 * rated, 3 * seed))
    top = np.abs(run.speeds).max()
    motor, load = (run.speeds[:, k] + white_noise(size, share * top, 3 * seed + 1 + k)
                   for k, share in enumerate((MOTOR, LOAD)))
    return machine, experiment(torque, motor, load_speed=load)


def fitted(machine, record, guess):
    """The base as diagnose fits it, from a guess of the load sensor's noise over that of the motor's."""
    drive = drive_like(machine, list(FREE))
    task = Task(drive, FREE, roles_of([record], drive), (record,))
    assert task.roles.outputs == ("motor_speed", "load_speed")
    problem = task.problem()
    point = first_point(drive, problem, task.roles)
    noise = fit_ratio(problem, point, Noise(1.0, None, np.array([1.0, guess])))
    return fit("base", task, problem, point, noise, everything(problem), rounds=10)


@pytest.mark.parametrize("wrong", [0.05, 20.0])
@pytest.mark.parametrize("seed", [20, 23])
def test_sensor_noises_are_found_from_a_wrong_guess(seed, wrong):
    model = fitted(*two_sensors(seed), wrong * LOAD / MOTOR)
    # The std of a std over 4000 samples is a hundredth.
    assert model.noise.scale[1] == pytest.approx(LOAD / MOTOR, rel=0.05)


def test_only_what_counts_tells_how_loud_a_sensor_is():
    """The load sensor three times as loud over the second half."""
    machine, record = two_sensors(20)
    model = fitted(machine, record, LOAD / MOTOR)
    top = np.abs(record.signals["motor_speed"]).max()
    more = np.concatenate((np.zeros(2000), white_noise(2000, np.sqrt(8.0) * LOAD * top, 9)))
    louder = replace(record, signals={**record.signals, "load_speed": record.signals["load_speed"] + more})
    problem = replace(model.task, experiments=(louder,)).problem()
    early = np.arange(4000) < 2000
    quiet, loud = (listened(problem, model.point, model.noise, [mask]).scale[1] for mask in (early, ~early))
    assert quiet == pytest.approx(LOAD / MOTOR, rel=0.1)
    assert loud == pytest.approx(3.0 * quiet, rel=0.2)
