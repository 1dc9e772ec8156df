"""Loads that come and go with the speed, and loads that come and go."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.check.verdict.by_speed import share_by_speed
from drivetool.drive import two_mass
from drivetool.drive.simulation import Trace
from drivetool.identify.problem import Point
from drivetool.identify.setup import Roles
from tests.check.models import model_over, task_of

STEP, SIZE = 1e-3, 12_000
TIME = STEP * np.arange(SIZE)
SPEED = 20.0 * np.sin(0.9 * TIME) * np.exp(-0.1 * TIME) + 4.0 * np.sin(3.1 * TIME)


def model(changes, role="motor_speed"):
    """A model by the (torque, instant) of the loads that set in, over a record of its motion."""
    values = {}
    for slot, (torque, time) in zip(("step", "step2", "step3", "step4"), changes, strict=False):
        values |= {f"load.{slot}_torque": torque, f"load.{slot}_time": time}
    y = SPEED + 0.1 * np.random.default_rng(2).standard_normal(SIZE)
    y = np.cumsum(SPEED) * STEP if role.endswith("angle") else y
    free = tuple(n for n in values if n.endswith("torque"))
    task = task_of(free, two_mass().with_values(values), Roles(("motor_torque",), (role,)))
    return model_over(Trace(np.zeros((SIZE, 1)), y[:, None], STEP), task=task,
                      point=Point(np.array([values[n] for n in free]), ()))


@pytest.mark.parametrize("role", ["motor_speed", "motor_angle"])
def test_a_load_in_one_direction_is_one_of_the_speed(role):
    turns = np.flatnonzero(np.diff(np.sign(SPEED)))[:4]
    assert share_by_speed(model([((-1.0) ** k, TIME[i]) for k, i in enumerate(turns)], role)) > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 3, 4])
def test_loads_at_any_time_are_none_of_the_speed(count):
    rng = np.random.default_rng(count)
    shares = [share_by_speed(model([*zip(rng.choice([-1.0, 1.0], count), np.sort(rng.uniform(0.3, 11.7, count)),
                                         strict=True)])) for _ in range(60)]
    assert max(shares) < 0.9 and np.median(shares) < 0.5


def test_no_load_is_none_of_the_speed():
    assert share_by_speed(model([])) == 0.0
