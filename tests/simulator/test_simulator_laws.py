"""LuGre friction: closed forms and integrations written anew."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from tests.simulator.effects import Effects
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine, State, machine_by_seed
from tests.simulator.simulate import simulate

STEP = 1e-3
BOTH = pytest.mark.parametrize("run", [simulate, simulate_fast])


def again(rates, first, torque, method="DOP853", scale=1.0):
    """(n, states) at the samples by a general solver, restarted at each: rates(state, torque)."""
    kept = [np.array(first, float)]
    for level in torque:
        made = solve_ivp(lambda _, y, u: rates(y, u), (0.0, STEP), kept[-1], method, args=(level,),
                         rtol=1e-11, atol=1e-13 * np.broadcast_to(scale, len(first)))
        kept.append(made.y[:, -1])
    return np.array(kept[:-1])


def waves(size, share, seed=1):
    """(n,) torque that reverses several times."""
    time = np.arange(size) * STEP
    return share * (np.sin(2.0 * np.pi * 9.0 * time) + 0.4 * np.sin(2.0 * np.pi * 23.0 * time + seed))


# LuGre friction: Coulomb 1 Nm, bristles of 2e4 Nm/rad

LUGRE = Machine((0.5,), (0.02,), (1.0,), effects=Effects(
    stribeck=(0.6,), stribeck_speed=(0.05,), lugre_stiffness=(2e4,), lugre_damping=(20.0,)))


@BOTH
@pytest.mark.parametrize("speed", [0.03, 4.0, -4.0])
def test_lugre_slides_as_the_stribeck_curve_says(run, speed):
    """At a constant speed the bristles carry g(w)."""
    level = np.sign(speed) * (1.0 + 0.6 * np.exp(-(abs(speed) / 0.05) ** 2))
    start = State((speed,), (), bristles=(level / 2e4,))
    made = run(LUGRE, np.full(50, level + 0.02 * speed), STEP, start)
    np.testing.assert_allclose(made.speeds, speed, rtol=1e-11)
    assert made.end.bristles[0] == pytest.approx(level / 2e4, rel=1e-11)
    assert not made.stuck.any()


@BOTH
def test_lugre_is_a_spring_and_a_damper_before_it_slides(run):
    """Resonance sqrt(s0 / J) under a torque of a millionth of the Coulomb level."""
    made = run(LUGRE, np.full(200, 1e-6), STEP)
    a = np.array([[-20.02 / 0.5, -2e4 / 0.5, 1e-6 / 0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    expected = [(expm(a * t) @ (0.0, 0.0, 1.0))[0] for t in made.time]
    np.testing.assert_allclose(made.speeds[:, 0], expected, atol=1e-6 * np.max(expected))


@BOTH
@pytest.mark.parametrize("share", [3.0, 60.0])
def test_lugre_agrees_with_an_implicit_solver(run, share):
    """Stiff at the higher torque: bristles follow within 1/(s0 |w| / g), 10 us at the highest speed."""
    def rates(y, u):
        dz = y[0] - 2e4 * abs(y[0]) / (1.0 + 0.6 * np.exp(-(y[0] / 0.05) ** 2)) * y[1]
        return [(u - 0.02 * y[0] - 2e4 * y[1] - 20.0 * dz) / 0.5, dz]

    torque = waves(120, share)
    made = run(LUGRE, torque, STEP)
    expected = again(rates, (0.0, 0.0), torque, "Radau", (1.0, 1e-4))
    assert (np.ptp(np.sign(made.speeds)), made.events) == (2.0, {})
    np.testing.assert_allclose(made.speeds[:, 0], expected[:, 0], atol=1e-10)


@BOTH
def test_lugre_behind_a_shaft_agrees_with_an_implicit_solver(run):
    machine = Machine((0.6, 2.0), (0.1, 0.2), (0.0, 3.0), (), (3000.0,), (2.0,), (), (2.0,), effects=Effects(
        lugre_stiffness=(0.0, 5e4), lugre_damping=(0.0, 30.0), coulomb_back=(np.nan, 2.0)))

    def rates(y, u):
        motor, load, twist, z = y
        through = 3000.0 * twist + 2.0 * (motor / 2.0 - load)
        dz = load - 5e4 * abs(load) / (3.0 if load > 0.0 else 2.0) * z
        return [(u - 0.1 * motor - through / 2.0) / 0.6,
                (through - 0.2 * load - 5e4 * z - 30.0 * dz) / 2.0, motor / 2.0 - load, dz]

    torque = waves(100, 12.0)
    made = run(machine, torque, STEP, State((0.0, 0.0), (0.0,), bristles=(0.0, 1e-5)))
    expected = again(rates, (0.0, 0.0, 0.0, 1e-5), torque, "Radau", (1.0, 1.0, 0.01, 1e-4))
    assert np.ptp(np.sign(made.speeds[:, 1])) == 2.0
    np.testing.assert_allclose(made.speeds, expected[:, :2], atol=1e-10)


def test_lugre_besides_a_gap_and_coulomb_friction_is_the_same_in_both_simulators():
    machine = machine_by_seed(6, gap=0.05, friction=True)
    load = machine.coulomb[1]
    machine = replace(machine, effects=Effects(
        stribeck=(0.0, 0.5 * load), stribeck_speed=(1.0, 0.1), lugre_stiffness=(0.0, 1e4 * load),
        lugre_damping=(0.0, 10.0 * load), drift=(0.3, 0.2)))
    torque = waves(250, 0.1 * machine.rated_torque)
    slow, fast = (run(machine, torque, STEP) for run in (simulate, simulate_fast))
    np.testing.assert_allclose(fast.speeds, slow.speeds, atol=1e-9)
    np.testing.assert_allclose(fast.end.bristles, slow.end.bristles, atol=1e-13)
    assert fast.events == slow.events and slow.events["contact_made"] > 2


def test_lugre_wants_a_coulomb_level():
    with pytest.raises(ValueError, match="LuGre friction needs a Coulomb level"):
        Machine((1.0,), effects=Effects(lugre_stiffness=(1e4,)))
