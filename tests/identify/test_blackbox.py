"""Black box: coefficients, their conversion, and the truth recovered from short noisy records."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings, strategies as st
from scipy.stats import chi2

from drivetool.drive import one_body, two_mass
from drivetool.drive.chain import three_mass
from drivetool.drive.simulation import Trace
from drivetool.errors import BadOption, BadParameters, BadRecording, NotEnoughData
from drivetool.files.results.result_file import dump, estimate_file
from drivetool.files.yaml import load_channel_map
from drivetool.identify.blackbox.estimator import blackbox
from drivetool.identify.blackbox.transfer import (
    TWO_MASS,
    VISCOUS,
    TransferForm,
    form_of,
    to_physical,
    why_impossible,
)
from drivetool.identify.estimate.estimate import Covariance
from drivetool.identify.setup.options import Options
from drivetool.logs import Experiment
from drivetool.logs.door import open_experiment
from tests.places import RIG
from tests.simulator import experiments
from tests.simulator.controllers import SpeedPI
from tests.simulator.linear import equations, simulate_linear
from tests.simulator.machine import Machine, machine_by_seed, running
from tests.simulator.simulate import Sensor, simulate

H = 1e-3
SHAFT = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")
positive = st.floats(1e-2, 1e2)


def experiment(torque, motion, role="motor_speed", **signals):
    signals = {"motor_torque": torque, role: motion, **signals}
    return Experiment("made.parquet", "0" * 64, H, 0.0, signals, ((0, len(torque)),), torque_is="command")


def truth_of(machine):
    names = (*SHAFT, "total.viscous", "total.idle_torque")
    return dict(zip(names, (*machine.inertia, *machine.stiffness, *machine.damping,
                            *at_motor(machine)), strict=True))


def at_motor(machine):
    """(viscous friction, idle torque) of motor and load together, referred to the motor."""
    n = machine.ratio[0]
    return (machine.viscous[0] + machine.viscous[1] / n**2, machine.idle_torque[0] + machine.idle_torque[1] / n)


def steps_of(machine, seed, count=5, start=20.0):
    sizes = machine.rated_torque * np.random.default_rng(seed).uniform(0.05, 0.15, count)
    return experiments.steps(running(machine, start).torque, sizes, (0.5, 1.0), 0.3, H, seed)


def record_of(machine, torque, seed, noise=1.0, sensor=0.005, angle=False, start=20.0):
    """Torque steps with torque noise of 0.3 % of the rated torque per sample and sensor noise."""
    rng = np.random.default_rng(1000 + seed)
    applied = 0.003 * noise * (machine.rated_torque or 30.0) * rng.standard_normal(len(torque))
    run = simulate_linear(machine, torque, H, running(machine, start), applied)
    motion = (run.angles if angle else run.speeds)[:, 0]
    motion = motion + noise * sensor * rng.standard_normal(len(torque))
    return experiment(torque, motion, "motor_angle" if angle else "motor_speed")


def line(estimate, name):
    return next(p for p in estimate.parameters if p.name == name)


def codes(estimate):
    return {f.code: f.severity for f in estimate.findings}


def joint(estimate, truth):
    names = estimate.covariance.names
    error = np.array([line(estimate, n).value - truth[n] for n in names])
    return chi2.sf(error @ np.linalg.solve(estimate.covariance.matrix, error), len(names))


# the model


@given(positive, positive, positive, st.floats(1e-3, 0.5), st.floats(0.0, 0.2), st.floats(0.2, 5.0))
def test_conversion_returns_the_parameters(motor, load, resonance, zeta, decay, ratio):
    load_at_motor = load / ratio**2
    reduced = motor * load_at_motor / (motor + load_at_motor)
    stiffness, damping = reduced * resonance**2, 2.0 * zeta * reduced * resonance
    viscous = decay * (motor + load_at_motor)
    values = {"b2": 1.0 / motor, "b0": stiffness / (motor * load_at_motor), "a2": damping / reduced + decay,
              "b1": damping / (motor * load_at_motor) + decay / motor, "a1": stiffness / reduced, "offset": 1.0}
    form = TransferForm(TWO_MASS, ratio=ratio, viscous=viscous)
    assert not why_impossible(values)
    found = to_physical(form, form.seeds([values[n] for n in TWO_MASS]))
    wanted = {"motor": motor, "load": load, "stiffness": ratio**2 * stiffness, "damping": ratio**2 * damping}
    assert {k: found[k].v for k in wanted} == pytest.approx(wanted, rel=1e-6)
    assert found["left_over"].v == pytest.approx(0.0, abs=1e-9 * values["b1"] + 1e-9)


@given(positive, positive, st.floats(0.01, 0.3), st.floats(0.3, 4.0))
def test_the_transfer_function_is_that_of_the_machine(motor, load, decay, ratio):
    machine = Machine((motor, load), (decay * motor, decay * load), stiffness=(400.0 * motor,),
                      damping=(1.5 * motor,), ratio=(ratio,))
    a, b, _ = equations(machine)
    load_at_motor = load / ratio**2
    ks, cs = 400.0 * motor / ratio**2, 1.5 * motor / ratio**2
    total = motor + load_at_motor
    values = [1.0 / motor, cs / (motor * load_at_motor) + decay / motor, ks / (motor * load_at_motor),
              cs * total / (motor * load_at_motor) + decay, ks * total / (motor * load_at_motor), 0.0]
    form = TransferForm(TWO_MASS, ratio=ratio, viscous=decay * total)
    frequency = np.array([0.03, 0.5, 3.0, 20.0])
    wanted = [np.linalg.solve(2j * np.pi * f * np.eye(4) - a, b[:, 0])[0] for f in frequency]
    np.testing.assert_allclose(form.response(values, frequency), wanted, rtol=1e-9)


@pytest.mark.parametrize("ratio", [1.0, 2.5])
def test_gradients_are_those_of_differences(ratio):
    form = TransferForm((*TWO_MASS, VISCOUS), signs=(-1.0,), angle=True, ratio=ratio, bandwidth=300.0)
    values = np.array([0.5, 2.0, 300.0, 3.0, 2000.0, 7.0, 0.4])
    trace = Trace(np.zeros((10, 2)), np.zeros((10, 1)), H)

    def rows(v, gradient=False):
        return form.build(v, trace, gradient, 0.9).system.rows

    def numbers(v):
        return to_physical(form, form.seeds(v))

    exact = rows(values, True)
    assert exact.shape[2] > len(values) and {"stiffness", "damping"} < set(numbers(values))
    for j in range(len(values)):
        d = np.zeros(len(values))
        d[j] = 1e-6 * values[j]
        slope = (rows(values + d) - rows(values - d))[:, :, 0] / (2 * d[j])
        np.testing.assert_allclose(exact[:, :, 1 + j], slope, rtol=1e-6, atol=1e-6)
        for key, number in numbers(values).items():
            slope = (numbers(values + d)[key].v - numbers(values - d)[key].v) / (2 * d[j])
            assert number.d[j] == pytest.approx(slope, rel=1e-5, abs=1e-7 * (1.0 + abs(number.v)))


def test_impossible_coefficients_say_why():
    good = {"b2": 1.0, "b1": 0.1, "b0": 10.0, "a2": 1.0, "a1": 100.0}
    assert not why_impossible(good)
    assert "total inertia" in why_impossible(good | {"b0": -1.0})
    assert "motor inertia" in why_impossible(good | {"b2": -1.0})
    assert "the total inertia is below" in why_impossible(good | {"a1": 9.0})
    assert "inertia" in why_impossible({"b": -1.0})


# records


@pytest.fixture(scope="module")
def rig():
    return open_experiment(RIG / "steps.parquet", load_channel_map(None))


@pytest.fixture(scope="module")
def rig_truth():
    raw = yaml.safe_load((RIG / "truth.yaml").read_text(encoding="utf-8"))["parameters"]
    values = {name: entry["value"] for name, entry in raw.items()}
    return values | {"total.viscous": values["motor.viscous"] + values["load.viscous"],
                     "total.idle_torque": values["load.idle_torque"]}


def test_rig_after_steady(rig, rig_truth):
    known = {n: rig_truth[n] for n in ("total.viscous", "total.idle_torque")}
    estimate = blackbox([rig], two_mass().with_values(known), Options())
    for name in SHAFT:
        p = line(estimate, name)
        assert abs(p.value - rig_truth[name]) < 3.0 * p.std, name
        assert p.value == pytest.approx(rig_truth[name], rel=0.03)
        assert p.ci95[0] < p.value < p.ci95[1] and p.status == "fitted" and p.start is None
    assert joint(estimate, rig_truth) > 1e-3
    assert estimate.details["resonance"]["hz"]["value"] == pytest.approx(12.60, abs=0.05)
    assert estimate.details["anti_resonance"]["hz"]["value"] == pytest.approx(4.024, abs=0.05)
    assert abs(estimate.details["left_over"]["in_std"]) < 3.0
    assert estimate.fit["simulation_fit_percent"] > 99.8 and estimate.fit["one_step_fit_percent"] > 99.8
    assert estimate.fit["converted_simulation_fit_percent"] > 99.8
    assert line(estimate, "total.viscous").status == "held"
    assert {e.kind for e in estimate.exhibits} == {"record", "bode"}
    assert estimate.drive.values["motor.inertia"] == line(estimate, "motor.inertia").value
    assert not {"warning", "failure"} & set(codes(estimate).values())
    assert "motor.inertia" in dump(estimate_file(estimate))


@pytest.mark.slow
def test_a_rig_alone_identifies_friction_and_idle_torque_too(rig, rig_truth):
    estimate = blackbox([rig], two_mass(), Options())
    for name in (*SHAFT, "total.viscous", "total.idle_torque"):
        p = line(estimate, name)
        assert abs(p.value - rig_truth[name]) < 3.0 * p.std, name
    assert joint(estimate, rig_truth) > 1e-3


def test_uncertainty_of_known_friction_is_passed_on(rig, rig_truth):
    drive = two_mass().with_values({"total.viscous": rig_truth["total.viscous"]})
    sure = blackbox([rig], drive, Options(starts=1))
    unsure = Covariance(("total.viscous",), np.array([[0.002**2]]))
    loose = blackbox([rig], drive, Options(starts=1, known=unsure))
    assert line(loose, "load.inertia").std > 1.5 * line(sure, "load.inertia").std
    assert line(loose, "load.inertia").value == line(sure, "load.inertia").value


def test_an_open_gap_is_noticed():
    record = open_experiment(RIG / "gap.parquet", load_channel_map(None)).between(0.0, 3.0)
    assert codes(blackbox([record], two_mass(), Options(starts=1)))["gap-may-open"] == "warning"


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 8))])
def test_truth_is_recovered(seed):
    machine = machine_by_seed(seed)
    truth = truth_of(machine)
    estimate = blackbox([record_of(machine, steps_of(machine, seed), seed)], two_mass(), Options())
    for name, value in truth.items():
        p = line(estimate, name)
        if p.status == "fitted":
            assert abs(p.value - value) < max(4.0 * p.std, 0.05 * value), name
        else:
            assert name in ("shaft.damping", "total.viscous"), name
    assert joint(estimate, truth) > 1e-3
    assert "failure" not in codes(estimate).values()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 5, 6, 7])
def test_short_and_noisy_shows_the_resonance(seed):
    machine = machine_by_seed(seed)
    record = record_of(machine, steps_of(machine, seed)[:2000], seed, noise=5.0, sensor=0.02)
    estimate = blackbox([record], two_mass(), Options())
    (jm, jl), (ks,) = machine.inertia, machine.stiffness
    found = estimate.details["resonance"]["hz"]
    assert found["value"] == pytest.approx(np.sqrt(ks * (jm + jl) / (jm * jl)) / (2 * np.pi), rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 5])
def test_closed_loop_is_not_biased(seed):
    machine = machine_by_seed(seed)
    start, rng, n = running(machine, 20.0), np.random.default_rng(seed), 6000
    reference = 20.0 + np.floor(np.arange(n) / 900)
    gain = 10.0 * sum(machine.inertia)
    loop = SpeedPI(reference, gain, 2.5 * gain, H, start=start.torque, limit=machine.rated_torque)
    noise = 0.005 * machine.rated_torque * rng.standard_normal(n)
    run = simulate(machine, np.zeros(n), H, start, loop, noise,
                   sensor=Sensor("speed", 0.02 * rng.standard_normal(n)))
    estimate = blackbox([experiment(run.command, run.measured)], two_mass(), Options())
    for name, value in truth_of(machine).items():
        p = line(estimate, name)
        assert p.std is None or abs(p.value - value) < 3.0 * p.std, name
    assert joint(estimate, truth_of(machine)) > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("order", [1.0, 2.0])
def test_angle_with_gear_load_torque_and_converter(order):
    base = machine_by_seed(5)
    machine = replace(
        base, ratio=(3.0,), inertia=(base.inertia[0], 9.0 * base.inertia[1]), viscous=(0.0, 0.0),
        stiffness=(9.0 * base.stiffness[0],), damping=(9.0 * base.damping[0],), converter_bandwidth=300.0,
        converter_damping=np.inf if order == 1.0 else 0.69, dead_time=0.0023)
    torque, rng = steps_of(machine, 5), np.random.default_rng(3)
    load = 0.3 * machine.rated_torque * (np.arange(len(torque)) % 2000 > 1300)
    run = simulate_linear(machine, torque, H, running(machine, 20.0), rng.standard_normal(len(torque)), load)
    angle = run.angles[:, 0] + 2e-5 * rng.standard_normal(len(torque))
    drive = two_mass().with_values({"shaft.ratio": 3.0, "converter.bandwidth": 300.0, "total.viscous": 0.0,
                                    "converter.order": order, "converter.dead_time": 0.0023})
    record = experiment(torque, angle, "motor_angle", load_torque=load)
    estimate = blackbox([record], drive, Options())
    for name in (*SHAFT, "total.idle_torque"):
        p = line(estimate, name)
        assert abs(p.value - truth_of(machine)[name]) < 4.0 * p.std, name


@pytest.mark.parametrize("angle", [False, True])
def test_one_body(angle):
    machine = Machine((2.0,), (0.5,), idle_torque=(3.0,))
    torque = experiments.steps(5.0, (2.0, 3.0, -4.0, 5.0), (0.5, 1.0), 0.3, H, 3)
    record = record_of(machine, torque, 3, sensor=2e-4 if angle else 0.02, angle=angle, start=5.0)
    estimate = blackbox([record], one_body(), Options())
    for name, value in (("motor.inertia", 2.0), ("motor.viscous", 0.5), ("motor.idle_torque", 3.0)):
        p = line(estimate, name)
        assert abs(p.value - value) < 4.0 * p.std and p.std < 0.03 * value, name


@pytest.mark.slow
def test_several_records_with_holes_and_both_criteria():
    machine = machine_by_seed(1)
    one, two = (record_of(machine, steps_of(machine, s), s) for s in (1, 2))
    speed = two.signals["motor_speed"].copy()
    speed[300:320] = np.nan
    two = replace(two, signals=two.signals | {"motor_speed": speed}, segments=((0, 1500), (1600, two.size)))
    estimate = blackbox([one, two], two_mass(), Options(starts=1))
    for name, value in truth_of(machine).items():
        assert abs(line(estimate, name).value - value) < 4.0 * line(estimate, name).std, name
    plain = blackbox([one], two_mass(), Options(starts=1, criterion="simulation"))
    assert codes(plain)["simulation-criterion"] == "note"
    assert plain.fit["one_step_fit_percent"] is None
    assert line(plain, "motor.inertia").value == pytest.approx(machine.inertia[0], rel=0.03)


def test_held_value_stays_and_says_so(rig):
    drive = two_mass().with_values({"motor.inertia": 0.5, "total.viscous": 0.0})
    estimate = blackbox([rig], drive, Options(hold=("motor.inertia",), starts=1))
    held = line(estimate, "motor.inertia")
    assert (held.value, held.start, held.status, held.std) == (0.5, 0.5, "held", None)
    assert "black box gives 0.59" in held.reason
    assert "motor.inertia" not in estimate.covariance.names


# what is not identifiable


def test_a_wrong_sign_gives_no_parameters(rig):
    signals = dict(rig.signals)
    signals["motor_torque"] = -signals["motor_torque"]
    drive = two_mass().with_values({"load.inertia": 5.0})
    estimate = blackbox([replace(rig, signals=signals)], drive, Options(starts=1))
    assert codes(estimate)["no-conversion"] == "failure"
    assert {line(estimate, n).status for n in SHAFT} == {"not-identifiable"}
    assert np.isnan(line(estimate, "motor.inertia").value) and line(estimate, "load.inertia").value == 5.0
    assert dict(estimate.drive.values) == {"load.inertia": 5.0}
    assert all(line(estimate, n).reason for n in SHAFT) and estimate.covariance is None
    assert "signs" in next(f.action for f in estimate.findings if f.code == "no-conversion")
    assert "value: null" in dump(estimate_file(estimate))


def test_a_shaft_that_is_not_excited_is_not_made_up():
    machine, time = machine_by_seed(5), np.arange(4000) * H
    torque = running(machine, 20.0).torque + 0.1 * machine.rated_torque * (1.0 - np.cos(time))
    estimate = blackbox([record_of(machine, torque, 5, noise=0.1, sensor=0.2)], two_mass(), Options(starts=1))
    assert codes(estimate)["shaft-not-identifiable"] == "failure"
    assert {line(estimate, n).status for n in SHAFT} == {"not-identifiable"}
    total = estimate.details["total_inertia_at_motor"]["value"]
    assert total == pytest.approx(sum(machine.inertia), rel=0.05)


def test_bad_input_is_refused_in_words(rig):
    torque, speed = rig.signals["motor_torque"], rig.signals["motor_speed"]
    cases = [
        (BadOption, "two masses", rig, three_mass(), Options()),
        (BadOption, "total.viscous", rig, two_mass(), Options(free=("shaft.half_gap",))),
        (BadParameters, "motor.inertia", rig, two_mass(), Options(hold=("motor.inertia",))),
        (BadRecording, "motor speed", experiment(torque, speed, "load_speed"), two_mass(), Options()),
        (NotEnoughData, "samples", rig.between(0.0, 0.025), two_mass(), Options()),
        (NotEnoughData, "torque", experiment(0.0 * torque, speed), two_mass(), Options()),
        (NotEnoughData, "speed", experiment(torque, 0.0 * speed), two_mass(), Options()),
    ]
    for kind, word, record, drive, options in cases:
        with pytest.raises(kind, match=word):
            blackbox([record], drive, options)


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([60, 100, 400]))
def test_noise_alone_is_never_a_machine(seed, size):
    rng = np.random.default_rng(seed)
    record = experiment(rng.standard_normal(size), rng.standard_normal(size))
    estimate = blackbox([record], two_mass(), Options(starts=1))
    assert "failure" in codes(estimate).values()
    assert all(p.status != "fitted" for p in estimate.parameters if p.name in SHAFT)


def test_form_takes_the_friction_of_the_parts():
    drive = two_mass().with_values({"motor.viscous": 0.1, "load.viscous": 0.4, "shaft.ratio": 2.0})
    form = form_of(drive, ("motor_torque", "load_torque"), False)
    assert form.viscous == pytest.approx(0.2) and form.signs == (-1.0,)
