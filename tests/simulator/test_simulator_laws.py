"""LuGre friction, the gap law "contact", losses of transmissions: closed forms and integrations written anew."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from tests.simulator.effects import Effects
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine, State, machine_by_seed, running
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


# The gap law "contact"

PLAY = Machine((0.6, 2.0), (0.1, 0.2), (), (), (3000.0,), (20.0,), (0.02,), (2.0,), law="contact")


@BOTH
@pytest.mark.parametrize("place", [0.0, -0.02])
def test_a_shaft_in_its_gap_relaxes_and_passes_nothing_on(run, place):
    """Bodies at rest: twist - b falls with k / c; in the middle of the gap neither body is pulled."""
    made = run(PLAY, np.zeros(40), STEP, State((0.0, 0.0), (0.005,), places=(place,)))
    assert not made.speeds.any() and not made.shaft_torques.any() and not made.contact.any()
    left = (0.005 - place) * np.exp(-3000.0 / 20.0 * 40 * STEP)
    assert made.end.places[0] == pytest.approx(0.005 - left, abs=1e-13)


@BOTH
def test_a_shaft_leaves_one_side_with_its_torque_and_meets_the_other_with_its_place(run):
    """Bodies of great inertia: the twist is d0 + v t whatever the torque.

    At b = a the torque k (d - a) + c v ends at d = a - c v / k; the bend d - b that is left then relaxes on
    the way, so that the other side is met at d = -a, with the torque c v at once.
    """
    heavy = replace(PLAY, inertia=(1e9, 1e9), viscous=(), ratio=())
    made = run(heavy, np.zeros(150), STEP, State((-0.5, 0.0), (0.0503,)))
    twist, rest = 0.0503 - 0.5 * made.time, 20.0 * 0.5 / 3000.0
    expected = np.where(twist > 0.02 + rest, 3000.0 * (twist - 0.02) - 10.0, 0.0)
    expected = np.where(twist < -0.02, 3000.0 * (twist + 0.02) - 10.0, expected)
    np.testing.assert_allclose(made.shaft_torques[:, 0], expected, atol=1e-6)
    np.testing.assert_array_equal(made.contact[:, 0], np.sign(expected))
    assert made.events == {"contact_lost": 1, "contact_made": 1}


def gap_again(torque, first, inertia, half, k, c):
    """Two bodies without friction by the cases of db/dt, each with a solver of its own."""
    def rates(t, y, u, case):
        bend, twisting = y[2] - y[3], y[0] - y[1]
        moving = twisting + k / c * bend
        through = k * bend + c * twisting if case else 0.0
        return [(u - through) / inertia[0], through / inertia[1], twisting, 0.0 if case else moving]

    def torque_of(t, y, u, case):
        return case * (k * (y[2] - y[3]) + c * (y[0] - y[1])) if case else 1.0

    def room(t, y, u, case):
        return 1.0 if case else half - abs(y[3])

    torque_of.terminal = room.terminal = True
    torque_of.direction = room.direction = -1
    y, case, kept = np.array(first, float), 0, []
    for u in torque:
        t = 0.0
        kept.append(y)
        while t < STEP:
            made = solve_ivp(rates, (t, STEP), y, "DOP853", events=(torque_of, room), args=(u, case),
                             rtol=1e-12, atol=1e-14, max_step=2e-4)
            t, y = made.t[-1], made.y[:, -1]
            if made.status == 1:
                case = 0 if case else int(np.sign(y[3]))
                y[3] = case * half if case else y[3]
    return np.array(kept), y


@BOTH
def test_contact_agrees_with_an_integration_case_by_case(run):
    machine = Machine((0.6, 2.0), (), (), (), (3000.0,), (8.0,), (0.01,), law="contact")
    torque = waves(250, 20.0)
    made = run(machine, torque, STEP, State((0.3, 0.0), (0.0,), places=(0.004,)))
    expected, last = gap_again(torque, (0.3, 0.0, 0.0, 0.004), (0.6, 2.0), 0.01, 3000.0, 8.0)
    np.testing.assert_allclose(made.speeds, expected[:, :2], atol=1e-8)
    assert made.end.places[0] == pytest.approx(last[3], abs=1e-10)
    assert np.min(made.shaft_torques * made.contact) >= 0.0 and made.events["contact_lost"] > 3
    other = run(replace(machine, law="inside"), torque, STEP, State((0.3, 0.0), (0.0,)))
    assert np.max(np.abs(other.speeds - made.speeds)) > 1e-3


@BOTH
def test_without_damping_or_gap_contact_is_the_other_law(run):
    torque, start = waves(150, 20.0), State((0.3, 0.0), (0.005,))
    for changes in ({"damping": ()}, {"half_gap": ()}):
        machine = replace(PLAY, **changes)
        found, wanted = (run(replace(machine, law=law), torque, STEP, start) for law in ("contact", "inside"))
        np.testing.assert_array_equal(found.speeds, wanted.speeds)


def test_contact_in_a_chain_with_friction_is_the_same_in_both_simulators():
    machine = Machine((0.4, 0.7, 3.0), (0.1, 0.2, 0.3), (0.5, 0.3, 1.0), (0.0, 0.0, 2.0), (900.0, 400.0),
                      (5.0, 8.0), (0.01, 0.03), (2.0, 0.5), "contact", 433.0, 0.69, 0.0023, effects=Effects(
                          lugre_stiffness=(0.0, 2e3, 0.0), lugre_damping=(0.0, 1.0, 0.0)))
    slow, fast = (run(machine, waves(400, 15.0), STEP) for run in (simulate, simulate_fast))
    np.testing.assert_allclose(fast.speeds, slow.speeds, atol=1e-7)
    np.testing.assert_allclose(fast.end.places, slow.end.places, atol=1e-8)
    assert fast.events == slow.events and slow.events["contact_made"] > 3


def test_contact_wants_a_plain_shaft_and_a_place_within_the_gap():
    with pytest.raises(ValueError, match="constant stiffness"):
        replace(PLAY, effects=Effects(damping_torque=(5.0,)))
    for run in (simulate, simulate_fast):
        with pytest.raises(ValueError, match="not within the gaps"):
            run(PLAY, np.zeros(3), STEP, State((0.0, 0.0), (0.0,), places=(0.03,)))


# Losses of a transmission


def dry_again(rates, balance, first, torque, at):
    """(n, states) at the samples: rates(state, torque, s) of body `at` that slips in direction s, or sticks.

    balance  (sum of its torques at standstill, what it can hold against that sum) of a state and a torque
    """
    def direction(y, u):
        net, hold = balance(y, u)
        return np.sign(net) * (abs(net) > hold)

    def leaving(t, y, u, s):
        net, hold = balance(y, u)
        return s * y[at] if s else hold - abs(net)

    leaving.terminal, leaving.direction = True, -1
    kept, y = [], np.array(first, float)
    for u in torque:
        kept.append(y)
        t, s = 0.0, np.sign(y[at]) or direction(y, u)
        while t < STEP:
            made = solve_ivp(lambda _, y, u, s: rates(y, u, s), (t, STEP), y, "DOP853", events=leaving,
                             args=(u, s), rtol=1e-12, atol=1e-14)
            t, y = made.t[-1], made.y[:, -1]
            if made.status == 1:
                y[at] = 0.0 if s else y[at]
                s = direction(y, u) if s else np.sign(balance(y, u)[0])
    return np.array(kept)


LOSSY = Machine((0.6, 2.0), (0.1, 0.2), (0.0, 1.0), (0.0, 4.0), (3000.0,), (8.0,), (), (2.0,), effects=Effects(
    loss_driving=(0.2,), loss_driven=(0.5,)))
# The motor and its gear, whose rotor is half of the inertia.
GEARED = Machine((2.0,), (0.2,), (1.0,), (3.0,), effects=Effects(
    loss_driving=(0.2,), loss_driven=(0.5,), rotor_inertia=1.2))


@BOTH
@pytest.mark.parametrize(("speed", "load", "sent"), [(3.0, 10.0, 10.0 / 0.8), (-3.0, 10.0, 10.0 / 1.5),
                                                     (3.0, -10.0, -10.0 / 1.5), (-3.0, -10.0, -10.0 / 0.8)])
def test_efficiency_at_constant_speed(run, speed, load, sent):
    """A load of 10 Nm that is lifted wants 10 / (1 - 0.2) of the shaft, one that is let down 10 / (1 + 0.5)."""
    for machine in (replace(LOSSY, viscous=(), coulomb=(), idle_torque=()),
                    replace(GEARED, viscous=(), coulomb=(), idle_torque=())):
        start = running(machine, speed, load)
        made = run(machine, np.full(100, start.torque), STEP, start, load_torque=np.full(100, load))
        np.testing.assert_allclose(made.speeds[:, 0], speed, rtol=1e-11)
        np.testing.assert_allclose(made.shaft_torques, sent, rtol=1e-10)
        assert start.torque == pytest.approx(sent / (machine.ratio or (1.0,))[0], rel=1e-14)


@BOTH
@pytest.mark.parametrize(("torque", "speed", "rate"), [
    (9.0, 1.0, (9.0 * 0.8 - 4.0) / (2.0 - 0.2 * 1.2)),    # drives
    (0.0, 1.0, -4.0 / (2.0 - 0.2 * 1.2)),                 # the rotor drives while it runs out
    (-9.0, 3.0, (-9.0 * 1.5 - 4.0) / (2.0 + 0.5 * 1.2)),  # T = -9 + 1.2 * 6.7 brakes
    (-9.0, -1.0, (-9.0 * 0.8 - 2.0) / (2.0 - 0.2 * 1.2)), # drives the other way, with the idle torque
    (9.0, -3.0, (9.0 * 1.5 - 2.0) / (2.0 + 0.5 * 1.2))])  # T = 9 - 1.2 * 4.4 brakes
def test_the_rotor_takes_its_torque_before_the_loss(run, torque, speed, rate):
    made = run(replace(GEARED, viscous=()), np.full(100, torque), STEP, State((speed,), ()))
    np.testing.assert_allclose(made.speeds[:, 0], speed + rate * made.time, rtol=1e-12)


@BOTH
def test_a_lossy_gear_sticks_between_lifting_and_letting_down(run):
    """Idle torque 3, Coulomb 1: it lifts above (3 + 1) / (1 - 0.2), and comes down below (3 - 1) / (1 + 0.5)."""
    for levels, bound, sign in ((np.linspace(3.0, 6.0, 301), 5.0, 1), (np.linspace(3.0, 0.0, 301), 4.0 / 3.0, -1)):
        made = run(GEARED, levels, STEP)
        first = made.command[~made.stuck[:, 0]][0]
        assert 0.0 <= sign * (first - bound) <= 0.011 and sign * made.speeds[-1, 0] > 0.0
        assert not made.speeds[made.stuck].any()
    # Without an idle torque the motor frees it above 1 / (1 - 0.2); a load torque alone above 1.
    plain = replace(GEARED, idle_torque=())
    assert not run(plain, np.full(50, 1.2499), STEP).speeds.any()
    assert run(plain, np.full(50, 1.2501), STEP).end.speeds[0] > 0.0
    for load, free in ((0.999, False), (1.001, True)):
        made = run(plain, np.zeros(50), STEP, load_torque=np.full(50, load))
        assert (made.end.speeds[0] < 0.0) == free


@BOTH
def test_losses_behind_a_shaft_agree_with_a_general_solver(run):
    def through(y):
        return 3000.0 * y[2] + 8.0 * (y[0] / 2.0 - y[1])

    def balance(y, u):
        torque = through(y)
        net = torque - 0.2 * y[1] - 4.0
        return net, 1.0 + (0.2 if net * torque > 0.0 else 0.5) * abs(torque)

    def rates(y, u, s):
        torque = through(y)
        dry = s * (1.0 + (0.2 if s * torque > 0.0 else 0.5) * abs(torque))
        return [(u - 0.1 * y[0] - torque / 2.0) / 0.6, (torque - 0.2 * y[1] - 4.0 - dry) / 2.0 if s else 0.0,
                y[0] / 2.0 - y[1]]

    torque = 1.0 + waves(300, 3.0)
    made = run(LOSSY, torque, STEP)
    expected = dry_again(rates, balance, (0.0, 0.0, 0.0), torque, 1)
    np.testing.assert_allclose(made.speeds, expected[:, :2], atol=1e-9)
    assert made.events["stuck"] > 1 and np.ptp(np.sign(made.shaft_torques)) == 2.0
    np.testing.assert_array_equal(made.stuck[1:, 1], made.speeds[1:, 1] == 0.0)


@BOTH
def test_losses_of_one_body_agree_with_a_general_solver(run):
    """T from its equation J (u - T) / Jr = u - R - friction(T) by a search, and with it the acceleration."""
    def balance(y, u):
        net = u - 0.2 * y[0] - 3.0
        return net, 1.0 + (0.2 if net * u > 0.0 else 0.5) * abs(u)

    def rates(y, u, s):
        def unfit(torque):
            dry = s * (1.0 + (0.2 if s * torque > 0.0 else 0.5) * abs(torque))
            return 2.0 * (u - torque) / 1.2 - (u - 0.2 * y[0] - 3.0 - dry)

        return [(u - brentq(unfit, -1e3, 1e3, xtol=1e-14, rtol=1e-14)) / 1.2 if s else 0.0]

    torque = 2.8 + waves(250, 4.0)
    made = run(GEARED, torque, STEP)
    expected = dry_again(rates, balance, (0.0,), torque, 0)
    np.testing.assert_allclose(made.speeds, expected, atol=1e-10)
    assert made.events["stuck"] > 1 and np.ptp(np.sign(made.speeds)) == 2.0


@pytest.mark.parametrize("law", ["inside", "always", "contact"])
def test_losses_in_a_chain_with_gaps_are_the_same_in_both_simulators(law):
    machine = Machine((0.4, 0.7, 3.0), (0.1, 0.2, 0.3), (0.5, 0.0, 1.0), (0.0, 0.0, 2.0), (900.0, 400.0),
                      (5.0, 8.0), (0.01, 0.03), (2.0, 0.5), law, 433.0, 0.69, 0.0023, effects=Effects(
                          loss_driving=(0.1, 0.3), loss_driven=(0.4, 0.2), ripple=(0.3, 6.0, 0.0)))
    slow, fast = (run(machine, waves(300, 15.0), STEP) for run in (simulate, simulate_fast))
    np.testing.assert_allclose(fast.speeds, slow.speeds, atol=1e-7)
    assert fast.events == slow.events and slow.events["contact_made"] > 3 and slow.events["stuck"] >= 1


def test_losses_of_one_body_with_ripple_and_converter_are_the_same_in_both_simulators():
    machine = replace(GEARED, converter_bandwidth=433.0, effects=replace(GEARED.effects, ripple=(0.7, 9.0, 0.4)))
    noise = 0.1 * np.random.default_rng(4).standard_normal(300)
    torque = 2.8 + waves(300, 4.0)
    slow, fast = (run(machine, torque, STEP, torque_noise=noise) for run in (simulate, simulate_fast))
    np.testing.assert_allclose(fast.speeds, slow.speeds, atol=1e-9)
    assert fast.events == slow.events and slow.events["stuck"] > 1


def test_losses_have_bounds():
    for changes, message in (({"loss_driven": (0.95,)}, "between 0 and 0.9"), ({"rotor_inertia": 2.0}, "a part of"),
                             ({"lugre_stiffness": (1e4,)}, "not on a body with LuGre")):
        with pytest.raises(ValueError, match=message):
            replace(GEARED, effects=replace(GEARED.effects, **changes))
    with pytest.raises(ValueError, match="of one body alone"):
        replace(LOSSY, effects=Effects(rotor_inertia=0.1))
