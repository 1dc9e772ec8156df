"""Which samples a fold is fitted to and judged by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.folds import blocks_of
from drivetool.check.samples import fitted_samples, samples_of
from drivetool.drive.linearise import resonances
from drivetool.identify.setup import roles_of
from drivetool.identify.task import Task
from tests.recover import STEP, drive_like, experiment
from tests.simulator.experiments import multisine
from tests.simulator.machine import machine_by_seed
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

FREE = ("motor.inertia", "load.inertia", "total.viscous", "total.idle_torque", "shaft.stiffness", "shaft.damping")
SLOW = 3.0  # Hz


def slow_record(seed, size=9000):
    """A soft drive, its record from the middle of a motion, the drive like it."""
    machine = machine_by_seed(seed)
    motor, load = machine.inertia
    stiffness = (2.0 * np.pi * SLOW) ** 2 * motor * load / (motor + load)
    machine = replace(machine, stiffness=(stiffness,), damping=(0.02 * stiffness / (2.0 * np.pi * SLOW),))
    rated = machine.rated_torque
    torque = multisine(np.linspace(0.3, 2.0, 8) * SLOW, 0.1 * rated, 2 * size * STEP, STEP, seed)[:2 * size]
    run = simulate_linear(machine, torque, STEP, None, white_noise(2 * size, 1e-4 * rated, 3 * seed))
    speed = run.speeds[size:, 0] + white_noise(size, 0.01 * np.abs(run.speeds).max(), 3 * seed + 1)
    return experiment(torque[size:], speed), drive_like(machine, list(FREE))


@pytest.mark.parametrize("held_out", [False, True])
def test_samples_that_judge_are_none_that_were_fitted_to(held_out):
    record, drive = slow_record(20)
    other, _ = slow_record(21)
    task = Task(drive, FREE, roles_of([record, other], drive), (record, other))
    traces = task.problem().traces
    folds = samples_of(traces, [record] if held_out else [record, other], [other] if held_out else [], drive)
    assert len(folds) == (1 if held_out else 2)
    for fold in folds:
        for t, train, test, again in zip(traces, *fold, strict=True):
            assert not np.any(train & test) and np.all(train | test)
            told = train & again
            # What tells the start state: two periods of the slowest mode, at most half a block.
            slowest, (_, a, b) = min(mode.frequency_hz for mode in resonances(drive)), blocks_of(traces)[0]
            assert told.sum() == pytest.approx(min(2.0 / slowest / t.step, 0.5 * (b - a)), abs=1)
            assert told[:told.sum()].all() and np.all(again == (test | told))
    if not held_out:
        assert all(np.all(mask) for mask in fitted_samples(folds))
