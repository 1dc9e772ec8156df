"""Linearisation against closed forms, published figures and the kernel."""

import numpy as np
import pytest

from drivetool.drive.chain import one_body, three_mass, two_mass
from drivetool.drive.linearise import resonances, state_space
from drivetool.drive.simulation.simulate import Trace
from drivetool.errors import BadParameters
from tests.drive.test_kernel import CHAIN, changed, drive_of, plant_of
from tests.frequency_response import frequency_response
from tests.simulator.linear import equations


def two_mass_drive(jm, jl, ks, cs=0.0, cm=0.0, cl=0.0, ratio=1.0):
    """A two-mass drive."""
    return two_mass().with_values({
        "motor.inertia": jm, "load.inertia": jl, "shaft.stiffness": ks, "shaft.damping": cs,
        "motor.viscous": cm, "load.viscous": cl, "shaft.ratio": ratio})


def modes_of(kind, drive):
    """The modes of a kind."""
    return [m for m in resonances(drive) if m.kind == kind]


@pytest.mark.parametrize("jm, jl, ks, cs", [
    (0.6, 5.2, 3300.0, 3.1), (4.8, 0.65, 3770.0, 0.0), (1.0, 1.0, 1e4, 40.0)])
def test_two_masses_in_closed_form(jm, jl, ks, cs):
    low, high = resonances(two_mass_drive(jm, jl, ks, cs))
    assert (low.kind, high.kind) == ("anti-resonance", "resonance")
    assert low.frequency_hz == pytest.approx(np.sqrt(ks / jl) / (2.0 * np.pi), rel=1e-12)
    assert high.frequency_hz == pytest.approx(np.sqrt(ks * (jm + jl) / (jm * jl)) / (2.0 * np.pi), rel=1e-12)
    assert high.damping_ratio == pytest.approx(cs / 2.0 * np.sqrt((jm + jl) / (ks * jm * jl)), abs=1e-12)
    assert high.damped_hz == pytest.approx(high.frequency_hz * np.sqrt(1.0 - high.damping_ratio**2), rel=1e-9)


def test_more_damping_than_critical_does_not_ring():
    low, high = resonances(two_mass_drive(1.0, 1.0, 1e4, 400.0))
    assert high.damped_hz == 0.0 and high.damping_ratio == pytest.approx(4.0 / np.sqrt(2.0))
    assert low.damped_hz == 0.0 and low.damping_ratio == pytest.approx(2.0)


# Published figures


def test_thesis_rig_grey_box():
    (high,) = modes_of("resonance", two_mass_drive(0.587, 5.179, 3310.0, 3.115, 0.000176, 0.0017))
    assert high.frequency_hz == pytest.approx(12.60, abs=0.011)
    (high,) = modes_of("resonance", two_mass_drive(0.601, 5.554, 3445.0, 3.324))
    assert high.frequency_hz == pytest.approx(12.68, abs=0.011)


@pytest.mark.parametrize("jl, ks, cs", [
    (5.0, 56000.0, 56.0), (20.0, 140000.0, 140.0), (80.0, 224000.0, 224.0)])
def test_table_3_1(jl, ks, cs):
    (high,) = modes_of("resonance", two_mass_drive(20.0, jl, ks, cs, 0.006, jl * 0.0003))
    assert high.frequency_hz == pytest.approx(18.8, abs=0.05)
    assert high.damping_ratio == pytest.approx(0.0592, abs=5e-5)


@pytest.mark.parametrize("jm, jl, ks, hertz", [
    (4.94, 0.655, 3780.0, 12.9), (4.78, 0.646, 3770.0, 13.0), (2.14, 4.17, 9560.0, 13.1),
    (0.710, 4.87, 4130.0, 13.0), (0.566, 5.01, 3500.0, 13.2)])
def test_table_6_2(jm, jl, ks, hertz):
    assert modes_of("resonance", two_mass_drive(jm, jl, ks))[0].frequency_hz == pytest.approx(hertz, abs=0.06)


def test_first_anti_resonance_of_the_robot_axis():
    drive = three_mass().with_values({
        "motor.inertia": 3.9e-4, "gear.inertia": 12.2, "arm.inertia": 6.3, "shaft.stiffness": 1.9e5,
        "shaft2.stiffness": 1.5e5, "shaft.ratio": 118.0, "shaft.damping": 168.0, "shaft2.damping": 12.0})
    modes = resonances(drive)
    assert [m.kind for m in modes] == ["anti-resonance", "resonance"] * 2
    assert modes[0].frequency_hz * 2.0 * np.pi == pytest.approx(92.8, abs=0.1)
    # s^4 + (kg/Jg + ka/Ja + ka/Jg) s^2 + kg ka/(Jg Ja) = 0
    squares = np.roots([1.0, -(1.9e5 / 12.2 + 1.5e5 / 6.3 + 1.5e5 / 12.2), 1.9e5 * 1.5e5 / (12.2 * 6.3)])
    zeros = [m.frequency_hz * 2.0 * np.pi for m in modes if m.kind == "anti-resonance"]
    np.testing.assert_allclose(zeros, np.sort(np.sqrt(squares)), rtol=1e-10)


