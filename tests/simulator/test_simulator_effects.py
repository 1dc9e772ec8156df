"""Laws beyond the plain machine: closed forms, energy, and the compiled simulator against DOP853."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.hidden.case import add_effects
from tests.hidden.effects import KINDS
from tests.hidden.profiles import STEP, profile
from tests.hidden.rigs import rig_by_seed
from tests.simulator.controllers import SpeedPI
from tests.simulator.effects import Effects
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine, State, machine_by_seed
from tests.simulator.simulate import Sensor, simulate

BOTH = pytest.mark.parametrize("run", [simulate, simulate_fast])
SHAPES = {"imbalance": (1, False), "friction-drift": (3, False), "torque-ripple": (2, True),
          "quadratic-drag": (1, True)}


def pair(machine, torque, start, **more):
    """The same record from both simulators."""
    return simulate(machine, torque, STEP, start, **more), simulate_fast(machine, torque, STEP, start, **more)


# The compiled simulator against the plain one


@pytest.mark.parametrize("code", KINDS)
def test_compiled_simulator_agrees_on_every_effect(code):
    kind = KINDS[code]
    bodies, linear = SHAPES.get(code, (2, False))
    rig = rig_by_seed(3, bodies, linear, kind.coulomb)
    machine, _, _ = add_effects([code], rig, None, 5)
    if code == "load-step":
        machine = replace(machine, effects=replace(machine.effects, load_step=(0.1 * rig.rated, 0.20037)))
    plan = profile("reversing", rig, 4)
    # The part with the slow reversals, where bodies stick, and 0.4 s of it for each simulator.
    torque = plan.torque[5200:5600]
    noise = 0.0015 * rig.rated * np.random.default_rng(1).standard_normal(len(torque))
    more = machine.bodies - bodies
    start = replace(plan.start, speeds=plan.start.speeds + plan.start.speeds[-1:] * more,
                    twists=plan.start.twists + (0.0,) * more)
    slow, fast = pair(machine, torque, start, torque_noise=noise)
    bound = 1e-7 * min(1.0, rig.top / 10.0)
    for name in ("speeds", "measured"):
        error = getattr(slow, name) - getattr(fast, name)
        assert np.sqrt(np.mean(error**2)) < 0.1 * bound, name
    np.testing.assert_allclose(fast.angles, slow.angles, atol=bound)
    np.testing.assert_array_equal(fast.stuck, slow.stuck)
    assert fast.events == slow.events
    np.testing.assert_allclose(fast.end.speeds, slow.end.speeds, atol=bound)
    if machine != rig.machine:
        plain = simulate_fast(rig.machine, torque, STEP, plan.start, torque_noise=noise)
        changed = np.abs(fast.measured - plain.measured).max()
        assert changed > 100.0 * bound


@pytest.mark.parametrize("machine", [
    machine_by_seed(4, gap=0.1), machine_by_seed(6, gap=0.05, friction=True, law="always"),
    machine_by_seed(3, friction=True, converter_bandwidth=433.0, dead_time=1.4e-3),
    machine_by_seed(3, friction=True, converter_bandwidth=433.0, converter_damping=np.inf),
    Machine((0.4, 0.7, 3.0), (0.1, 0.2, 0.3), (0.5, 0.0, 1.0), (1.0, 0.5, 2.0), (900.0, 400.0), (0.5, 0.8),
            (0.01, 0.0), (2.0, 0.5), "inside", 433.0, 0.69, 0.0023, 60.0)])
def test_compiled_simulator_agrees_on_plain_machines(machine):
    levels = np.random.default_rng(2).uniform(-1.0, 1.0, 15)
    torque = 0.25 * machine.rated_torque * np.repeat(levels, 40)
    start = State((0.0,) * machine.bodies, (0.0,) * (machine.bodies - 1))
    slow, fast = pair(machine, torque, start, load_torque=0.01 * torque)
    assert np.sqrt(np.mean((slow.speeds - fast.speeds) ** 2)) < 1e-7
    for name in ("contact", "stuck"):
        assert np.mean(getattr(slow, name) != getattr(fast, name)) < 2e-3
    assert slow.events == fast.events
    np.testing.assert_allclose(fast.applied, slow.applied, atol=1e-9 * machine.rated_torque)


def test_compiled_controller_is_the_plain_one():
    machine = machine_by_seed(9, friction=True, gap=0.05)
    size, gain = 800, 15.0 * sum(machine.inertia)
    reference = np.repeat([0.0, 3.0, -2.0, 0.5], size // 4)
    noise = 0.01 * np.random.default_rng(3).standard_normal(size)
    dither = 0.02 * machine.rated_torque * np.sin(np.arange(size))
    limit = 0.1 * machine.rated_torque
    slow = simulate(machine, np.zeros(size), STEP, sensor=Sensor("speed", noise, 1e-3), controller=SpeedPI(
        reference, gain, 4.0 * gain, STEP, dither, 1.0, limit, 0.01))
    fast = simulate_fast(machine, dither, STEP, None, PI(reference, gain, 4.0 * gain, 1.0, limit, 0.01),
                         sensor_noise=noise, resolution=1e-3)
    np.testing.assert_allclose(fast.command, slow.command, atol=1e-9)
    np.testing.assert_allclose(fast.measured, slow.measured, atol=1e-9)
    assert 0.05 < np.mean(np.abs(fast.command) > 0.999 * limit) < 0.9


# Closed forms


@BOTH
def test_drag_has_its_terminal_speed(run):
    machine = Machine((2.0,), effects=Effects(quadratic=(0.5,)))
    made = run(machine, np.full(3000, 8.0), 4e-3)
    expected = 4.0 * np.tanh(0.5 * 4.0 / 2.0 * made.time)
    np.testing.assert_allclose(made.speeds[:, 0], expected, atol=1e-8)


@BOTH
@pytest.mark.parametrize("power", [1.0, 2.0, 3.3])
def test_hardening_shaft_at_rest_has_its_twist(run, power):
    """Both ends pulled by torques that balance: k phi (1 + (phi / phi0)^p) is the torque."""
    effects = Effects(hardening_twist=(0.02,), hardening_power=(power,))
    machine = Machine((1.0, 1.0), (0.0, 0.0), (), (0.0, 0.0), (500.0,), (40.0,), effects=effects)
    made = run(machine, np.full(2000, 15.0), STEP, load_torque=np.full(2000, 15.0))
    twist = (made.angles[:, 0] - made.angles[:, 1])[-1]
    assert 500.0 * twist * (1.0 + (twist / 0.02) ** power) == pytest.approx(15.0, rel=1e-9)
    assert made.shaft_torques[-1, 0] == pytest.approx(15.0, rel=1e-9)


@pytest.mark.slow
@BOTH
def test_breakaway_is_coulomb_and_extra_and_sliding_falls_to_coulomb(run):
    machine = Machine((1.0,), (0.0,), (2.0,), effects=Effects(stribeck=(1.5,), stribeck_speed=(0.1,)))
    made = run(machine, np.linspace(0.0, 5.0, 5001), STEP)
    first = made.command[~made.stuck[:, 0]][0]
    assert 3.5 < first <= 3.5 + 2e-3
    # Far above the Stribeck speed a constant torque of coulomb keeps the speed.
    slides = run(machine, np.full(1000, 2.0), STEP, State((3.0,), ()))
    np.testing.assert_allclose(slides.speeds, 3.0, atol=1e-9)


@BOTH
def test_ripple_turns_at_its_order(run):
    """Constant speed under a tiny ripple: torque at order * speed, here 4.5 * 7 rad/s."""
    machine = Machine((1.0,), effects=Effects(ripple=(1e-3, 4.5, 0.3)))
    made = run(machine, np.zeros(2000), STEP, State((7.0,), ()))
    rate = 4.5 * 7.0
    expected = 7.0 - 1e-3 / rate * (np.cos(rate * made.time + 0.3) - np.cos(0.3))
    np.testing.assert_allclose(made.speeds[:, 0], expected, atol=3e-8)
    # With energy: w^2 / 2 + a cos(order angle + phase) / order / J is constant.
    energy = 0.5 * made.speeds[:, 0] ** 2 + 1e-3 / 4.5 * np.cos(4.5 * made.angles[:, 0] + 0.3)
    np.testing.assert_allclose(energy, energy[0], atol=1e-10)


@BOTH
def test_imbalance_is_a_pendulum(run):
    machine = Machine((1.0, 1.0), (), (), (), (1e4,), (), effects=Effects(imbalance=(6.0, 2.0, 0.0)))
    made = run(machine, np.zeros(3000), STEP, State((0.0, 0.0), (0.0,), 1.0))
    energy = 0.5 * np.sum(made.speeds**2, axis=1) + 0.5e4 * (made.angles[:, 0] - made.angles[:, 1]) ** 2
    energy -= 6.0 * 2.0 * np.cos(made.angles[:, 1] / 2.0)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)
    assert made.angles[:, 1].min() < -0.5


@pytest.mark.slow
@BOTH
def test_direction_decides_on_friction(run):
    effects = Effects(viscous_back=(0.5,), coulomb_back=(1.0,))
    machine = Machine((1.0,), (2.0,), (3.0,), effects=effects)
    for torque, speed in ((7.0, 2.0), (-3.0, -4.0)):
        made = run(machine, np.full(4000, torque), 1e-2)
        assert made.speeds[-1, 0] == pytest.approx(speed, rel=1e-6)
    assert not run(machine, np.full(100, 2.9), STEP).speeds.any()
    assert run(machine, np.full(100, -2.9), STEP).speeds.min() < 0.0


@BOTH
def test_friction_that_wears_off(run):
    """Constant torque against viscous friction alone, (1 + d exp(-t/T)) c: a linear equation."""
    machine = Machine((1.0,), (1.5,), effects=Effects(drift=(0.8, 0.5)))
    made = run(machine, np.zeros(1500), STEP, State((2.0,), ()))
    expected = 2.0 * np.exp(-1.5 * (made.time + 0.8 * 0.5 * (1.0 - np.exp(-made.time / 0.5))))
    np.testing.assert_allclose(made.speeds[:, 0], expected, atol=1e-9)
    stuck = Machine((1.0,), (0.0,), (2.0,), effects=Effects(drift=(1.0, 0.5)))
    freed = run(stuck, np.full(1000, 3.0), STEP)
    # 2 (1 + exp(-t / 0.5)) falls to 3 at t = 0.5 ln 2.
    assert freed.time[freed.stuck[:, 0]][-1] == pytest.approx(0.5 * math.log(2.0), abs=STEP)


@BOTH
def test_load_dependent_damping_loses_its_energy(run):
    """A wound-up shaft: energy falls by the damping's work, more at high torque."""
    effects = Effects(damping_torque=(5.0,))
    plain = Machine((0.6, 5.2), (), (), (), (3300.0,), (3.0,))
    start = State((0.0, 0.0), (0.02,))
    made = run(replace(plain, effects=effects), np.zeros(800), 2.5e-4, start)
    rate, twist = made.speeds[:, 0] - made.speeds[:, 1], made.angles[:, 0] - made.angles[:, 1]
    energy = 0.5 * made.speeds**2 @ (0.6, 5.2) + 0.5 * 3300.0 * twist**2
    power = 3.0 * (1.0 + np.abs(3300.0 * twist) / 5.0) * rate**2
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]))]) * 2.5e-4
    np.testing.assert_allclose(energy + work, energy[0], rtol=2e-4)
    less = run(plain, np.zeros(800), 2.5e-4, start)
    assert energy[-1] < 0.5 * (0.5 * less.speeds[-1] ** 2 @ (0.6, 5.2) + 1650.0 * (
        less.angles[-1, 0] - less.angles[-1, 1]) ** 2)


