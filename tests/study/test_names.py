"""What the study of names takes for right, open and wrong, and that its further records are of the same machine."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.check.causes import CAUSES
from tests.hidden.command import Answer
from tests.study import study_names_one_body as one_body
from tests.study.study_names import ACCEPTED_NAMES, fresh_record, grade_of_law
from tests.study.two_masses.laws import LAWS
from tests.study.two_masses.record import arrange


def test_every_law_has_its_accepted_names():
    assert set(ACCEPTED_NAMES) == set(LAWS)
    assert set(one_body.ACCEPTED_NAMES) == set(one_body.LAWS)
    assert set().union(*ACCEPTED_NAMES.values(), *one_body.ACCEPTED_NAMES.values()) <= set(CAUSES)


@pytest.mark.parametrize(("situation", "verdict", "causes", "between", "grade"), [
    ("quiet", "nothing-found", (), (), "right"), ("quiet", "named", ("quantisation",), (), "right"),
    ("quiet", "named", ("load-step",), (), "false-alarm"), ("quiet", "unexplained", (), (), "false-alarm"),
    ("motor.drag", "named", ("quadratic-drag",), (), "right"), ("motor.drag", "nothing-found", (), (), "missed"),
    ("motor.drag", "named", ("quadratic-drag", "load-step"), (), "wrong"),
    ("motor.drag", "undetermined", (), ("quadratic-drag", "friction-drift"), "open"),
    ("motor.drag", "undetermined", (), ("friction-drift", "load-step"), "wrong"),
    ("motor.drag", "undetermined", ("load-step",), ("quadratic-drag", "unlisted"), "wrong"),
    ("motor.drag", "unexplained", (), (), "unexplained"), ("motor.crank", "unexplained", (), (), "right"),
    ("motor.crank", "undetermined", (), ("imbalance", "unlisted"), "open"),
    ("motor.crank", "named", ("imbalance",), (), "wrong"),
    ("gap+load.dry", "named", ("coulomb-load",), (), "right"), ("load.dry", "failed", (), (), "failed")])
def test_what_is_right(situation, verdict, causes, between, grade):
    assert grade_of_law(situation, Answer(verdict, causes, between)) == grade


def test_a_further_record_is_of_the_same_machine_under_the_same_law():
    setup, law = arrange("motor.cogging", "L", 3, 5, 1.0)
    first, second = (fresh_record(setup, law, "motor.cogging", count, 9) for count in (4, 6))
    assert first.machine is second.machine is setup.machine
    assert set(first.channels) == set(second.channels)
    assert not np.allclose(first.channels["motor_torque"], second.channels["motor_torque"])


@pytest.mark.parametrize("law", ["lugre", "none"])
def test_a_further_run_of_one_body_is_another_motion_of_the_same_machine(law):
    setup, placed, _ = one_body.arrange(law, 0.15, 3, 5, 2.0)
    second = one_body.fresh_record(setup, placed, law, 6, 9)
    assert second.machine is setup.machine and second.step == setup.step
    first, other = (one_body.channels_of(each, placed) for each in (setup, second))
    assert set(first) == set(other) and len(first["motor_torque"]) == len(other["motor_torque"])
    assert not np.allclose(first["motor_torque"], other["motor_torque"])
