"""A ripple of two orders, as slots and poles leave together: both are found, and nothing beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.hidden.case import make_case
from tests.hidden.command import greybox_and_diagnose
from tests.hidden.custom_record import write_record
from tests.hidden.profiles import profile
from tests.hidden.start import write_start

PLAIN = ["--hold", "motor.coulomb"]
OFTEN = ["--candidates", "torque-ripple,imbalance,load-step,quadratic-drag"]


def answer_to(folder, machine_seed, kind, *ripples):
    """What is said of a record whose motor has these ripples (share of rated torque, order, phase)."""
    case = make_case("none", machine_seed, record=kind, seed=5, duration=8.0)
    rig = case.rig
    names = ("ripple", "ripple2")
    laws = {n: (share * rig.rated, *rest) for n, (share, *rest) in zip(names, ripples, strict=False)}
    machine = replace(rig.machine, effects=replace(rig.machine.effects, **laws))
    record = write_record(folder, case, profile(kind, rig, 5), machine=machine)
    return case, greybox_and_diagnose(folder, [record], write_start(case, folder), PLAIN, OFTEN)


@pytest.mark.parametrize(("machine", "kind", "orders"), [
    pytest.param(943, "reversing", (6.0, 12.0), marks=pytest.mark.slow),  # those of a real axis: test_measured.py
    pytest.param(947, "closed-loop", (4.0, 9.5), marks=pytest.mark.long)])
def test_both_orders_of_a_ripple_are_found_with_their_sizes(tmp_path, machine, kind, orders):
    case, answer = answer_to(tmp_path, machine, kind, (0.02, orders[0], 0.7), (0.012, orders[1], -0.4))
    assert (answer.verdict, answer.causes) == ("named", ("torque-ripple",)), answer.stderr
    found = answer.parameters
    lines = sorted((found[f"motor.{r}_order"]["value"], r) for r in ("ripple", "ripple2"))
    for (_, ripple), order, share, phase in zip(lines, orders, (0.02, 0.012), (0.7, -0.4), strict=True):
        low, high = found[f"motor.{ripple}_order"]["ci95"]
        assert low - 0.3 * (high - low) < order < high + 0.3 * (high - low)
        size = share * case.rig.rated
        for part, true in (("sine", size * np.cos(phase)), ("cosine", size * np.sin(phase))):
            section = found[f"motor.{ripple}_{part}"]
            assert abs(section["value"] - true) < 4.0 * section["std"] + 0.02 * size, (ripple, part)
    assert "motor.ripple3_order" not in found


@pytest.mark.slow
def test_one_order_stays_one(tmp_path):
    _, answer = answer_to(tmp_path, 943, "reversing", (0.02, 6.0, 0.7))
    assert (answer.verdict, answer.causes) == ("named", ("torque-ripple",)), answer.stderr
    assert "motor.ripple2_order" not in answer.parameters
