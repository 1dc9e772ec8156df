"""A drive whose laws hold only where they were fitted explains nothing: parts of the record are held out."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.laws.candidates import candidates_of
from drivetool.identify.laws.explanation import _inertia_at_lower_bound
from drivetool.identify.laws.held_out import _part_of_record, held_out_errors
from drivetool.identify.setup.options import HELD_OUT_SHARE, Options
from tests.identify.swing import TRUTH, record, swing, task_of
from tests.recover import experiment
from tests.study.coupled_axes.arm import STEP, draw


@pytest.mark.slow
@pytest.mark.parametrize("number, seed, seconds", [(17, 8017, 6.0), (2, 8002, None)])
def test_a_joint_whose_neighbour_moves_is_no_one_body(number, seed, seconds):
    joint = draw(number, seed, seconds)
    assert joint.coupled > 0.9
    made = experiment(joint.torque, joint.measured, step=STEP)
    made = replace(made, signals={"motor_torque": joint.torque, joint.role: joint.measured})
    start = {"motor.inertia": 0.7 * joint.inertia, "motor.viscous": 0.1, "motor.coulomb": 0.3}
    found = greybox([made], one_body().with_values(start), Options(free=tuple(TRUTH)))
    failure = next(f for f in found.findings if f.code == "explains-nothing")
    assert failure.severity == "failure" and "held-out parts" in failure.text
    assert all(p.ci95 is None and p.std is None for p in found.parameters)


@pytest.mark.slow
def test_a_torque_that_moves_no_inertia_explains_nothing():
    joint = draw(11, 860_011, 6.0)
    made = experiment(joint.torque, joint.measured, step=STEP)
    made = replace(made, signals={"motor_torque": joint.torque, joint.role: joint.measured})
    start = {"motor.inertia": 0.7 * joint.inertia, "motor.viscous": 0.0, "motor.coulomb": 0.0}
    found = greybox([made], one_body().with_values(start), Options())
    assert "explains-nothing" in {f.code for f in found.findings}
    assert all(p.ci95 is None for p in found.parameters)


@pytest.mark.parametrize("name, low, found", [
    ("motor.inertia", True, True), ("motor.inertia", False, False), ("motor.viscous", True, False)])
def test_an_inertia_at_its_bound_is_none(name, low, found):
    task = task_of(record(swing(250)))
    assert _inertia_at_lower_bound(task.at({name: task.drive.quantity(name).bounds[0]} if low else {})) is found


def test_a_right_drive_explains_what_is_held_out():
    rng, made = np.random.default_rng(1), record(swing(4000))
    noisy = made.signals["motor_speed"] + 2e-3 * rng.standard_normal(4000)
    task = task_of(replace(made, signals={**made.signals, "motor_speed": noisy}))
    error, straight = held_out_errors(candidates_of(by_innovations(task, [{}])))
    assert straight > 0.1 * np.std(noisy) and error < 0.05 * straight


@pytest.mark.parametrize("late, held, first, last", [
    (True, True, 1.0 - HELD_OUT_SHARE, 1.0), (True, False, 0.0, 1.0 - HELD_OUT_SHARE),
    (False, True, 0.0, HELD_OUT_SHARE),
    (False, False, HELD_OUT_SHARE, 1.0)])
def test_a_part_and_the_rest_are_the_record(late, held, first, last):
    made = record(swing(1000))
    task = replace(task_of(made, made), start={"motor.speed": 1.0})
    part, expected = _part_of_record(task, late,
                                     held), made.signals["motor_speed"][round(1000 * first):round(1000 * last)]
    assert all(np.array_equal(e.signals["motor_speed"], expected) for e in part.experiments)
    assert bool(part.start) == (first == 0.0)  # a recording begins where it begins


def test_a_record_too_short_to_be_cut_has_no_held_out_error():
    task = task_of(record(swing(250)))
    field = candidates_of(by_innovations(task, [{}]))
    short = replace(task, experiments=tuple(e.between(0.0, 20 * e.step) for e in task.experiments))
    assert held_out_errors(replace(field, task=short)) == (0.0, 0.0)
