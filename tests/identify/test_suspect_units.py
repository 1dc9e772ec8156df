"""A channel in another unit than it is taken for shows in all inertias and stiffnesses alike."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from tests.recover import drive_like, linear_record
from tests.simulator.machine import machine_by_seed

START = ("motor.inertia", "load.inertia", "motor.viscous", "load.viscous", "load.idle_torque", "shaft.stiffness",
         "shaft.damping")


@pytest.mark.slow
@pytest.mark.parametrize(("role", "factor", "said"), [
    ("motor_speed", 60.0 / (2.0 * np.pi), "rpm"), ("motor_speed", 180.0 / np.pi, "degrees"),
    ("motor_torque", 1e-3, "kNm"), ("motor_torque", 20.0, "is 20 times"), ("motor_speed", 1.2, None)])
def test_one_factor_on_everything_is_said(role, factor, said):
    machine = machine_by_seed(20)
    record = linear_record(machine, 20, duration=3.0)
    record = replace(record, signals={**record.signals, role: factor * record.signals[role]})
    estimate = greybox([record], drive_like(machine, list(START)), Options())
    found = [f.text for f in estimate.findings if f.code == "suspect-unit"]
    assert len(found) == (said is not None) and all(said in text for text in found)


def doubts(machine, signals, record):
    record = replace(record, signals={**record.signals, **signals})
    estimate = greybox([record], drive_like(machine, list(START)), Options())
    return {f.code for f in estimate.findings} & {"suspect-unit", "suspect-sign"}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [20, pytest.param(23, marks=pytest.mark.slow)])
def test_a_torque_upside_down_is_said(seed):
    machine = machine_by_seed(seed)
    record = linear_record(machine, seed, duration=3.0)
    assert doubts(machine, {"motor_torque": -record.signals["motor_torque"]}, record) == {"suspect-sign"}
    assert doubts(machine, {}, record) == set()
