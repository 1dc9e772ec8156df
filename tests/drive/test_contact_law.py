"""The gap law of Nordin, Galic and Gutman against the independent simulator, and its sensitivities."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive.assemble import Layout
from drivetool.drive.simulation.augment import plant_of
from drivetool.drive.simulation.simulate import Trace
from tests.drive.test_kernel import STEP, drive_of, levels, rms
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine

LIGHT = Machine((0.02, 0.05), (0.02, 0.05), (0.0, 0.0), (0.0, 0.0), (120.0,), (0.3,), (0.05,), law="contact",
                rated_torque=2.0)
CASES = {
    "light": LIGHT,
    "little damping": replace(LIGHT, damping=(0.02,)),
    "much damping": replace(LIGHT, damping=(1.2,)),
    "with friction": replace(LIGHT, coulomb=(0.1, 0.05)),
    "with a gear": replace(LIGHT, ratio=(3.0,)),
}
EACH_CASE = pytest.mark.parametrize("name", CASES)
OUTPUTS = ("motor_speed", "load_speed", "shaft_torque")


def outputs_of(drive, torque, free=()):
    plant = plant_of(drive, Layout(tuple(free), ("motor_torque",), OUTPUTS, STEP, gradient=bool(free)))
    trace = Trace(torque[:, None], np.zeros((len(torque), 3)), STEP)
    return plant.jacobian(trace, np.zeros(plant.nx)) if free else plant.outputs(trace, np.zeros(plant.nx))


@EACH_CASE
def test_against_the_independent_simulator(name):
    torque = levels(CASES[name], 2000, 3, share=0.5)
    there = simulate_fast(CASES[name], torque, STEP)
    out = outputs_of(drive_of(CASES[name]), torque)
    assert rms(out[:, 0] - there.speeds[:, 0]) < 1e-7
    assert rms(out[:, 1] - there.speeds[:, 1]) < 1e-7
    inside = simulate_fast(replace(CASES[name], law="inside"), torque, STEP)
    assert rms(inside.speeds[:, 0] - there.speeds[:, 0]) > 1e-4


@EACH_CASE
def test_sensitivities_are_the_derivatives(name):
    drive, torque = drive_of(CASES[name]), levels(CASES[name], 2000, 3, share=0.5)
    free = ["motor.inertia", "shaft.stiffness", "shaft.damping", "shaft.half_gap"]
    _, jacobian = outputs_of(drive, torque, free)
    for k, parameter in enumerate(free):
        size = 1e-6 * drive.value(parameter)
        up, down = (outputs_of(replace(drive, values={**drive.values, parameter: drive.value(parameter) + step}),
                               torque) for step in (size, -size))
        expected = (up - down) / (2.0 * size)
        error = np.abs(jacobian[:, 0, k] - expected[:, 0])
        assert np.quantile(error, 0.9) < 1e-5 * np.abs(expected[:, 0]).max(), parameter