def test_bus_driveline():
    wheels = 22.1 + 11600.9 * 0.45**2
    drive = two_mass_drive(3.65, wheels, 1479.9e3, 3600.0, ratio=8.79)
    assert modes_of("resonance", drive)[0].frequency_hz == pytest.approx(12.2, abs=0.05)


# State space and frequency response


@pytest.mark.parametrize("machine", [
    CHAIN, changed(CHAIN, half_gap=(0.1, 0.2), coulomb=(1.0, 2.0, 3.0)),
    changed(CHAIN, half_gap=(0.1, 0.2), law="always")], ids=["linear", "gap and friction", "always"])
def test_state_space_is_the_simulators(machine):
    """Gap closed and Coulomb friction left out; the simulator keeps the angle as a state."""
    outputs = ("motor_speed", "arm_speed", "shaft_torque", "motor_angle", "arm_angle")
    roles = ("load_torque", "motor_torque")
    a, b, c, d = state_space(drive_of(machine), roles, outputs)
    full_a, full_b, shaft = equations(machine)
    poles, truth = (np.sort_complex(np.linalg.eigvals(m)) for m in (a, full_a))
    rates = np.abs(poles).max()
    np.testing.assert_allclose(np.poly(poles[np.abs(poles) > 1e-3] / rates),
                               np.poly(truth[np.abs(truth) > 1e-3] / rates), atol=1e-9)
    s = 2j * np.pi * 7.0
    x = np.linalg.solve(s * np.eye(len(full_a)) - full_a, full_b[:, [2, 0]])
    arm = x[5] / (2.0 * 0.5) - x[3] / 0.5 - x[4]
    expected = np.array([x[0], x[2], shaft[0] @ x, x[5], arm])
    ours = c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d
    np.testing.assert_allclose(ours, expected, rtol=1e-9, atol=1e-12)
    late = frequency_response(drive_of(machine), [7.0], roles, outputs)[0]
    np.testing.assert_allclose(late, expected * [1.0, np.exp(-s * machine.dead_time)], rtol=1e-9, atol=1e-12)


def test_frequency_response_peaks_and_dips_where_the_modes_are():
    drive = two_mass_drive(0.6, 5.2, 3300.0, 0.01)
    low, high = resonances(drive)
    grid = np.linspace(1.0, 20.0, 19001)
    size = np.abs(frequency_response(drive, grid)[:, 0, 0])
    assert grid[size.argmin()] == pytest.approx(low.frequency_hz, abs=2e-3)
    assert grid[5000 + size[5000:].argmax()] == pytest.approx(high.frequency_hz, abs=2e-3)


def test_kernel_answers_a_sine_as_the_frequency_response_says():
    """Fine sampling, so that the held torque is nearly the sine; zero-order hold taken off."""
    drive, hertz, step = two_mass_drive(0.6, 5.2, 3300.0, 30.0, 3.0, 2.0), 9.0, 1e-4
    time = np.arange(60000) * step
    plant = plant_of(drive, ["motor_speed"], step=step)
    sine = np.sin(2.0 * np.pi * hertz * time)[:, None]
    y = plant.outputs(Trace(sine, np.zeros((60000, 1)), step), np.zeros(3))
    last = time > 6.0 - 10.0 / hertz
    wave = np.exp(-2j * np.pi * hertz * time[last])
    half = 2j * np.pi * hertz * step / 2.0
    response = 2j * np.mean(y[last, 0] * wave) * half / np.sinh(half) * np.exp(half)
    assert response == pytest.approx(frequency_response(drive, [hertz])[0, 0, 0], rel=2e-3)


def test_one_body_and_missing_values():
    assert resonances(one_body().with_values({"motor.inertia": 2.0})) == []
    a, b, c, d = state_space(one_body().with_values({"motor.inertia": 2.0, "motor.viscous": 3.0}))
    assert (a.item(), b.item(), c.item(), d.item()) == (-1.5, 0.5, 1.0, 0.0)
    with pytest.raises(BadParameters, match=r"shaft\.stiffness"):
        resonances(two_mass().with_values({"motor.inertia": 1.0, "load.inertia": 1.0}))
