"""Torque logged in another cycle than it acts in: found, corrected by `shift`; nothing else is mistaken for it."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.faults import late_torque, torque_timing_findings
from drivetool.drive import one_body, two_mass
from drivetool.identify.backlash.estimator import backlash
from drivetool.identify.blackbox.estimator import blackbox
from drivetool.identify.channels import late_torque as module
from drivetool.identify.channels.late_torque import torque_timing
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from drivetool.identify.several.comparison import CompareOptions, compare
from drivetool.logs import Channel, Experiment, Recording
from drivetool.logs.channels import SCHEMA, ChannelMap
from drivetool.logs.door.build import build_experiment
from tests.recover import drive_like, gap_record, linear_record, truth
from tests.simulator.machine import machine_by_seed

N, STEP = 4000, 2e-3
INERTIA, VISCOUS = 0.02, 0.03
SHIFT_BY_NAME = {"right": 0, "late": 1, "early": -1}


def excitation(rng, hold=40):
    return np.repeat(rng.uniform(-1, 1, N // hold), hold) + 0.2 * np.sin(np.arange(N) ** 1.5 / 400)


def axis(seed, noise=0.02, measured=False):
    """(torque, speed) of one body with viscous friction, exact under a torque that is held or runs on between."""
    rng = np.random.default_rng(seed)
    torque = excitation(rng, 1000 if measured else 40)
    decay = np.exp(-VISCOUS / INERTIA * STEP)
    acting = 0.5 * (torque + np.append(torque[1:], torque[-1])) if measured else torque
    speed = np.zeros(N)
    for k in range(N - 1):
        speed[k + 1] = decay * speed[k] + (1 - decay) / VISCOUS * acting[k]
    return torque, speed + noise * rng.standard_normal(N)


def record(torque, speed, way="right", shift=None):
    channels = {"motor_torque": Channel(np.arange(N) * STEP, np.roll(torque, SHIFT_BY_NAME[way]), "Nm"),
                "motor_speed": Channel(np.arange(N) * STEP, speed, "rad/s")}
    roles = {role: {"channel": role} for role in channels}
    if shift is not None:
        roles["motor_torque"]["shift"] = shift
    return build_experiment(Recording("log", "0" * 64, channels),
                            ChannelMap.from_mapping({"schema": SCHEMA, "roles": roles}))


def fitted(experiment):
    start = one_body("Nm", "rad").with_values({"motor.inertia": 0.015, "motor.viscous": 0.02})
    return greybox([experiment], start, Options())


SHIFT_CODES = ("torque-shifted", "torque-shifted")
TIMING_CODES = (*SHIFT_CODES, "torque-filtered", "input-delay")


def findings_by_code(findings, of=SHIFT_CODES):
    return {f.code: f for f in findings if f.code in of}


def parameter_line(estimate, name="motor.inertia"):
    return next(p for p in estimate.parameters if p.name == name)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.02, 0.002, 0.1])
@pytest.mark.parametrize("way", ["late", "early"])
def test_a_shift_is_found_and_its_cure_is_one(way, noise):
    torque, speed = axis(3, noise)
    right = fitted(record(torque, speed))
    wrong = fitted(record(torque, speed, way))
    found = findings_by_code(wrong.findings)["torque-shifted"]
    assert found.evidence["shift"] == pytest.approx(-SHIFT_BY_NAME[way] * STEP)
    assert f"`shift: {-SHIFT_BY_NAME[way] * STEP:g}`" in found.action
    cured = fitted(record(torque, speed, way, found.evidence["shift"]))
    assert not findings_by_code(right.findings) and not findings_by_code(cured.findings)
    assert abs(parameter_line(cured).value - INERTIA) < 3.0 * parameter_line(cured).std
    assert parameter_line(cured).std < 1.2 * parameter_line(right).std
    assert set(findings_by_code(torque_timing_findings(record(torque, speed, way)))) == {"torque-shifted"}
    assert not findings_by_code(torque_timing_findings(record(torque, speed)))


@pytest.mark.slow
@pytest.mark.parametrize("way", ["right", "late", "early"])
def test_two_masses(way):
    machine = machine_by_seed(1)
    whole = linear_record(machine, 1)
    names = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "total.viscous",
             "total.idle_torque")
    late = replace(whole, signals={**whole.signals, "motor_torque": np.roll(
        whole.signals["motor_torque"], SHIFT_BY_NAME[way])})
    found = greybox([late], drive_like(machine, list(names), 0.1), Options())
    assert set(findings_by_code(found.findings)) == ({"torque-shifted"} if SHIFT_BY_NAME[way] else set())
    if not SHIFT_BY_NAME[way]:
        assert abs(parameter_line(found).value - truth(machine)["motor.inertia"]) < 3.0 * parameter_line(found).std


def ringing(seed=2):
    """A load on a weak shaft, by half-implicit steps of a fiftieth of a sample; one body is the wrong model."""
    rng = np.random.default_rng(seed)
    torque, speed = excitation(rng), np.zeros(N)
    wm = wl = twist = 0.0
    for k in range(N):
        speed[k] = wm
        for _ in range(50):
            spring = 60.0 * twist + 0.02 * (wm - wl)
            wm += STEP / 50 * (torque[k] - spring - 0.02 * wm) / 0.01
            wl += STEP / 50 * (spring - 0.02 * wl) / 0.03
            twist += STEP / 50 * (wm - wl)
    return torque, speed + 0.01 * rng.standard_normal(N)


def closed_loop(seed=5, gain=0.4):
    """A speed loop whose torque carries the noise of the sensor."""
    rng = np.random.default_rng(seed)
    torque, speed, w = np.zeros(N), np.zeros(N), 0.0
    for k in range(N):
        speed[k] = w + 0.03 * rng.standard_normal()
        torque[k] = gain * (3 * np.sign(np.sin(k / 150)) - speed[k])
        w += STEP * (torque[k] - VISCOUS * w) / INERTIA
    return torque, speed


@pytest.mark.parametrize("make", [
    pytest.param(ringing, marks=pytest.mark.slow), closed_loop, lambda: axis(7, 0.005, measured=True)])
def test_nothing_else_is_mistaken_for_a_shift(make):
    experiment = record(*make())
    assert not findings_by_code(fitted(experiment).findings) and not findings_by_code(
        torque_timing_findings(experiment))


@pytest.mark.slow
def test_a_shift_is_found_in_closed_loop():
    torque, speed = closed_loop()
    assert set(findings_by_code(fitted(record(torque, speed, "late")).findings)) == {"torque-shifted"}


@pytest.mark.slow
def test_bounds_have_a_reason(monkeypatch):
    """With a tenth of the residual limit a shift is missed; without a limit, one body explains a resonance."""
    right, wrong = (late_torque._one_body(record(*given, "late")) for given in (axis(3), ringing()))
    assert findings_by_code(torque_timing(right)) and not findings_by_code(torque_timing(wrong), of=TIMING_CODES)
    monkeypatch.setattr(module, "MAX_AUTOCORRELATION", 0.01)
    assert not findings_by_code(torque_timing(right), of=TIMING_CODES)
    monkeypatch.setattr(module, "MAX_AUTOCORRELATION", 1.0)
    monkeypatch.setattr(module, "MAX_REPAIRABLE", 1.0)
    assert findings_by_code(torque_timing(wrong), of=TIMING_CODES)


@pytest.mark.parametrize(("way", "samples"), [
    ("late", 1), ("right", 0), pytest.param("early", -2, marks=pytest.mark.slow)])
def test_a_shift_is_found_at_a_resonance(way, samples):
    torque, speed = ringing()
    found = findings_by_code(torque_timing_findings(record(np.roll(torque, samples), speed)))
    assert set(found) == ({"torque-shifted"} if samples else set())
    assert not samples or found["torque-shifted"].evidence["shift"] == pytest.approx(-samples * STEP)


# --- what is no shift

def low_passed(torque, time):
    """y += (u - y) / (1 + time), as a drive filters what it logs."""
    found, y = np.empty_like(torque), torque[0]
    for k, u in enumerate(torque):
        y += (u - y) / (1.0 + time)
        found[k] = y
    return found


@pytest.mark.slow
@pytest.mark.parametrize("time", [0.5, 1.0, 2.0, 5.0, 10.0, 20.0])
@pytest.mark.parametrize("later", [0, 1])
def test_a_filtered_torque_is_not_cured_by_a_shift(time, later):
    """Alone, or also logged in the next cycle: the time constant is about right, or there is no finding."""
    torque, speed = axis(3)
    found = findings_by_code(torque_timing_findings(record(np.roll(low_passed(torque, time), later), speed)),
                             of=TIMING_CODES)
    assert set(found) <= {"torque-filtered"}
    if found:
        assert found["torque-filtered"].evidence["time_constant"] == pytest.approx(time * STEP, rel=0.3)
    elif time == 1.0:
        pytest.fail("a plain filter goes unseen")


@pytest.mark.slow
def test_a_filter_is_identified_with_two_masses():
    machine = machine_by_seed(102)
    whole = linear_record(machine, 102)
    torque = low_passed(whole.signals["motor_torque"], 5.0)
    filtered = replace(whole, signals={**whole.signals, "motor_torque": torque})
    found = findings_by_code(blackbox([filtered], two_mass(), Options()).findings, of=TIMING_CODES)
    assert found["torque-filtered"].evidence["time_constant"] == pytest.approx(5.0 * 1e-3, rel=0.4)


@pytest.mark.slow
def test_a_lag_of_the_converter_is_no_shift():
    torque, _ = axis(3)
    acting = low_passed(torque, 1.0)
    decay = np.exp(-VISCOUS / INERTIA * STEP)
    speed = np.zeros(N)
    for k in range(N - 1):
        speed[k + 1] = decay * speed[k] + (1 - decay) / VISCOUS * acting[k]
    speed += 0.02 * np.random.default_rng(1).standard_normal(N)
    found = findings_by_code(torque_timing_findings(record(torque, speed)), of=TIMING_CODES)
    assert set(found) == {"input-delay"} and "converter.bandwidth" in found["input-delay"].action


# --- the other steps that fit by innovations

@pytest.mark.slow
@pytest.mark.parametrize("way", ["late", "right"])
def test_black_box_and_compare_test_for_a_shift(way):
    machine = machine_by_seed(1)
    whole = linear_record(machine, 1)
    late = replace(whole, signals={**whole.signals, "motor_torque": np.roll(
        whole.signals["motor_torque"], SHIFT_BY_NAME[way])})
    expected = {"torque-shifted"} if SHIFT_BY_NAME[way] else set()
    drive = drive_like(machine, [n for n in truth(machine) if not n.startswith("total")])
    assert set(findings_by_code(blackbox([late], two_mass(), Options()).findings)) == expected
    found = compare([late, replace(late, name="again")], drive, CompareOptions(("physical-innovations",)))
    assert {f.code: f.text for f in found.findings if f.code in SHIFT_CODES}.keys() == expected
    assert all(f.text.startswith("physical-innovations on ") for f in found.findings if f.code in SHIFT_CODES)


@pytest.mark.slow
@pytest.mark.parametrize("way", ["late", "right"])
def test_backlash_tests_for_a_shift(way):
    machine = machine_by_seed(11)
    whole = gap_record(machine, 11)[0]
    late = replace(whole, signals={**whole.signals, "motor_torque": np.roll(
        whole.signals["motor_torque"], SHIFT_BY_NAME[way])})
    drive = drive_like(machine, [n for n in truth(machine) if not n.startswith("total")])
    assert set(findings_by_code(backlash([late], drive, Options()).findings)) == (
        {"torque-shifted"} if SHIFT_BY_NAME[way] else set())


def test_a_record_without_torque_or_motion_is_not_tested():
    still = Experiment("log", "0" * 64, STEP, 0.0, {"motor_speed": np.sin(np.arange(N) / 9)}, ((0, N),))
    assert torque_timing_findings(still) == []
    with_load = replace(still, signals={"motor_torque": np.ones(N), "load_speed": np.sin(np.arange(N) / 9)})
    assert torque_timing_findings(with_load) == [] and two_mass().bodies


def test_a_current_beside_a_torque_is_tested_as_it_is():
    """Neither the unit of a torque nor the torque of the shaft affects the test."""
    torque, speed = axis(3)
    made = record(torque, speed, "late")
    mixed = replace(made, signals={**made.signals, "motor_torque": made.signals["motor_torque"] / 0.35,
                                   "shaft_torque": torque}, input_units={"motor_torque": "A"})
    assert set(findings_by_code(torque_timing_findings(mixed))) == {"torque-shifted"}