@BOTH
def test_filter_lags_and_the_machine_does_not_know(run):
    machine = Machine((1.0,), effects=Effects(filter_time=0.01))
    made = run(machine, np.ones(200), STEP)
    lag = made.time - 0.01 * (1.0 - np.exp(-made.time / 0.01))
    np.testing.assert_allclose(made.measured, lag, atol=1e-12)
    np.testing.assert_allclose(made.speeds[:, 0], made.time, atol=1e-12)


@BOTH
def test_load_steps_inside_a_sample(run):
    made = run(Machine((2.0,), effects=Effects(load_step=(4.0, 0.1003))), np.zeros(200), STEP)
    np.testing.assert_allclose(made.speeds[:, 0], -2.0 * np.maximum(made.time - 0.1003, 0.0), atol=1e-12)


@BOTH
def test_hardening_gap_never_pulls_and_keeps_energy(run):
    effects = Effects(hardening_twist=(0.01,), hardening_power=(2.0,))
    machine = Machine((0.6, 5.2), (), (), (), (3300.0,), (0.0,), (0.02,), effects=effects)
    made = run(machine, np.zeros(800), STEP, State((3.0, -1.0), (0.0,)))
    bend = np.maximum(np.abs(made.angles[:, 0] - made.angles[:, 1]) - 0.02, 0.0)
    energy = 0.5 * made.speeds**2 @ machine.inertia
    energy += 3300.0 * (bend**2 / 2.0 + bend**4 / 4.0 / 0.01**2)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-7)
    assert made.events["contact_made"] > 5
    damped = run(replace(machine, damping=(3.0,), effects=replace(effects, damping_torque=(50.0,))),
                 np.zeros(800), STEP, State((3.0, -1.0), (0.0,)))
    assert np.min(damped.shaft_torques * damped.contact) >= 0.0


def test_dead_time_shifts_and_effects_want_their_number_of_values():
    machine = Machine((1.0,), dead_time=2.5e-3)
    made = simulate_fast(machine, np.ones(100), STEP)
    np.testing.assert_allclose(made.speeds[:, 0], np.maximum(made.time - 2.5e-3, 0.0), atol=1e-12)
    with pytest.raises(ValueError, match="stribeck: wanted 2 values, found 1"):
        simulate(machine_by_seed(1, effects=Effects(stribeck=(1.0,))), np.zeros(3), STEP)
    assert not machine_by_seed(1, effects=Effects(ripple=(1.0, 1.0, 0.0))).is_linear
