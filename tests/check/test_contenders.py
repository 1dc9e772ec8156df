"""Which ends of a first round are fitted to the end, and what is no cause however much it gains."""

from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.check.causes import CAUSES
from drivetool.check.search.attempt import _contenders
from drivetool.drive.chain import two_mass


def end(value, order=2.0, owner="motor"):
    drive = two_mass().with_values({"converter.order": order})
    task = SimpleNamespace(drive=drive, free=(f"{owner}.drag",))
    return SimpleNamespace(code="quadratic-drag", value=value, task=task)


@pytest.mark.parametrize(("behind", "order", "owner", "kept"), [
    (30.0, 1.0, "motor", True), (100.0, 1.0, "motor", False), (100.0, 2.0, "motor", True),
    (800.0, 2.0, "motor", False), (650.0, 1.0, "load", True), (800.0, 1.0, "load", False)])
def test_a_lag_of_another_order_and_a_law_of_another_body_are_given_up_later(behind, order, owner, kept):
    """Of a gain of 1000: fifty behind is too much for the same law, seven tenths of it for one of another kind."""
    best, other = end(-1000.0, 1.0), end(-1000.0 + behind, order, owner)
    assert _contenders([best, other], end(0.0), False) == [best, *([other] if kept else [])]


@pytest.mark.parametrize(("role", "turns", "order", "none"), [
    ("motor_speed", 3.0, 0.2, True), ("motor_speed", 3.0, 0.5, False), ("motor_angle", 3.0, 0.2, True),
    ("motor_angle", 0.5, 7.0, False)])
def test_a_ripple_that_does_not_repeat_is_none(role, turns, order, none):
    angle = np.pi * turns * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 4001)))
    motion = angle if role == "motor_angle" else np.gradient(angle, 1e-3)
    motion = np.where(np.arange(4001) == 70, np.nan, motion)
    trace = SimpleNamespace(outputs=motion[:, None], step=1e-3, size=4001)
    model = SimpleNamespace(
        task=SimpleNamespace(free=("motor.ripple_order",), roles=SimpleNamespace(outputs=(role,))),
        point=SimpleNamespace(values=np.array([order])), problem=SimpleNamespace(traces=[trace]))
    base = SimpleNamespace(task=SimpleNamespace(free=()))
    assert bool(CAUSES["torque-ripple"].implausible(model, base)) == none
