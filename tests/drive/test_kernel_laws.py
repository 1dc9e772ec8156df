"""The kernel for smooth laws against the independent simulator, and its sensitivities."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive.assemble import Layout
from drivetool.drive.chain import Drive
from drivetool.drive.simulation.augment import plant_of
from drivetool.drive.simulation.simulate import Trace
from tests.drive.test_kernel import STEP, drive_of, levels, rms
from tests.simulator.effects import Effects
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine

LINEAR_DRIVE = Machine((0.6, 5.2), (0.8, 0.3), (0.0, 0.0), (0.0, 0.0), (3300.0,), (3.1,), rated_torque=200.0)
WITH_FRICTION = replace(LINEAR_DRIVE, coulomb=(5.0, 4.0))
WITH_FRICTION_AND_GAP = replace(WITH_FRICTION, half_gap=(0.01,))
OUTPUTS = ("motor_speed", "load_speed", "motor_angle")
# machine, its further laws, what drivetool calls them, and the error [rad/s] of the motor speed allowed:
# the parabola through three values of a torque is of fourth order where the torque is smooth.
CASES = {
    "stribeck": (WITH_FRICTION, Effects(stribeck=(3.0, 0.0), stribeck_speed=(0.5, 1.0)),
                 {"motor.stribeck": 3.0, "motor.stribeck_speed": 0.5}, 1e-4),
    "stribeck-power": (WITH_FRICTION,
                       Effects(stribeck=(3.0, 0.0), stribeck_speed=(0.5, 1.0), stribeck_power=(3.0, 2.0)),
                       {"motor.stribeck": 3.0, "motor.stribeck_speed": 0.5, "motor.stribeck_power": 3.0}, 1e-4),
    "stribeck-load": (WITH_FRICTION_AND_GAP, Effects(stribeck=(0.0, 3.0), stribeck_speed=(1.0, 0.5)),
                      {"load.stribeck": 3.0, "load.stribeck_speed": 0.5}, 1e-4),
    "asymmetry": (LINEAR_DRIVE, Effects(viscous_back=(0.4, 0.3)),
                  {"motor.viscous": 0.6, "motor.viscous_asymmetry": 0.2}, 1e-4),
    "drag": (WITH_FRICTION_AND_GAP, Effects(quadratic=(0.02, 0.05)), {"motor.drag": 0.02, "load.drag": 0.05}, 1e-5),
    "ripple": (WITH_FRICTION_AND_GAP, Effects(ripple=(3.0, 6.5, 0.4)),
               {"motor.ripple_sine": 3.0 * np.cos(0.4), "motor.ripple_cosine": 3.0 * np.sin(0.4),
                "motor.ripple_order": 6.5}, 1e-5),
    "imbalance": (WITH_FRICTION, Effects(imbalance=(3.0, 1.0, 0.4)),
                  {"load.imbalance_sine": -3.0 * np.cos(0.4), "load.imbalance_cosine": -3.0 * np.sin(0.4)}, 1e-5),
    "hardening": (LINEAR_DRIVE, Effects(hardening_twist=(0.02,)),
                  {"shaft.hardening": 1.0, "shaft.hardening_twist": 0.02}, 1e-5),
    "load-damping": (LINEAR_DRIVE, Effects(damping_torque=(50.0,)), {"shaft.load_damping": 3.1 / 50.0}, 1e-4),
    "filter": (WITH_FRICTION_AND_GAP, Effects(filter_time=0.004), {"sensor.bandwidth": 250.0}, 1e-7),
}
EACH_CASE = pytest.mark.parametrize("name", CASES)


def runs_of(name, free=()):
    """(simulated by the independent simulator, plant, trace, start state)."""
    machine, effects, values, _ = CASES[name]
    torque = levels(machine, 3000, 3, share=0.4)
    there = simulate_fast(replace(machine, effects=effects), torque, STEP)
    drive = drive_of(machine)
    drive = replace(drive, values={**drive.values, **values})
    plant = plant_of(drive, Layout(tuple(free), ("motor_torque",), OUTPUTS, STEP, gradient=bool(free)))
    trace = Trace(torque[:, None], np.zeros((len(torque), 3)), STEP)
    return there, drive, plant, trace


@EACH_CASE
def test_against_the_independent_simulator(name):
    there, _, plant, trace = runs_of(name)
    out = plant.outputs(trace, np.zeros(plant.nx))
    bound = CASES[name][3]
    speed = there.measured if name == "filter" else there.speeds[:, 0]
    assert rms(out[:, 0] - speed) < bound
    assert rms(out[:, 1] - there.speeds[:, 1]) < bound


@pytest.mark.parametrize("power", [1.0, 1.5])
def test_breakaway_friction_with_a_cusp_at_standstill(power):
    """Below a power of two the parabola through three values of the torque is no longer of fourth order there."""
    machine = replace(WITH_FRICTION, effects=Effects(stribeck=(3.0, 0.0), stribeck_speed=(0.5, 1.0),
                                            stribeck_power=(power, 2.0)))
    torque = levels(machine, 3000, 3, share=0.4)
    there, drive = simulate_fast(machine, torque, STEP), drive_of(WITH_FRICTION)
    drive = replace(drive, values={**drive.values, "motor.stribeck": 3.0, "motor.stribeck_speed": 0.5,
                                   "motor.stribeck_power": power})
    plant = plant_of(drive, Layout((), ("motor_torque",), OUTPUTS, STEP, gradient=False))
    out = plant.outputs(Trace(torque[:, None], np.zeros((len(torque), 3)), STEP), np.zeros(plant.nx))
    assert rms(out[:, 0] - there.speeds[:, 0]) < 1e-4


@EACH_CASE
def test_sensitivities_are_the_derivatives(name):
    """Against central differences, up to a share of the samples next to grazing events."""
    _, _, values, _ = CASES[name]
    free = [n for n in values if not n.endswith("_twist")] + ["motor.inertia", "shaft.stiffness"]
    _, drive, plant, trace = runs_of(name, free)
    _, jacobian = plant.jacobian(trace, np.zeros(plant.nx))
    assert len(free) > 2 and len(jacobian) == 3000
    for k, parameter in enumerate(free):
        size = 1e-6 * max(abs(drive.value(parameter)), 1e-3)
        sides = []
        for sign in (1.0, -1.0):
            moved = replace(drive, values={**drive.values, parameter: drive.value(parameter) + sign * size})
            other = plant_of(moved, Layout((), ("motor_torque",), OUTPUTS, STEP, gradient=False))
            sides.append(other.outputs(trace, np.zeros(other.nx)))
        expected = (sides[0] - sides[1]) / (2.0 * size)
        error = np.abs(jacobian[:, 0, k] - expected[:, 0])
        assert np.quantile(error, 0.99) < 1e-4 * np.abs(expected[:, 0]).max(), parameter


@EACH_CASE
def test_a_further_input_that_is_zero_changes_nothing(name):
    """The step of one input is unrolled, that of several is not."""
    _, _, values, _ = CASES[name]
    free = (*values, "motor.inertia", "shaft.stiffness")
    _, drive, plant, trace = runs_of(name, free)
    two = plant_of(drive, Layout(free, ("motor_torque", "load_torque"), OUTPUTS, STEP))
    silent = Trace(np.hstack([trace.inputs, np.zeros((trace.size, 1))]), trace.outputs, STEP)
    there, sensitivities = plant.jacobian(trace, np.zeros(plant.nx))
    same, too = two.jacobian(silent, np.zeros(two.nx))
    np.testing.assert_allclose(same, there, atol=1e-9)
    np.testing.assert_allclose(too[..., :len(free)], sensitivities[..., :len(free)], rtol=1e-5,
                               atol=1e-7 * np.abs(sensitivities[..., :len(free)]).max())


def test_one_body_under_drag_comes_to_speed_as_a_hyperbolic_tangent():
    """J dw/dt = T - c w^2: w = sqrt(T / c) tanh(t sqrt(T c) / J), and its derivatives."""
    inertia, drag, torque, n = 0.6, 0.05, 20.0, 2000
    drive = Drive("test", ("motor",), (), {"motor.inertia": inertia, "motor.viscous": 0.0, "motor.drag": drag})
    free = ("motor.inertia", "motor.drag")
    plant = plant_of(drive, Layout(free, ("motor_torque",), ("motor_speed",), STEP))
    trace = Trace(np.full((n, 1), torque), np.zeros((n, 1)), STEP)
    out, jacobian = plant.jacobian(trace, np.zeros(plant.nx))
    t, rate = np.arange(n) * STEP, np.sqrt(torque * drag) / inertia
    speed, slope = np.sqrt(torque / drag) * np.tanh(rate * t), np.sqrt(torque / drag) / np.cosh(rate * t) ** 2
    np.testing.assert_allclose(out[:, 0], speed, atol=1e-9)
    np.testing.assert_allclose(jacobian[:, 0, 0], -slope * rate * t / inertia, atol=1e-6)
    np.testing.assert_allclose(jacobian[:, 0, 1], (slope * rate * t - speed) / (2.0 * drag), atol=1e-5)


@EACH_CASE
def test_the_filter_carries_a_covariance_like_the_sensitivities(name):
    """With a tiny start covariance and no noise, the variance is that of the linearised outputs."""
    _, _, plant, trace = runs_of(name)
    _, _, full, _ = runs_of(name, ("motor.inertia",))
    n, tiny, start = 600, 1e-10, np.zeros(plant.nx)
    torque, nothing = trace.inputs[:n], np.full((n, 3), np.nan)
    out, _ = full.jacobian(Trace(torque, nothing, STEP), start)
    seen = Trace(torque, out, STEP)
    found = plant.filter(seen, start, np.ones(3), 0.0, np.zeros(plant.nx), np.diag([tiny] * plant.nx))
    nq = full.system.nq
    columns = full.jacobian(seen, start)[1][..., nq:nq + plant.nx]
    expected = tiny * np.sum(columns**2, axis=2)
    for m in range(3):
        np.testing.assert_allclose(found.variance[:, m] - 1.0, expected[:, m], atol=2e-3 * expected[:, m].max())


@pytest.mark.parametrize("name", [n for n in CASES if not n.startswith("stribeck") and n != "filter"])
def test_a_law_without_effect_leaves_the_filter_as_it_is(name):
    """Gap, stick and slip under the observer: innovations and variances of the exact kernel."""
    machine, _, values, _ = CASES[name]
    machine = replace(machine, coulomb=WITH_FRICTION_AND_GAP.coulomb, half_gap=WITH_FRICTION_AND_GAP.half_gap)
    drive, torque = drive_of(machine), levels(machine, 3000, 3, share=0.4)
    amplitudes = [n for n in values if not n.endswith(("_order", "_twist", ".viscous"))]
    neutral = {**values, "motor.viscous": 0.8, **dict.fromkeys(amplitudes, 0.0)}
    assert neutral["motor.viscous"] == machine.viscous[0]
    speed = simulate_fast(machine, torque, STEP).speeds[:, 0]
    speed = speed + 0.02 * np.random.default_rng(5).standard_normal(len(speed))
    passes = []
    for more, free in (({}, ()), (neutral, amplitudes)):
        changed = replace(drive, values={**drive.values, **more})
        plant = plant_of(changed, Layout(tuple(free), ("motor_torque",), ("motor_speed",), STEP, gradient=False))
        trace = Trace(torque[:, None], speed[:, None], STEP)
        start = np.zeros(plant.nx)
        passes.append(plant.filter(trace, start, np.ones(1), 50.0**2, np.zeros(plant.nx),
                                   np.zeros((plant.nx, plant.nx)), False))
    np.testing.assert_allclose(passes[1].innovations, passes[0].innovations, atol=1e-9)
    np.testing.assert_allclose(passes[1].variance, passes[0].variance, rtol=1e-9)


@pytest.mark.parametrize("name", ["drag", "stribeck", "filter"])
def test_a_dead_time_of_nothing_beside_a_law_has_sensitivities(name):
    """A fit may converge there: the sample must not have a part of zero length."""
    _, drive, plain, trace = runs_of(name)
    free = ("motor.inertia", "converter.dead_time")
    late = replace(drive, values={**drive.values, "converter.dead_time": 0.0})
    plant = plant_of(late, Layout(free, ("motor_torque",), OUTPUTS, STEP))
    out, jac = plant.jacobian(trace, np.zeros(plant.nx))
    assert np.isfinite(jac).all() and np.abs(jac[:, 0, 1]).max() > 1.0
    # At most a thousandth of a sample later.
    step = np.abs(np.diff(plain.outputs(trace, np.zeros(plain.nx))[:, 0])).max()
    assert rms(out[:, 0] - plain.outputs(trace, np.zeros(plain.nx))[:, 0]) < 2e-3 * step
