"""A weakly excited resonance, from starts beside it: the fit ends at the optimum near the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.noise.innovations import fit_innovations
from drivetool.identify.setup.setup import first_point, roles_of
from drivetool.identify.setup.task import Task
from tests.recover import STEP, drive_like, experiment, truth
from tests.simulator.experiments import multisine, steps
from tests.simulator.machine import machine_by_seed, running
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

FREE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "total.viscous", "total.idle_torque")


def weak(machine, size, draw, torque_noise, excitation):
    """Steps of torque and a multisine whose lines move the speed by `excitation` times its noise."""
    rated, start = machine.rated_torque, running(machine, 20.0)
    torque = steps(start.torque, [0.15 * rated] * (size // 500), (0.4, 0.6), 0.4, STEP, 1)[:size]
    torque = torque + multisine(np.arange(3.0, 33.0, 3.0), 0.015 * rated, size * STEP, STEP, 2)[:size]
    run = simulate_linear(machine, torque, STEP, start, white_noise(size, torque_noise * rated, draw))
    moved = 0.015 * rated / (sum(machine.inertia) * 2.0 * np.pi * 15.0)
    return experiment(torque, run.speeds[:, 0] + white_noise(size, moved / excitation, draw + 1))


# machine, samples, excitation of the resonance, offset of the start and its signs, torque noise
@pytest.mark.slow
@pytest.mark.parametrize(("seed", "size", "excitation", "off", "signs", "torque_noise"), [
    (2, 4000, 0.3, 0.15, 4, 0.003), (3, 4000, 0.3, 0.15, 3, 0.0), (3, 4000, 0.3, 0.4, 4, 0.003),
    (10, 4000, 0.3, 0.15, 4, 0.003), (2, 10_000, 0.5, 0.15, 3, 0.0), (4, 10_000, 0.5, 0.15, 4, 0.003),
    (9, 10_000, 0.5, 0.15, 4, 0.0)])
def test_a_weak_resonance_is_found_from_beside_it(seed, size, excitation, off, signs, torque_noise):
    machine = machine_by_seed(seed)
    machine = replace(machine, viscous=tuple(0.3 * j / sum(machine.inertia) for j in machine.inertia))
    record, values = weak(machine, size, 777 + 2 * (signs - 3), torque_noise, excitation), truth(machine)
    drive = drive_like(machine, list(FREE), off, signs)
    task = Task(drive, FREE, roles_of([record], drive), (record,))
    problem, outcome = task.problem(), by_innovations(task, [{}])
    from_truth = fit_innovations(problem, first_point(drive.with_values(
        {n: values[n] for n in FREE}), problem, task.roles))
    assert outcome.converged
    assert outcome.fit.value < from_truth.value + 2.0
