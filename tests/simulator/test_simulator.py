"""The simulator's own proof: closed forms, conservation, its linear twin, and independence."""

import ast
import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from tests import coast_fixtures, make_fixtures
from tests.places import FIXTURES, ROOT
from tests.simulator import experiments, records
from tests.simulator.controllers import SpeedPI
from tests.simulator.linear import equations
from tests.simulator.machine import Machine, State, machine_by_seed, running
from tests.simulator.simulate import Sensor, quantise, simulate, simulate_linear

HERE = ROOT / "tests"
STEP = 1e-3
CHAIN = Machine((0.4, 0.7, 3.0), (0.1, 0.2, 0.3), (), (1.0, 0.5, 2.0), (900.0, 400.0), (0.5, 0.8), (),
                (2.0, 0.5), "inside", 433.0, 0.69, 0.0023)


def ones(n, level=1.0):
    return np.full(n, float(level))


def excitation(machine, n, seed, hold=40, share=0.25):
    """(n,) random torque levels, held for `hold` samples."""
    levels = np.random.default_rng(seed).uniform(-1.0, 1.0, -(-n // hold))
    return share * machine.rated_torque * np.repeat(levels, hold)[:n]


# Closed forms


def test_torque_step_on_a_free_two_mass_drive():
    machine = Machine((0.587, 5.179), stiffness=(3310.0,))
    run = simulate(machine, ones(400, 50.0), STEP)
    total, product = sum(machine.inertia), np.prod(machine.inertia)
    resonance = np.sqrt(3310.0 * total / product)
    expected = 5.179 / total * (1.0 - np.cos(resonance * run.time)) * 50.0
    np.testing.assert_allclose(run.shaft_torques[:, 0], expected, atol=1e-8)
    np.testing.assert_allclose(run.speeds @ machine.inertia, 50.0 * run.time, atol=1e-10)


def test_resonance_and_relative_damping_of_the_thesis_rig():
    rates = np.linalg.eigvals(equations(make_fixtures.RIG)[0])
    pair = rates[np.argmax(rates.imag)]
    total, product = 0.587 + 5.179, 0.587 * 5.179
    assert abs(pair) / (2.0 * np.pi) == pytest.approx(12.60, abs=0.011)
    assert -pair.real / abs(pair) == pytest.approx(
        3.115 / 2.0 * np.sqrt(total / (3310.0 * product)), rel=2e-3)


def test_coast_down_stops_at_the_analytic_time_and_place_and_stays():
    inertia, viscous, coulomb, first = 2.0, 0.3, 1.7, 0.9
    machine = Machine((inertia,), (viscous,), (coulomb,))
    run = simulate(machine, np.zeros(1500), STEP, State((first,), ()))
    decay, floor = viscous / inertia, coulomb / viscous
    stop = np.log1p(first / floor) / decay
    before, after = run.time < stop, run.time > stop
    expected = (first + floor) * np.exp(-decay * run.time) - floor
    np.testing.assert_allclose(run.speeds[before, 0], expected[before], atol=1e-11)
    assert after.sum() > 100 and np.all(run.speeds[after] == 0.0) and np.all(run.stuck[after])
    assert not run.stuck[before].any() and run.events == {"stuck": 1}
    way = (first + floor) * (1.0 - np.exp(-decay * stop)) / decay - floor * stop
    assert run.end.angle == pytest.approx(way, abs=1e-11)


def test_sticking_has_no_creep_and_ends_where_the_torque_exceeds_the_level():
    machine = Machine((1.0, 1.0), coulomb=(2.0, 1.0), stiffness=(500.0,), damping=(1.0,))
    run = simulate(machine, np.linspace(0.0, 4.0, 401), STEP)
    held = run.command <= 2.0
    assert np.all(run.speeds[held] == 0.0) and np.all(run.stuck[held])
    assert np.all(run.speeds[~held][1:, 0] > 0.0)
    # The load goes when the shaft has wound up to its level, and not before.
    waiting = run.stuck[:, 1]
    assert np.all(run.shaft_torques[waiting, 0] <= 1.0) and run.shaft_torques[waiting, 0].max() > 0.8
    assert np.all(run.speeds[waiting, 1] == 0.0) and not waiting[-1]


def test_friction_takes_a_direct_reversal_without_sticking():
    machine = Machine((1.0,), coulomb=(1.0,))
    run = simulate(machine, np.repeat([-3.0], 1000), STEP, State((1.0,), ()))
    # Slows at 4 rad/s^2 to 0.25 s, then goes back at 2 rad/s^2.
    expected = np.where(run.time < 0.25, 1.0 - 4.0 * run.time, -2.0 * (run.time - 0.25))
    np.testing.assert_allclose(run.speeds[:, 0], expected, atol=1e-11)
    assert run.events == {"reversed": 1}


@pytest.mark.parametrize("excess", [1e-3, 5e-5, 1e-9, 1e-15])
def test_release_and_capture_at_the_start_of_a_step(excess):
    """A body that starts to slide and halts again before the guards are looked at first."""
    machine = Machine((0.6, 5.2), coulomb=(5.0, 0.0), stiffness=(3300.0,), damping=(3.1,))
    start = State((0.0, -5e-3), (-(5.0 + excess + 3.1 * 5e-3) / 3300.0,))
    fine = simulate(machine, np.zeros(200), STEP / 10, start)
    coarse = simulate(machine, np.zeros(20), STEP, start)
    assert coarse.events == fine.events and coarse.events["stuck"] >= 1
    np.testing.assert_allclose(coarse.speeds, fine.speeds[::10], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("when", [0.01, 0.05, 0.5, 0.95, 0.99])
def test_a_touch_anywhere_in_a_long_flight_is_seen(when):
    """Across the gap motion is a parabola, so that the integrator flies over a whole sample in one step.

    It reaches 1e-8 rad into the contact, so little that the contact hardly turns the parabola.
    """
    machine = Machine((1.0, 1.0), stiffness=(1e4,), half_gap=(1e-3,))
    # Twist 1e-3 + 1e-8 - 4 (t - when h)^2 for a torque of -8 Nm on one of the bodies.
    step, torque = 0.01, np.full(1, -8.0)
    start = State((8.0 * when * step, 0.0), (1e-3 + 1e-8 - 4.0 * (when * step) ** 2,))
    coarse, fine = (simulate(machine, np.repeat(torque, k), step / k, start) for k in (1, 1000))
    assert coarse.events == fine.events and fine.events["contact_made"] == 1
    np.testing.assert_allclose(coarse.end.speeds, fine.end.speeds, atol=1e-12)


@pytest.mark.parametrize("step", [0.02, 0.025, 0.03])
def test_a_break_that_heals_between_two_looks_is_seen(step):
    """The shaft torque of a swinging load tops the motor's Coulomb level by 1e-5 of it."""
    machine = Machine((0.6, 5.2), coulomb=(5.0, 0.0), stiffness=(3300.0,))
    start = State((0.0, -5.00005 / np.sqrt(3300.0 * 5.2)), (0.0,))
    fine, coarse = (simulate(machine, np.zeros(round(0.1 / h)), h, start) for h in (step / 100, step))
    assert coarse.events == fine.events and fine.events["released"] == 1
    np.testing.assert_allclose(coarse.speeds[-1], fine.speeds[(len(coarse.time) - 1) * 100], atol=1e-12)


def test_elastic_impact_across_the_gap_keeps_momentum_and_swaps_relative_speed():
    machine = Machine((0.6, 5.2), stiffness=(3300.0,), half_gap=(0.03,))
    run = simulate(machine, np.zeros(600), STEP, State((1.5, -0.2), (-0.03,)))
    np.testing.assert_allclose(run.speeds @ machine.inertia, 0.6 * 1.5 - 5.2 * 0.2, atol=1e-11)
    relative, inside = run.speeds[:, 0] - run.speeds[:, 1], run.contact[:, 0] == 0
    assert np.all(run.shaft_torques[inside] == 0.0)
    np.testing.assert_allclose(np.abs(relative[inside]), 1.7, atol=1e-9)
    assert run.time[~inside][0] == pytest.approx(0.06 / 1.7, abs=STEP)
    # Half a period of the resonance in contact, then 2 a / 1.7 through the gap.
    cycle = np.pi / np.sqrt(3300.0 * 5.8 / (0.6 * 5.2)) + 0.06 / 1.7
    assert run.events["contact_made"] == int(0.6 / cycle + (np.pi / 78.3) / cycle)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["inside", "always"])
def test_energy_is_never_created(law):
    machine = Machine((0.6, 5.2), coulomb=(0.3, 0.2), stiffness=(3300.0,), damping=(3.1,),
                      half_gap=(0.02,), law=law)
    run = simulate(machine, np.zeros(1200), STEP, State((3.0, -1.0), (0.0,)))
    twist = run.angles[:, 0] - run.angles[:, 1]
    wound = np.maximum(np.abs(twist) - 0.02, 0.0)
    energy = 0.5 * run.speeds**2 @ machine.inertia + 0.5 * 3300.0 * wound**2
    assert np.diff(energy).max() < 1e-11 and energy[-1] < 0.6 * energy[0]
    assert run.events["contact_made"] >= 3


def test_energy_is_kept_without_friction_and_damping():
    machine = Machine((0.6, 5.2), stiffness=(3300.0,), half_gap=(0.02,))
    run = simulate(machine, np.zeros(1000), STEP, State((3.0, -1.0), (0.0,)))
    wound = np.maximum(np.abs(run.angles[:, 0] - run.angles[:, 1]) - 0.02, 0.0)
    energy = 0.5 * run.speeds**2 @ machine.inertia + 0.5 * 3300.0 * wound**2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)
    assert run.events["contact_made"] > 10


# Laws


def test_damping_that_acts_always_brakes_in_the_gap():
    machine = Machine((0.6, 5.2), stiffness=(3300.0,), damping=(3.1,), half_gap=(10.0,), law="always")
    run = simulate(machine, np.zeros(300), STEP, State((2.0, 0.5), (0.0,)))
    relative = 1.5 * np.exp(-3.1 * (1 / 0.6 + 1 / 5.2) * run.time)
    np.testing.assert_allclose(run.shaft_torques[:, 0], 3.1 * relative, atol=1e-10)
    assert not run.contact.any()


@pytest.mark.slow
def test_contact_never_pulls_with_damping_inside_but_does_with_damping_always():
    pulls = {}
    for law in ("inside", "always"):
        machine = machine_by_seed(4, gap=0.3, law=law)
        run = simulate(machine, excitation(machine, 2000, 1), STEP)
        assert run.events["contact_lost"] > 5
        pulls[law] = np.min(run.shaft_torques * run.contact)
    assert pulls["inside"] >= 0.0 and pulls["always"] < -1e-3


def test_table_5_1_friction_on_the_motor_opens_the_gap():
    def shaft_torque(viscous):
        machine = Machine((1.0, 1.0), (viscous, 0.0), stiffness=(1e4,), half_gap=(1e-3,))
        return simulate(machine, ones(1000, 10.0), STEP, State((0.0, 0.0), (1e-3,)))

    rubbing, free = shaft_torque(10.0), shaft_torque(0.0)
    assert rubbing.events["contact_lost"] > 0 and np.any(rubbing.contact == 0)
    # Without friction the torque touches zero once per period and never goes below.
    assert free.shaft_torques.min() >= 0.0
    whole = simulate(Machine((1.0, 1.0), (10.0, 0.0), stiffness=(1e4,)), ones(1000, 10.0), STEP)
    assert whole.shaft_torques.min() < -0.1


def test_ratios_reflect_inertia_with_their_square():
    inertia, ratio, stiffness = (0.3, 0.8, 9.0), (2.0, 3.0), (900.0, 400.0)
    machine = Machine(inertia, stiffness=stiffness, ratio=ratio)
    rate = 6.0 / (0.3 + 0.8 / 4.0 + 9.0 / 36.0)
    last = 9.0 * rate / 6.0
    first = 0.8 * rate / 2.0 + last / 3.0
    start = State((0.0, 0.0, 0.0), (first / 900.0, last / 400.0))
    run = simulate(machine, ones(300, 6.0), STEP, start)
    np.testing.assert_allclose(run.speeds, np.outer(rate * run.time, [1.0, 1 / 2, 1 / 6]), atol=1e-10)
    np.testing.assert_allclose(run.shaft_torques, np.tile([first, last], (300, 1)), atol=1e-8)
    twist = run.angles[:, 1] / 3.0 - run.angles[:, 2]
    np.testing.assert_allclose(twist, last / 400.0, atol=1e-12)


@pytest.mark.parametrize("speed", [12.0, -12.0])
@pytest.mark.parametrize("machine", [machine_by_seed(5, gap=0.2, friction=True), CHAIN])
def test_running_is_steady(machine, speed):
    start = running(machine, speed, load_torque=3.0)
    run = simulate(machine, ones(200, start.torque), STEP, start, load_torque=ones(200, 3.0))
    np.testing.assert_allclose(run.speeds, np.tile(start.speeds, (200, 1)), atol=1e-10)
    assert run.events["contact_lost"] == 0


# Torque path


def test_dead_time_of_whole_samples_shifts_the_command():
    values = vars(machine_by_seed(2)) | {"dead_time": 3 * STEP}
    torque = excitation(machine_by_seed(2), 300, 3)
    late = simulate(Machine(**values), torque, STEP)
    shifted = simulate(machine_by_seed(2), np.concatenate([np.zeros(3), torque[:-3]]), STEP)
    np.testing.assert_array_equal(late.speeds, shifted.speeds)
    assert np.abs(late.speeds - simulate(machine_by_seed(2), torque, STEP).speeds).max() > 1e-2


def test_dead_time_of_a_part_of_a_sample_switches_inside_it():
    values = vars(machine_by_seed(2, gap=0.2, friction=True)) | {"dead_time": 1.4 * STEP}
    torque = excitation(machine_by_seed(2), 300, 3)
    late = simulate(Machine(**values), torque, STEP)
    values["dead_time"] = 0.0
    fine = np.concatenate([np.zeros(7), np.repeat(torque, 5)])[:1500]
    prompt = simulate(Machine(**values), fine, STEP / 5)
    np.testing.assert_allclose(late.speeds, prompt.speeds[::5], atol=1e-9)


def test_converter_step_response():
    w0, zeta = 433.0, 0.69
    machine = Machine((1.0,), converter_bandwidth=w0, converter_damping=zeta)
    run = simulate(machine, ones(40), STEP)
    wd = w0 * np.sqrt(1.0 - zeta**2)
    ring = np.cos(wd * run.time) + zeta * w0 / wd * np.sin(wd * run.time)
    np.testing.assert_allclose(run.applied, 1.0 - np.exp(-zeta * w0 * run.time) * ring, atol=1e-10)
    # The lag of the speed is the mean delay 2 zeta / w0 of the converter.
    assert run.time[-1] - run.speeds[-1, 0] == pytest.approx(2.0 * zeta / w0, abs=1e-7)


def test_converter_step_response_of_first_order():
    machine = Machine((1.0,), converter_bandwidth=433.0, converter_damping=np.inf)
    run = simulate(machine, ones(40), STEP)
    np.testing.assert_allclose(run.applied, 1.0 - np.exp(-433.0 * run.time), atol=1e-10)
    assert run.time[-1] - run.speeds[-1, 0] == pytest.approx(1.0 / 433.0, abs=1e-7)


# Numbers


@pytest.mark.slow
def test_tolerance_converges():
    """Samples of 20 ms, so that the step size control and not the sampling sets the steps."""
    machine = machine_by_seed(3, gap=0.1, friction=True, converter_bandwidth=433.0)
    torque = excitation(machine, 60, 5, hold=5)
    loose, tight, crude = (
        simulate(machine, torque, 0.02, rtol=tol, atol=1e-2 * tol).speeds for tol in (1e-9, 1e-12, 1e-4))
    np.testing.assert_allclose(loose, tight, atol=1e-8)
    assert np.abs(crude - tight).max() > 1e-8


@pytest.mark.parametrize("law", ["inside", "always"])
def test_sampling_does_not_matter(law):
    """Events are the same wherever they fall in the sample, and however many fall in one."""
    machine = machine_by_seed(6, gap=0.02, friction=True, law=law)
    torque = excitation(machine, 40, 8, hold=3)
    coarse = simulate(machine, torque, 0.02)
    fine = simulate(machine, np.repeat(torque, 16), 0.02 / 16)
    assert coarse.events == fine.events and coarse.events["contact_made"] > 10
    assert coarse.events.keys() & {"stuck", "reversed"}
    np.testing.assert_allclose(coarse.speeds, fine.speeds[::16], atol=1e-9)


@pytest.mark.parametrize("machine", [CHAIN, make_fixtures.AXIS, make_fixtures.RIG, machine_by_seed(7)])
def test_linear_twin(machine):
    machine = Machine(**vars(machine) | {"coulomb": (), "half_gap": ()})
    rng = np.random.default_rng(0)
    torque = np.repeat(rng.uniform(-20.0, 20.0, 20), 25)
    noise, load = rng.standard_normal(500), np.repeat(rng.uniform(-3.0, 3.0, 5), 100)
    start = running(machine, 4.0)
    run = simulate(machine, torque, STEP, start, torque_noise=noise, load_torque=load)
    twin = simulate_linear(machine, torque, STEP, start, torque_noise=noise, load_torque=load)
    for name in ("speeds", "angles", "shaft_torques"):
        np.testing.assert_allclose(getattr(twin, name), getattr(run, name), atol=1e-9, err_msg=name)


def test_many_linear_records_at_once_and_refusal():
    machine = machine_by_seed(8, dead_time=0.4 * STEP)
    torque = excitation(machine, 200, 0)
    noise = np.random.default_rng(1).standard_normal((5, 200))
    many = simulate_linear(machine, torque, STEP, torque_noise=noise)
    assert many.speeds.shape == (5, 200, 2) and many.shaft_torques.shape == (5, 200, 1)
    one = simulate_linear(machine, torque, STEP, torque_noise=noise[3])
    np.testing.assert_allclose(many.speeds[3], one.speeds, atol=1e-12)
    with pytest.raises(ValueError, match="gap or Coulomb"):
        simulate_linear(machine_by_seed(8, gap=0.1), torque, STEP)


def test_machines_by_seed():
    drawn = [machine_by_seed(seed, gap=0.1, friction=True) for seed in range(200)]
    motor, load = np.array([m.inertia for m in drawn]).T
    stiffness, damping = (np.array([getattr(m, f)[0] for m in drawn]) for f in ("stiffness", "damping"))
    reduced = motor * load / (motor + load)
    hertz = np.sqrt(stiffness / reduced) / (2.0 * np.pi)
    relative = damping / 2.0 / np.sqrt(stiffness * reduced)
    for values, low, high in ((load / motor, 0.1, 10.0), (hertz, 5.0, 60.0), (relative, 0.01, 0.05)):
        assert low <= values.min() < 1.2 * low and 0.83 * high < values.max() <= high
    assert drawn[3] == machine_by_seed(3, gap=0.1, friction=True)
    assert machine_by_seed(3).is_linear and machine_by_seed(3).inertia == drawn[3].inertia


# Experiments, closed loop and records


def test_experiments_are_what_they_are_called():
    up = experiments.steps(10.0, (3.0, 4.0), (0.1, 0.2), 0.05, STEP, 1)
    assert up[0] == 10.0 and up[-1] == 17.0 and set(np.diff(up)) == {0.0, 3.0, 4.0}
    swing = experiments.alternating(10.0, (5.0, 9.0), (0.05, 0.1), 6, 0.02, STEP, 1)
    assert (swing - 10.0).sum() == pytest.approx(0.0, abs=1e-9) and np.cumsum(swing - 10.0).min() > -0.5e3
    sweep = experiments.chirp(2.0, 32.0, 1.0, 4.0, STEP)
    turns = np.flatnonzero(np.diff(np.sign(sweep))) * STEP
    assert 0.5 / np.diff(turns)[[0, -1]] == pytest.approx([2.0, 32.0], rel=0.15)
    sines = np.abs(np.fft.rfft(experiments.multisine([5.0, 9.0], 3.0, 1.0, STEP, 1))) / 500.0
    assert np.flatnonzero(sines > 1e-6).tolist() == [5, 9] and sines[5] == pytest.approx(3.0)
    shape = experiments.trapezoids(4.0, 0.5, 0.2, 6.0, STEP, 1)
    assert np.abs(shape).max() <= 4.0 and np.ptp(shape[1300:1499]) == 0.0 and shape.min() < 0 < shape.max()
    way = experiments.moves(0.3, 0.4, 3.0, 0.2, 6.0, STEP, 1)
    rate = np.diff(way) / STEP
    assert np.abs(rate).max() <= 0.4 and np.abs(np.diff(rate)).max() <= 3.0 * STEP + 1e-12
    assert rate.min() < -0.05 and rate.max() > 0.05 and way.size == 6000


def test_speed_controller_works_on_the_sensor_and_saturates():
    machine = machine_by_seed(9, friction=True)
    rated = machine.rated_torque
    reference = experiments.staircase([0.0, 3.0], 0.8, 0.02, STEP)
    gain = 15.0 * sum(machine.inertia)
    noise = records.white_noise(len(reference), 0.02, 3)
    run = simulate(machine, np.zeros_like(reference), STEP, controller=SpeedPI(
        reference, gain, 4.0 * gain, STEP, limit=0.5 * rated, resolution=0.01), sensor=Sensor(noise=noise))
    assert np.abs(run.command).max() == pytest.approx(0.5 * rated, abs=0.006)
    np.testing.assert_allclose(run.measured, run.speeds[:, 0] + noise, atol=0.0)
    np.testing.assert_allclose(run.command, quantise(run.command, 0.01), atol=0.0)
    assert run.speeds[-20:, 0].mean() == pytest.approx(3.0, abs=0.05)


def test_log_files_hold_the_values_and_are_the_same_bytes_again(tmp_path):
    torque, speed = np.linspace(-1.0, 2.0, 2500), quantise(np.sin(np.arange(2500.0)), 1e-5)
    channels = {"motor_torque": (torque, "Nm"), "motor_speed": (speed, "rad/s")}
    for name in ("a", "b"):
        records.write_parquet(tmp_path / f"{name}.parquet", channels, STEP)
        records.write_mcap(tmp_path / f"{name}.mcap", channels, STEP)
    for kind in ("parquet", "mcap"):
        assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()
    table = pq.read_table(tmp_path / "a.parquet")
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert units == {"time": "s", "motor_torque": "Nm", "motor_speed": "rad/s"}
    np.testing.assert_array_equal(table["time"], np.arange(2500) / 1000.0)
    with open(tmp_path / "a.mcap", "rb") as file:
        read = [(schema, m.log_time, m.publish_time, json.loads(m.data))
                for schema, _, m in make_reader(file).iter_messages("/drive")]
    assert json.loads(read[0][0].data)["properties"]["motor_speed"]["unit"] == "rad/s"
    assert [(r[1], r[2]) for r in read] == [(i * 1_000_000,) * 2 for i in range(2500)]
    for name in ("motor_torque", "motor_speed"):
        np.testing.assert_array_equal(table[name], [r[3][name] for r in read])


def test_fixtures_are_what_the_program_writes():
    """One record again: gap-free as it claims, and as stored to the last count of the sensor."""
    run = make_fixtures.RECORDS["rig"]["steps"]()
    stored = pq.read_table(FIXTURES / "rig" / "steps.parquet")
    np.testing.assert_allclose(stored["motor_speed"], run.measured, atol=1.1e-5)
    np.testing.assert_array_equal(stored["motor_torque"], run.command)
    assert run.events == {} and np.all(run.contact == 1)
    truths = {room: make_fixtures.truth(*what) for room, what in make_fixtures.TRUTHS.items()}
    for room, text in truths.items():
        assert (FIXTURES / room / "truth.yaml").read_text() == text


@pytest.mark.slow
def test_the_coast_downs_are_what_the_program_writes(tmp_path):
    """All of them again, to the byte, and small enough to look at."""
    coast_fixtures.make(tmp_path / "coast")
    stored = {p.name: p for p in (FIXTURES / "coast").iterdir()}
    assert sorted(stored) == sorted(p.name for p in (tmp_path / "coast").iterdir())
    for name, path in stored.items():
        made = tmp_path / "coast" / name
        assert path.stat().st_size < 300_000
        if name.endswith(".yaml"):
            assert made.read_bytes() == path.read_bytes()
        if name.endswith(".parquet"):
            now, then = pq.read_table(made), pq.read_table(path)
            for column in then.column_names:  # another processor may round the last digit of the filtered speed
                np.testing.assert_allclose(now[column], then[column], atol=1.1e-4)


def test_nothing_here_imports_drivetool():
    """Also not through importlib or by a string: the name does not occur in any code."""
    files = [*sorted((HERE / "simulator").glob("**/*.py")), *sorted((HERE / "hidden").glob("**/*.py")),
             HERE / "make_fixtures.py", HERE / "coast_fixtures.py"]
    assert len(files) > 12
    for file in files:
        tree = ast.parse(file.read_text())
        for node in ast.walk(tree):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{file.name}: relative import"
                names = [node.module]
            elif isinstance(node, ast.Name | ast.Attribute):
                names = [node.id if isinstance(node, ast.Name) else node.attr]
            for name in names:
                assert name.split(".")[0] not in ("drivetool", "importlib", "__import__"), file.name
