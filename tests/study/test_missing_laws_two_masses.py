"""The two-mass study's own parts: the simulator against closed forms and two others, sizes, truth, figures."""

from dataclasses import replace

import numpy as np
import pytest

from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine as Chain
from tests.study.missing_laws import kernel as one_body
from tests.study.missing_laws.laws import SIZES, Law
from tests.study.missing_laws.machine import Machine as Rigid
from tests.study.two_masses import kernel
from tests.study.two_masses.estimators import HALF_GAP, NAMES, fit, start_values
from tests.study.two_masses.laws import LAWS, MOST, THIRD_MASSES, Placed
from tests.study.two_masses.machine import NAMES as NUMBERS, Machine, draw_machine
from tests.study.two_masses.record import (
    BEHIND_GAP,
    RIGHT,
    STEP,
    arrange,
    draw,
    observed,
    parts_of,
    root_mean_square,
    simulate,
    truth_of,
)
from tests.study.two_masses.runner import LAYOUT, run
from tests.study.two_masses.scores import ABOUT, friction_half, score
from tests.study.two_masses.tables import summary

PLAIN = Placed(Law("none"), 0)
# Without friction; 20 Hz with the motor held.
FREE = {"motor.inertia": 0.02, "load.inertia": 0.03, "shaft.stiffness": 0.03 * (40.0 * np.pi) ** 2} | dict.fromkeys(
    NUMBERS[3:], 0.0)
CONSTANTS = {
    "asymmetry": {"side": 1.0, "dry": 0.5, "speed": 3.0}, "stribeck": {"speed": 2.0, "shape": 1.0},
    "warm-up": {"time": 0.3}, "cogging": {"periods": 5.0, "phase": 0.4}, "gravity": {"phase": 0.3},
    "crank": {"phase": 0.7}, "dry": {}, "drag": {}}


def machine_of(**changes):
    """FREE with other values, dots in the names as underscores."""
    values = FREE | {name: changes[name.replace(".", "_")] for name in FREE if name.replace(".", "_") in changes}
    return Machine(Rigid(1.0, 100.0, values["motor.inertia"] + values["load.inertia"], 0.0, 0.0, 0.0), values)


def record_of(machine, law=PLAIN, motor=None, load=None, n=400, step=1e-3, parts=8, **start):
    """(n + 1, STATES) under torques [N m] on motor and load, (n,) or one for all; start: states by name."""
    first, rest, extra = np.zeros(kernel.STATES), np.zeros(n), np.zeros((n, 2))
    for name, value in start.items():
        first[getattr(kernel, name)] = value
    extra[:, 0], extra[:, 1] = 0.0 if motor is None else motor, 0.0 if load is None else load
    controller = np.array([1e9, 0.0, 0.0, 0.0, 0.0, 1e9])  # without a limit of the speed
    return kernel.run(step, parts, first, kernel.OPEN, rest, rest, rest, controller, law.code, law.body,
                      machine.numbers(), law.numbers(machine), extra, rest, 0.0, False)[2]


