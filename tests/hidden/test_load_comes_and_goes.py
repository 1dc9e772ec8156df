"""Loads that set in and end again, as a strip does in a mill, and ripples on an axis that hardly turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.hidden.case import make_case
from tests.hidden.command import greybox_and_diagnose
from tests.hidden.custom_record import write_record
from tests.hidden.profiles import STEP, Profile, profile
from tests.hidden.start import write_start
from tests.simulator.fast import PI
from tests.simulator.machine import running

PLAIN = ["--hold", "motor.coulomb"]


def steps(size, *steps):
    """(size,) torque of loads that set in at an instant [s], each so large from then on."""
    load = np.zeros(size)
    for time, torque in steps:
        load[round(time / STEP):] += torque
    return load


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "kind", "changes"), [
    pytest.param(951, "closed-loop", ((2.2, 0.06), (4.1, -0.06)), marks=pytest.mark.long),  # a strip goes through
    (955, "reversing", ((1.7, 0.05), (4.3, 0.04)))])  # beside the first of them the second hardly shows
def test_a_load_that_changes_more_than_once_is_found_with_every_instant(tmp_path, machine, kind, changes):
    case = make_case("none", machine, record=kind, seed=2, duration=6.0)
    size = round(6.0 / STEP)
    true = [(time, share * case.rig.rated) for time, share in changes]
    record = write_record(tmp_path, case, profile(kind, case.rig, 2), load=steps(size, *true))
    answer = greybox_and_diagnose(tmp_path, [record], write_start(case, tmp_path), PLAIN,
                 ["--candidates", "load-step,friction-drift,quadratic-drag"])
    assert (answer.verdict, answer.causes) == ("named", ("load-step",)), answer.stderr
    for slot, (time, torque) in zip(("step", "step2"), true, strict=True):
        found = answer.parameters[f"load.{slot}_torque"]
        assert abs(found["value"] - torque) < 4.0 * found["std"] < 0.1 * abs(torque)
        assert abs(answer.parameters[f"load.{slot}_time"]["value"] - time) < 5.0 * STEP
    assert "load.step3_torque" not in answer.parameters


@pytest.mark.slow
def test_a_ripple_is_found_on_an_axis_that_turns_back_and_forth_by_one_turn(tmp_path):
    case = make_case("none", 941, seed=3, duration=8.0)
    rig, size, order = case.rig, round(8.0 / STEP), 6.0
    machine = replace(rig.machine, effects=replace(rig.machine.effects, ripple=(0.02 * rig.rated, order, 0.7)))
    rate, total = 2.0 * np.pi / 4.0, sum(machine.inertia)
    reference = 0.5 * 7.0 * rate * np.sin(rate * STEP * np.arange(size))
    start = running(machine, 0.0)
    dither = 0.02 * rig.rated * np.repeat(np.random.default_rng(3).choice([-1.0, 1.0], size // 8), 8)
    plan = Profile(dither, PI(reference, 6.0 * total, 12.0 * total, start.torque, rig.rated), start)
    record = write_record(tmp_path, case, plan, machine=machine)
    answer = greybox_and_diagnose(tmp_path, [record], write_start(case, tmp_path), PLAIN,
                 ["--candidates", "torque-ripple,imbalance,load-step,coulomb-motor"])
    assert (answer.verdict, answer.causes) == ("named", ("torque-ripple",)), answer.stderr
    low, high = answer.parameters["motor.ripple_order"]["ci95"]
    assert low <= order <= high
