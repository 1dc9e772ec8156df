"""Training and test samples of a fold, and the initial transients of held-out records."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from drivetool.check import full_diagnosis as diagnosing
from drivetool.check.fit.model import fit_from_start
from drivetool.check.heldout import between_records
from drivetool.check.heldout.folds import blocks_of
from drivetool.check.heldout.samples import split_of
from drivetool.check.heldout.scores import Fold, over_all_records, train_on
from drivetool.check.outcome.diagnosis import DiagnoseOptions
from drivetool.drive import resonances
from drivetool.errors import NotEnoughData
from drivetool.identify.setup import Task, roles_of
from tests.recover import STEP, drive_like, experiment
from tests.simulator.experiments import multisine
from tests.simulator.machine import machine_by_seed
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

FREE = ("motor.inertia", "load.inertia", "total.viscous", "total.idle_torque", "shaft.stiffness", "shaft.damping")
SLOW = 3.0  # Hz


def slow_record(seed, size=9000):
    """A soft drive: its record from the middle of a motion, the drive like it, its states there, its noise."""
    machine = machine_by_seed(seed)
    motor, load = machine.inertia
    stiffness = (2.0 * np.pi * SLOW) ** 2 * motor * load / (motor + load)
    machine = replace(machine, stiffness=(stiffness,), damping=(0.02 * stiffness / (2.0 * np.pi * SLOW),))
    rated = machine.rated_torque
    torque = multisine(np.linspace(0.3, 2.0, 8) * SLOW, 0.1 * rated, 2 * size * STEP, STEP, seed)[:2 * size]
    run = simulate_linear(machine, torque, STEP, None, white_noise(2 * size, 1e-4 * rated, 3 * seed))
    noise = 0.01 * np.abs(run.speeds).max()
    speed = run.speeds[size:, 0] + white_noise(size, noise, 3 * seed + 1)
    start = {"motor.speed": run.speeds[size, 0], "load.speed": run.speeds[size, 1],
             "shaft.twist": run.angles[size, 0] - run.angles[size, 1]}
    return experiment(torque[size:], speed), drive_like(machine, list(FREE)), start, noise


@pytest.mark.parametrize("held_out", [False, True])
def test_test_samples_are_not_training_samples(held_out):
    record, drive, *_ = slow_record(20)
    other, *_ = slow_record(21)
    records = (record, other)
    split = split_of(records, 1 if held_out else 2, drive, roles_of(records, drive))
    assert (split.held_out, split.fitted, len(split.folds)) == ((True, 1, 1) if held_out else (False, 2, 2))
    for fold in split.folds:
        for t, train, test, again in zip(split.traces, fold.train, fold.test, fold.again, strict=True):
            assert not np.any(train & test) and np.all(train | test)
            transient = train & again
            # The initial transient: two periods of the slowest mode, at most half a block.
            slowest, (_, a, b) = min(mode.frequency_hz for mode in resonances(drive)), blocks_of(split.traces)[0]
            assert transient.sum() == pytest.approx(min(2.0 / slowest / t.step, 0.5 * (b - a)), abs=1)
            assert transient[:transient.sum()].all() and np.all(again == (test | transient))
    if held_out:
        assert [bool(mask.any()) for mask in split.held] == [False, True] and split.held[1].all()
        assert split.heads == (int((split.folds[0].train[1]).sum()),)
    else:
        assert split.held == [] and split.heads == ()
        assert all(np.all(one | other) for one, other in zip(*(fold.train for fold in split.folds), strict=True))


@pytest.mark.parametrize(("size", "enough"), [(600, False), (3000, True)])
def test_a_record_of_its_initial_transient_only_has_no_test_block(monkeypatch, size, enough):
    """Without a test block there is no free run."""
    (record, drive, *_), (other, *_) = slow_record(20), slow_record(21, size)
    reached = []
    monkeypatch.setattr(diagnosing, "base_and_alternatives", lambda *_: reached.append(True) or sys.exit())
    with pytest.raises(SystemExit if enough else NotEnoughData, match=None if enough else "initial transients"):
        diagnosing.diagnose((record,), drive, FREE, DiagnoseOptions(candidates=("coulomb-motor",)), (other,))
    assert bool(reached) == enough


@pytest.fixture(scope="module")
def held():
    """(a base of one record, its split, the states at which the record held out begins, the sensor's noise)."""
    (record, drive, *_), (other, _, start, noise) = slow_record(20), slow_record(20, 8000)
    roles = roles_of([record], drive)
    base = fit_from_start(Task(drive, FREE, roles, (record,)))
    return base, split_of((record, other), 1, drive, roles), start, noise


def test_a_record_held_out_begins_where_its_own_beginning_says(held):
    """To the error that whole periods of its slowest mode leave: mean, cosine and sine, without damping."""
    base, split, start, noise = held
    whole = over_all_records(base, split)
    assert np.array_equal(whole.point.values, base.point.values) and whole.noise == base.noise
    assert np.array_equal(whole.point.starts[0], base.point.starts[0])
    assert whole.task.experiments == split.experiments
    motor, load = (base.fitted.drive.value(f"{body}.inertia") for body in ("motor", "load"))
    std = {"motor.speed": np.sqrt(3.0), "load.speed": np.hypot(1.0, np.sqrt(2.0) * motor / load),
           "shaft.twist": np.sqrt(2.0) * (motor + load) / load / (2.0 * np.pi * SLOW)}
    names = base.problem.states
    assert set(names) == set(start)
    for name, value in zip(names, whole.point.starts[1], strict=True):
        assert value == pytest.approx(start[name], abs=4.0 * std[name] * noise / np.sqrt(split.heads[0])), name
    assert train_on(base, split, split.folds[0]).point.starts[1] == pytest.approx(whole.point.starts[1])


@pytest.mark.parametrize("spoilt", [np.nan, 1e5])
def test_what_comes_after_its_beginning_has_no_say_in_where_a_record_begins(held, spoilt):
    base, split, _, noise = held
    head, trace = split.heads[0], split.traces[1]
    outputs, inputs = trace.outputs.copy(), trace.inputs.copy()
    outputs[head:] = spoilt * noise
    inputs[head:] = 1e3 * np.abs(inputs).max()
    other = replace(split, traces=(split.traces[0], replace(trace, outputs=outputs, inputs=inputs)))
    plain, later = (over_all_records(base, s).point.starts[1] for s in (split, other))
    assert np.array_equal(plain, later)
    outputs[:head] += 10.0 * noise
    assert not np.array_equal(over_all_records(base, other).point.starts[1], plain)


def test_without_records_held_out_a_model_is_over_all_of_them_already(held):
    base, split, *_ = held
    alone = split_of(split.experiments[:1], 1, base.task.drive, base.task.roles)
    assert over_all_records(base, alone) is base


def test_information_of_a_held_out_record_is_not_counted_to_the_training_records(monkeypatch, held):
    """The beginning of a record held out is everybody's for training: that makes it no record of the fit."""
    base, split, *_ = held
    model = over_all_records(base, split)
    monkeypatch.setattr(between_records, "_held_out", lambda *_: ())
    monkeypatch.setattr(between_records, "_change", lambda fitted: len(fitted.problem.traces))
    folds = [Fold(its.train, its.test, its.again, model, 0.0) for its in split.folds]
    assert len(model.problem.traces) == 2 and between_records.change_between(model, folds) == split.fitted == 1