def a_torque(n, seed=5):
    """(n,) [N m] random levels that reverse."""
    return np.repeat(np.random.default_rng(seed).normal(0.0, 0.5, n // 40 + 1), 40)[:n]


def test_a_free_drive_under_a_constant_torque():
    states, t = record_of(machine_of(), motor=0.4), 1e-3 * np.arange(401)
    rate = 40.0 * np.pi * np.sqrt(0.05 / 0.02)
    slip = 0.4 / (0.02 * rate) * np.sin(rate * t)
    np.testing.assert_allclose(states[:, kernel.VM], (0.4 * t + 0.03 * slip) / 0.05, atol=1e-6)
    np.testing.assert_allclose(states[:, kernel.VM] - states[:, kernel.VL], slip, atol=1e-6)
    assert np.ptp(slip) > 0.1


def test_standing_bodies_hold_and_break_loose_at_their_friction():
    machine, dry = machine_of(motor_coulomb=0.2, shaft_damping=1.0), Placed(Law("dry", 0.3), 1)
    assert np.all(record_of(machine, dry, motor=0.19) == 0.0)
    twisted = record_of(machine, dry, motor=0.3)  # 0.1 on the shaft in the mean, 0.2 at most
    assert np.all(twisted[:, kernel.VL] == 0.0) and np.all(twisted[-1, :2] == 0.0)
    assert 0.1 < FREE["shaft.stiffness"] * twisted[-1, kernel.TWIST] < 0.2
    both = record_of(machine, dry, motor=0.7, n=4000)
    assert both[-1, kernel.VM] == pytest.approx(both[-1, kernel.VL], abs=1e-6)
    assert both[-1, kernel.VM] - both[-1001, kernel.VM] == pytest.approx((0.7 - 0.5) / 0.05, rel=1e-6)


@pytest.mark.parametrize("half_gap", [0.0, 2e-4])
def test_the_simulator_of_the_other_tests_gives_the_same(half_gap):
    machine = machine_of(motor_viscous=0.004, load_viscous=0.003, motor_coulomb=0.12, motor_idle_torque=0.03,
                         load_idle_torque=-0.02, shaft_damping=0.2, shaft_half_gap=half_gap)
    v, torque = machine.values, 0.5 * a_torque(1000)
    chain = Chain((v["motor.inertia"], v["load.inertia"]), (0.004, 0.003), (0.12, 0.08), (0.03, -0.02),
                  (v["shaft.stiffness"],), (0.2,), (half_gap,))
    other = simulate_fast(chain, torque, 1e-3, finer=8)
    found = record_of(machine, Placed(Law("dry", 0.08), 1), torque, n=1000)[:-1]
    for i, column in enumerate((kernel.VM, kernel.VL)):
        np.testing.assert_allclose(found[:, column], other.speeds[:, i], atol=1e-5 * np.ptp(found[:, kernel.VM]))
    assert other.events["stuck"] > 5 and (other.events["contact_made"] > 10 or half_gap == 0.0)


@pytest.mark.parametrize("is_angle", [False, True])
def test_the_one_body_simulator_gives_the_same_loop_around_an_elastic_shaft(is_angle):
    law = Law("elastic-shaft", 0.6, {"frequency": 25.0, "damping": 0.03})
    rigid = Rigid(1.0, 100.0, 0.05, 0.01, 0.1, 0.03)
    stiffness, damping = law.numbers(rigid)[1:3]
    machine = machine_of(shaft_stiffness=stiffness, shaft_damping=damping, motor_viscous=0.01, motor_coulomb=0.1,
                         motor_idle_torque=0.03)
    n, rng = 800, np.random.default_rng(3)
    rest, noise, speeds = np.zeros(n), 0.01 * rng.standard_normal(n), 8.0 * a_torque(n)
    loop = (kernel.POSITION, rest, speeds, 1e-3 * np.cumsum(speeds), np.array([0.6, 3.0, 2.0, 0.2, 1.5, np.inf]))
    torque, sensor, states = kernel.run(
        1e-3, 8, np.zeros(kernel.STATES), *loop, kernel.PLAIN, 0, machine.numbers(), np.zeros(4),
        np.zeros((n, 2)), noise, 0.0, is_angle)
    other = one_body.run(1e-3, 8, np.zeros(one_body.STATES), *loop, law.code, rigid.numbers(), law.numbers(rigid),
                         rest, noise, 0.0, is_angle)
    np.testing.assert_allclose(torque, other[0], atol=1e-5)
    np.testing.assert_allclose(sensor, other[1], atol=1e-6)
    np.testing.assert_allclose(states[:, kernel.VL], other[2][:, one_body.V2], atol=1e-6)
    assert np.ptp(states[:, kernel.VM]) > 3.0


@pytest.mark.parametrize("name", ["asymmetry", "stribeck", "warm-up", "cogging", "gravity", "crank"])
def test_a_law_on_a_motor_with_hardly_a_load_is_that_of_the_one_body_simulator(name):
    law = Law(name, 0.3, CONSTANTS[name])
    machine = machine_of(load_inertia=1e-11, shaft_stiffness=1e-11 * 1e4, motor_coulomb=0.05, motor_viscous=0.01)
    rigid, torque, rest = Rigid(1.0, 100.0, 0.02, 0.01, 0.05, 0.0), a_torque(500), np.zeros(500)
    other = one_body.run(1e-3, 8, np.zeros(one_body.STATES), one_body.OPEN, torque, rest, rest,
                         np.array([1e9, 0.0, 0.0, 0.0, 0.0, 1e9]), law.code, rigid.numbers(), law.numbers(rigid),
                         rest, rest, 0.0, False)[2]
    found = record_of(machine, Placed(law, 0), torque, n=500)
    np.testing.assert_allclose(found[:, kernel.VM], other[:, one_body.V], atol=1e-6)
    assert np.ptp(found[:, kernel.VM]) > 1.0


@pytest.mark.parametrize("name", CONSTANTS)
def test_a_law_on_the_load_is_that_on_the_motor_of_the_exchanged_drive(name):
    law, torque = Law(name, {"drag": 0.05, "crank": 0.5}.get(name, 0.2), CONSTANTS[name]), a_torque(500)
    one = record_of(machine_of(shaft_damping=0.1), Placed(law, 0), torque, n=500)
    swapped = machine_of(motor_inertia=0.03, load_inertia=0.02, shaft_damping=0.1)
    # The angle of the load is that of the motor less the twist, so that both start at zero.
    other = record_of(swapped, Placed(law, 1), load=torque, n=500)
    np.testing.assert_allclose(one[:, kernel.VM], other[:, kernel.VL], atol=2e-6)
    plain = record_of(machine_of(shaft_damping=0.1), PLAIN, torque, n=500)
    assert np.abs(one - plain)[:, kernel.VM].max() > 0.05


def test_drag_has_its_terminal_speed():
    states = record_of(machine_of(shaft_damping=0.3), Placed(Law("drag", 0.02), 1), motor=0.5, n=6000, parts=4)
    assert states[-1, :2] == pytest.approx([5.0, 5.0], rel=1e-6)


def test_a_gap_and_a_weight_on_the_load_keep_energy():
    machine, law = machine_of(shaft_half_gap=1e-3), Placed(Law("gravity", 0.5, {"phase": 0.3}), 1)
    states = record_of(machine, law, n=1000, VM=1.0, VL=-0.7)
    twist, angle = states[:, kernel.TWIST], states[:, kernel.QM] - states[:, kernel.TWIST]
    stretch = np.maximum(np.abs(twist) - 1e-3, 0.0)
    kinetic = 0.5 * (0.02 * states[:, kernel.VM]**2 + 0.03 * states[:, kernel.VL]**2)
    energy = kinetic + 0.5 * FREE["shaft.stiffness"] * stretch**2 + 0.5 * np.sin(angle + 0.3)
    assert np.ptp(energy) < 1e-7 and np.ptp(kinetic) > 1e-3
    assert np.sum(np.diff(stretch > 0.0)) > 50  # contacts made and lost


def test_a_third_mass_keeps_momentum_and_the_inertia_of_the_load():
    law = Placed(Law("third-mass", 0.4, {"frequency": 60.0, "damping": 0.0}), 1)
    states = record_of(machine_of(), law, motor=0.4, parts=16)
    momentum = states[:, [kernel.VM, kernel.VL, kernel.V3]] @ [0.02, 0.6 * 0.03, 0.4 * 0.03]
    np.testing.assert_allclose(momentum, 0.4 * 1e-3 * np.arange(401), atol=1e-12)
    mass, stiffness, _, _ = law.numbers(machine_of())
    spring = stiffness * states[:, kernel.TWIST3]**2 + FREE["shaft.stiffness"] * states[:, kernel.TWIST]**2
    energy = 0.5 * (states[:, [kernel.VM, kernel.VL, kernel.V3]]**2 @ [0.02, 0.018, mass] + spring)
    np.testing.assert_allclose(energy, 0.4 * states[:, kernel.QM], rtol=1e-5, atol=1e-9)


# Records


@pytest.mark.parametrize("situation", LAWS)
def test_a_law_of_size_zero_is_the_plain_machine(situation):
    setup, law = arrange(situation, "", 3, 40, 1.0)
    setup = replace(setup, quantum=0.0)
    with_law, without = simulate(setup, law.at(0.0)), simulate(setup, PLAIN)
    np.testing.assert_allclose(with_law.states[:, :4], without.states[:, :4],
                               atol=1e-9 * np.abs(without.states[:, :4]).max())


@pytest.mark.parametrize("situation", (*LAWS, *BEHIND_GAP))
def test_a_size_is_a_share_of_rated_torque(situation):
    setup, law = arrange(situation, "M", 6, 7, 3.0)
    run = simulate(setup, law)
    missing, name = observed(setup, law, run)[1] / setup.machine.rated_torque, situation.partition(".")[2]
    share = truth_of(setup, law, run).share
    assert share == pytest.approx(root_mean_square(missing), rel=1e-12)
    if name in MOST:
        unit = setup.machine.rated_torque / setup.machine.rated_speed**2 if name == "drag" else 1.0
        assert share == pytest.approx(SIZES["M"], rel=0.1) or law.law.strength > 0.95 * MOST[name] * unit
    elif name == "log-noise":
        assert share == pytest.approx(SIZES["M"], rel=0.05)
    elif name == "gap":  # a shaft without the gap would carry its stiffness times the half gap more
        assert np.abs(missing).max() == pytest.approx(0.1, rel=1e-6)
    elif name == "third-mass":
        assert law.numbers(setup.machine)[0] == THIRD_MASSES["M"] * setup.machine.values["load.inertia"]
    else:
        assert SIZES["M"] * 0.8 < np.quantile(np.abs(missing), 0.999) < SIZES["M"] * 1.001


@pytest.mark.parametrize("situation", ["motor.crank", "load.crank", "load.third-mass", "load.drag", "load.gravity"])
def test_what_is_missing_is_what_the_balance_of_a_body_lacks(situation):
    setup, law = arrange(situation, "L", 2, 6, 2.0)
    setup = replace(setup, disturbance=0.0 * setup.disturbance)
    run, v = simulate(setup, law), setup.machine.values
    shaft, missing = observed(setup, law, run)
    which, body = law.body, ("motor", "load")[law.body]
    speed = run.states[:, which]
    known = run.held[:, 0] - shaft if which == 0 else shaft
    known = known - v[f"{body}.idle_torque"] - v[f"{body}.viscous"] * speed[:-1]
    if which == 0:
        known = known - v["motor.coulomb"] * np.sign(speed[:-1])
    # Half of each end of an interval in which nothing jumps.
    steady = (run.held[1:-1, 0] == run.held[2:, 0]) & (np.sign(speed[1:-2]) == np.sign(speed[2:-1]))
    lacking = v[f"{body}.inertia"] * np.diff(speed)[1:-1] / STEP - 0.5 * (known[1:-1] + known[2:])
    middle = 0.5 * (missing[1:-1] + missing[2:])
    assert steady.mean() > 0.3
    assert np.corrcoef(lacking[steady], middle[steady])[0, 1] > 0.99
    assert np.std(lacking[steady]) == pytest.approx(np.std(middle[steady]), rel=0.05)


@pytest.mark.parametrize("situation", ("quiet", "gap+quiet", *LAWS))
def test_the_integrators_error_is_that_of_less_than_a_ten_thousandth_of_the_inertia(situation):
    setup, law = arrange(situation, "" if "quiet" in situation else "L", 4, 60, 1.0)
    before, p, a = simulate(setup, law), setup.machine.numbers(), law.numbers(setup.machine)
    parts, end, work = parts_of(setup, law), np.zeros(kernel.STATES), np.zeros((5, kernel.STATES))
    changes = []
    for i in range(0, len(before.held), 5):  # every fifth sample, from the same state, so that no chaos counts
        speeds = []
        for each in (parts, 2 * parts):
            y = before.states[i].copy()
            kernel.over_sample(y, end, work, np.zeros(5), np.zeros(3, np.int64), i * STEP, STEP, each,
                               *before.held[i], law.code, law.body, p, a)
            speeds.append(y[:2] - before.states[i, :2])
        changes.append(speeds)
    coarse, fine = np.array(changes).transpose(1, 0, 2)
    assert np.linalg.norm(coarse - fine) < 1e-4 * np.linalg.norm(fine)


def test_records_are_varied_and_half_of_them_are_in_closed_loop():
    drawn = [draw(right, "", number, 500 + number, 4.0) for number in range(8) for right in ("white", "gap+slow")]
    assert sum(record.closed for record in drawn) == len(drawn) // 2
    assert len({record.excitation for record in drawn}) == 8
    sensors = {tuple(record.channels)[1:] for record in drawn}
    assert {roles[0] for roles in sensors} == {"motor_speed", "motor_angle"}
    assert {roles[1:] for roles in sensors} == {(), ("load_speed",), ("shaft_torque",)}
    for record in drawn:
        assert {len(values) for values in record.channels.values()} == {4000}
        assert record.gap == (record.truth.half_gap > 0.0) == (record.truth.crossings > 0.0)
    machines = [draw_machine(np.random.default_rng(seed)) for seed in range(40)]
    shares = [m.values["load.inertia"] / m.rigid.inertia for m in machines]
    resonances = [m.antiresonance for m in machines]
    assert 0.25 <= min(shares) < 0.35 and 0.7 < max(shares) <= 0.8
    assert 8.0 <= min(resonances) < 10.0 and 30.0 < max(resonances) <= 35.0


def test_load_sensors_measure_speed_and_torque_of_the_shaft():
    found = {}
    for seed in range(30):
        setup, law = arrange("noise-free", "", 1, seed, 1.0)
        found.setdefault(setup.second, (seed, setup, simulate(setup, law)))
    seed, setup, run = found["shaft_torque"]
    v, torque = setup.machine.values, draw("noise-free", "", 1, seed, 1.0).channels["shaft_torque"]
    np.testing.assert_allclose(
        torque, v["shaft.stiffness"] * run.states[:-1, kernel.TWIST]
        + v["shaft.damping"] * (run.states[:-1, kernel.VM] - run.states[:-1, kernel.VL]), rtol=1e-12)
    seed, _, run = found["load_speed"]
    speed = draw("noise-free", "", 1, seed, 1.0).channels["load_speed"]
    np.testing.assert_array_equal(speed, run.states[:-1, kernel.VL])


def test_the_truth_of_a_law_is_referred_to_the_motor():
    def extra(situation, size="L"):
        record = draw(situation, size, 1, 70, 3.0)
        rigid = record.machine.rigid
        return record.truth, record.truth.curve - rigid.coulomb - rigid.viscous * record.truth.speeds, rigid

    truth, more, rigid = extra("load.dry")
    assert more == pytest.approx(SIZES["L"] * rigid.rated_torque)
    assert truth.line == pytest.approx((rigid.viscous, rigid.coulomb + SIZES["L"] * rigid.rated_torque), rel=1e-6)
    truth, more, rigid = extra("load.asymmetry")
    assert abs(truth.idle - rigid.idle) == pytest.approx(np.mean(more), rel=1e-9)
    truth, more, rigid = extra("motor.drag")
    assert np.sqrt(more / more[-1]) == pytest.approx(truth.speeds / truth.speeds[-1], rel=1e-9)
    plain, _, _ = extra("white", "")
    third, _, _ = extra("load.third-mass")
    assert (third.motor_inertia, third.load_inertia) == (plain.motor_inertia, plain.load_inertia)
    gap, more, _ = extra("shaft.gap")
    assert gap.half_gap == pytest.approx(0.3 * gap.rated / gap.stiffness) and third.half_gap == 0.0
    assert np.all(np.abs(more) < 1e-9 * gap.rated)


# The command line


def test_start_values_are_about_the_truth_and_guesses_where_more_is_freed():
    record = draw("load.dry", "M", 1, 104, 2.0)
    starts = [start_values(record, seed) for seed in range(60)]
    assert HALF_GAP not in starts[0] and "load.coulomb" not in starts[0]
    off = np.log([[start[name] / record.machine.values[name] for name in starts[0]] for start in starts])
    assert np.std(off) == pytest.approx(0.15, rel=0.1) and abs(np.mean(off)) < 0.03
    freed = start_values(record, 1, ("load.coulomb", HALF_GAP))
    assert freed["load.coulomb"] > 0.0 and freed[HALF_GAP] > 0.0
    gap = draw("gap+white", "", 1, 104, 2.0)
    assert start_values(gap, 1)[HALF_GAP] == pytest.approx(gap.truth.half_gap, rel=0.5)


@pytest.mark.slow
@pytest.mark.parametrize(("situation", "estimator", "bound"), [
    ("noise-free", "simulation", 1e-3), ("gap+noise-free", "innovations", 1e-5),
    ("load.dry", "innovations+load.coulomb", 0.02)])
def test_the_command_line_regains_a_right_model(situation, estimator, bound):
    record = draw(situation, "M" if "." in situation else "", 2, 108, 2.0)
    found = fit(record, 2, estimator)
    row = {"gap": record.gap, "truth": {name: getattr(record.truth, name) for name in vars(record.truth)}} | found
    errors = score(row)
    assert max(errors.motor_inertia, errors.load_inertia, errors.stiffness, errors.friction) < bound
    assert errors.half_gap < bound if record.gap else np.isnan(errors.half_gap)


# Figures


def made_up(error=0.0, half=0.02, gap=False, total=True, link=0.0):
    """A row whose estimates are all `error` off, with intervals of half-width `half`, in shares of the truth."""
    true = {"motor.inertia": 2.0, "load.inertia": 3.0, "shaft.stiffness": 50.0, "shaft.half_gap": 0.1,
            "motor.coulomb": 1.0} | ({"total.viscous": 0.1, "total.idle_torque": 0.5} if total else {
                "motor.viscous": 0.04, "load.viscous": 0.06, "motor.idle_torque": 0.3, "load.idle_torque": 0.2})
    if not gap:
        del true["shaft.half_gap"]
    value = [true[name] * (1.0 + error) if name in true else None for name in NAMES]
    matrix = np.eye(len(NAMES))
    for one, two in (("motor.viscous", "load.viscous"), ("total.viscous", "motor.coulomb")):
        i, j = NAMES.index(one), NAMES.index(two)
        matrix[i, j] = matrix[j, i] = link
    return {"truth": {"motor_inertia": 2.0, "load_inertia": 3.0, "stiffness": 50.0, "half_gap": 0.1 * gap,
                      "idle": 0.5, "rated": 10.0, "speeds": [5.0, 10.0, 15.0], "curve": [1.5, 2.0, 2.5],
                      "line": [0.1, 1.0], "marks": [5.0, 10.0, 14.0], "share": 0.05, "crossings": 0.0},
            "gap": gap, "value": value, "correlation": matrix.tolist(), "seconds": 1.0,
            "status": [None if x is None else "fitted" for x in value],
            "ci95": [None if x is None else [x - half * abs(true[n]), x + half * abs(true[n])]
                     for n, x in zip(NAMES, value, strict=True)]}


def test_scores_of_made_up_rows():
    found = score(made_up(error=-0.05))
    assert (found.motor_inertia, found.load_inertia, found.stiffness, found.idle) == pytest.approx(
        (0.05, 0.05, 0.05, 0.0025))
    assert np.isnan(found.half_gap) and np.isnan(found.over["half gap"]).all()
    assert found.friction == pytest.approx(0.05 * np.sqrt((1.5**2 + 2.0**2 + 2.5**2) / 3) / 2.0)
    assert found.over["motor inertia"] == pytest.approx([2.5])
    assert found.over["friction"][1] == pytest.approx(0.05 * 2.0 / (0.02 * np.sqrt(2.0)))
    assert found.stiffness_half == pytest.approx(0.02)
    gap = score(made_up(error=0.1, gap=True, total=False))
    assert gap.half_gap == pytest.approx(0.1) and gap.over["half gap"] == pytest.approx([5.0])
    assert gap.friction == pytest.approx(2.0 * found.friction)  # the parts count as their sum
    half_width = friction_half(made_up(total=False, link=-1.0), np.array([10.0]))
    assert half_width == pytest.approx([0.02 * np.hypot(1.0, 10.0 * (0.06 - 0.04))])
    failed = score({"failed": "so", "seconds": 2.0, "gap": True})
    assert failed.stiffness == failed.half_gap == np.inf and np.isnan(failed.over["friction"]).all()


def test_a_friction_without_an_interval_has_none_and_one_that_is_held_counts_as_known():
    row = made_up(total=False)
    load = NAMES.index("load.viscous")
    row["ci95"][load] = None
    assert np.isnan(friction_half(row, np.array([5.0]))).all()
    row["status"][load] = "held"
    assert friction_half(row, np.array([5.0])) == pytest.approx([0.02 * np.hypot(1.0, 5.0 * 0.04)])


def test_a_table_says_who_errs_by_how_much_more_and_which_intervals_hold():
    found = []
    for i in range(10):
        for name, error in (("auto", 0.03), ("innovations", 0.01)):
            for law, size, gap in (("load.dry", "M", False), ("gap+white", "", True), ("shaft.gap", "M", False)):
                about = {"key": f"{law}/{size}/{i}/1/{name}", "law": law, "size": size, "seed": i}
                found.append(made_up(error, gap=gap) | about | {"estimator": name, "sensors": "motor_speed"})
    table = summary(found, "innovations")

    def cells(title, name):
        part = next(part for part in table.split("\n\n") if part.startswith(title))
        return next(line for line in part.splitlines() if line.startswith(f"{name}  ")).removeprefix(name).split()

    assert table.startswith("30 records with all of auto, innovations; ")
    assert " ".join(cells("error of the stiffness", "M load")) == "3.00 / 3.00 1.00 / 1.00 10"
    assert " ".join(cells("error of the half gap", "gap+white")) == "3.00 / 3.00 1.00 / 1.00 10"
    assert "M load" not in table.split("error of the half gap")[1].split("\n\n")[0]
    assert cells("error over that of innovations", "M auto")[:8] == ["3.00", "(3.00-3.00)"] * 4
    assert cells("95 %", "M innovations")[:2] == ["100", "(59-100)"]
    assert cells("95 %", "M load auto")[:2] == ["0", "(0-41)"]
    assert cells("95 %", "M gap left out auto")[-4:] == ["0", "(0-41)", "0", "10"]
    blind = [row | {"ci95": [None] * len(NAMES)} if row["law"] == "shaft.gap" else row for row in found]
    row = next(line for line in summary(blind).splitlines() if line.startswith("M gap left out auto  "))
    assert row.split()[-8:] == ["-", "-", "-", "-", "-", "-", "10", "10"]  # without an interval none misleads
    assert cells("by sensors, error of the stiffness", "law motor_speed")[0] == "3.00"
    assert cells("share of rated", "load.dry") == ["nan", "5.0", "nan", "10"]
    assert set(ABOUT) == {"motor inertia", "load inertia", "stiffness", "friction", "half gap"}


def test_a_ratio_over_kinds_of_one_record_each_has_an_interval():
    laws = LAWS[:6]
    found = [made_up(error * (1.0 + i)) | {"key": f"{law}/M/{i}/1/{name}", "law": law, "size": "M", "seed": i,
                                           "estimator": name, "sensors": "motor_speed"}
             for i, law in enumerate(laws) for name, error in (("auto", 0.03 if i % 2 else 0.01), ("other", 0.02))]
    part = next(part for part in summary(found, "other").split("\n\n") if part.startswith("error over"))
    low, high = part.splitlines()[2].split()[3].strip("()").split("-")
    assert float(low) < float(high)


def test_every_kind_of_record_has_a_seed_of_its_own_and_a_row(tmp_path, monkeypatch):
    wanted = LAYOUT.jobs(2, 3, ("innovations",))
    assert len({job.seed for job in wanted}) == len(wanted) == 2 * 3 * len((*LAWS, *BEHIND_GAP)) + 3 * len(RIGHT)
    monkeypatch.setattr("tests.study.two_masses.runner.fit", lambda record, *_: made_up(0.01, gap=record.gap))
    monkeypatch.setattr("tests.study.two_masses.runner.warm_up", lambda estimators: None)
    some = [job for job in wanted if job.situation in ("gap+white", "load.load-steps")][:2]
    assert some
    found = run(some, tmp_path / "rows.jsonl", 1)
    assert [row["key"] for row in found] == [job.key("innovations") for job in some]
    assert all(row["sensors"].startswith("motor_") for row in found)
    assert "innovations" in summary(found)
