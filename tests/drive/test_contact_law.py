"""The gap law of Nordin, Galic and Gutman against the independent simulator, and its sensitivities."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive.assemble import Layout
from drivetool.drive.linearise import state_space
from drivetool.drive.simulation.augment import plant_of
from drivetool.drive.simulation.simulate import Trace
from tests.drive.from_rest import outputs_of, sensitivity_errors
from tests.drive.test_kernel import STEP, drive_of, levels, rms
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine, State

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
    """Over a record that is short enough for its sensitivities to grow by ten only."""
    drive, torque = drive_of(CASES[name]), levels(CASES[name], 800, 3, share=0.5)
    free = ["motor.inertia", "shaft.stiffness", "shaft.damping", "shaft.half_gap"]
    for parameter, error in sensitivity_errors(drive, torque, free, 0, 1e-6).items():
        assert np.quantile(error, 0.9) < 1e-5, parameter


def test_a_record_may_begin_in_the_gap_or_in_contact():
    torque = levels(LIGHT, 1000, 5, share=0.5)
    for speeds, twist in (((1.0, 0.8), 0.02), ((1.0, 1.0), 0.06), ((-2.0, -2.0), -0.055)):
        there = simulate_fast(LIGHT, torque, STEP, State(speeds, (twist,), 0.0, torque[0], 0.0))
        found = outputs_of(drive_of(LIGHT), torque, start=[*speeds, twist, 0.0])
        assert rms(found[:, :2] - there.speeds) < 1e-7


@pytest.mark.parametrize("damping", [0.0, 1e-5])
def test_without_damping_it_is_the_law_whose_contact_has_none(damping):
    """A relaxation much faster than the sampling is slowed down, and leaves no trace."""
    drive, torque = drive_of(replace(LIGHT, damping=(damping,))), levels(LIGHT, 600, 3, share=0.5)
    inside = outputs_of(replace(drive, damping_law="inside"), torque)
    assert rms(outputs_of(drive, torque)[:, 0] - inside[:, 0]) <= 1e-12 + 10.0 * damping


def test_beside_smooth_laws_it_is_the_same():
    """The kernel of smooth laws steps another way; a drag of nothing selects it."""
    drive, torque = drive_of(LIGHT), levels(LIGHT, 600, 3, share=0.5)
    found = outputs_of(drive.with_values({"load.drag": 1e-15}), torque)
    assert rms(found[:, 0] - outputs_of(drive, torque)[:, 0]) < 1e-7


def test_closed_contacts_have_one_law():
    drive = drive_of(LIGHT)
    for found, expected in zip(state_space(drive), state_space(replace(drive, damping_law="inside")), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_an_estimate_follows_its_contacts():
    """The filter's innovations are white and as large as it states; those by another law are not."""
    drive, torque = drive_of(LIGHT), levels(LIGHT, 2000, 3, share=0.5)
    noise = np.random.default_rng(1).normal(0.0, 1.0, (2, 2000))
    there = simulate_fast(LIGHT, torque, STEP, torque_noise=0.02 * noise[0])
    measured = there.speeds[:, :1] + 0.005 * noise[1][:, None]
    plant = plant_of(drive, Layout((), ("motor_torque",), ("motor_speed",), STEP, gradient=False))
    found = plant.filter(Trace(torque[:, None], measured, STEP), np.zeros(4), np.array([0.005**2]), 0.02**2,
                         np.zeros(4), keep=True)
    settled = (found.innovations / np.sqrt(found.variance))[100:, 0]
    assert np.std(settled) == pytest.approx(1.0, rel=0.06)
    assert abs(np.mean(settled[1:] * settled[:-1])) < 0.06
    inside = plant_of(replace(drive, damping_law="inside"),
                      Layout((), ("motor_torque",), ("motor_speed",), STEP, gradient=False))
    other = inside.filter(Trace(torque[:, None], measured, STEP), np.zeros(3), np.array([0.005**2]), 0.02**2,
                          np.zeros(3), keep=True)
    assert np.std((other.innovations / np.sqrt(other.variance))[100:, 0]) > 1.3
