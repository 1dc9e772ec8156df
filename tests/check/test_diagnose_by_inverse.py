"""Diagnosis by the required torque of an imposed motion, on records of the simulator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.fit.model import Model
from drivetool.check.full_diagnosis import diagnose
from drivetool.check.inverse.cross_validated_fit import independent_share
from drivetool.check.outcome.diagnosis import DiagnoseOptions
from drivetool.drive import one_body, two_mass
from drivetool.errors import BadOption, BadParameters, NotEnoughData
from drivetool.identify.greybox import greybox
from drivetool.identify.motion import check_no_signal_path
from drivetool.identify.noise import Noise
from drivetool.identify.setup import Options, Task, first_point, roles_of
from tests.recover import experiment
from tests.simulator.effects import Effects
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise

STEP = 1e-3
BY_TORQUE = DiagnoseOptions(("coulomb-motor", "quadratic-drag", "asymmetric-friction", "imbalance"),
                            criterion="inverse")


def moved(machine, seed, noise=2e-3, torque_noise=0.01, seconds=6.0):
    """A stiff speed loop moves the motor to and fro, ever faster and slower."""
    n = round(seconds / STEP)
    time = np.arange(n) * STEP
    height = 4.0 + 3.0 * np.sin(0.4 * time + np.random.default_rng(seed).uniform(0.0, 6.0))
    reference = height * np.sin(2.0 * np.pi * time)
    run = simulate_fast(machine, np.zeros(n), STEP, controller=PI(reference, 6.0, 60.0),
                        torque_noise=white_noise(n, torque_noise, seed + 1),
                        sensor_noise=white_noise(n, noise, seed + 2), finer=8)
    return experiment(run.command, run.measured, reference_speed=reference)


def base_of(record, drive, hold=()):
    """(fitted drive, free names, what they began at) by the same criterion."""
    found = greybox([record], drive, Options(criterion="inverse", hold=hold))
    free = [p.name for p in found.parameters if p.status != "held"]
    return found.drive, free, {p.name: p.start for p in found.parameters if p.name in free}


BODY = {"motor.inertia": 0.06, "motor.viscous": 0.05, "motor.coulomb": 0.0}
FRICTION = Machine((0.05,), (0.02,), (0.3,))
DRAG = Machine((0.05,), (0.02,), (0.0,), effects=Effects(quadratic=(0.01,)))
NOTHING = Machine((0.05,), (0.02,), (0.0,))


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "named", "name", "true"), [
    (FRICTION, "coulomb-motor", "motor.coulomb", 0.3), (DRAG, "quadratic-drag", "motor.drag", 0.01)])
@pytest.mark.parametrize("held_out", [False, True], ids=["halves", "record"])
def test_what_a_body_lacks_is_named_with_its_size_and_gain(machine, named, name, true, held_out):
    record = moved(machine, 11)
    drive, free, start_values = base_of(record, one_body().with_values(BODY), ("motor.coulomb",))
    found = diagnose([record], drive, free, BY_TORQUE, [moved(machine, 21)] if held_out else (), start_values)
    assert found.verdict == "named" and found.causes == (named,) and found.between == ()
    line = next(p for p in found.estimate.parameters if p.name == name)
    assert line.ci95[0] < true < line.ci95[1] and line.std < 0.05 * true
    assert found.gain.of == "torque" and found.gain.further_record_interval[0] > 0.0
    assert "the required torque has an rms error of" in found.sentence and "nan" not in found.sentence
    assert np.isnan(found.gain.unexplained_percent)  # what is left need not be a law of the motion
    states = {c.code: c.state for c in found.rounds[0].candidates}
    assert states[named] == "named" and len(states) == len(BY_TORQUE.candidates)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("reference", [True, False], ids=["instruments", "without"])
def test_noise_of_a_closed_loop_is_no_cause(seed, reference):
    """The sensor's noise is in the acceleration: least squares let a wave over the angle follow it."""
    record = moved(NOTHING, seed)
    if not reference:
        record = replace(record, signals={n: v for n, v in record.signals.items() if n != "reference_speed"})
    drive, free, start_values = base_of(record, one_body().with_values(BODY), ("motor.coulomb",))
    found = diagnose([record], drive, free, BY_TORQUE, (), start_values)
    assert found.verdict == "nothing-found" and found.causes == ()


def test_a_path_between_torque_and_body_or_a_base_without_fitted_parameters_is_refused():
    record = moved(NOTHING, 11, seconds=3.0)
    drive = one_body().with_values(BODY)
    with pytest.raises(BadOption, match="converter"):
        diagnose([record], drive.with_values({"converter.bandwidth": 50.0}), ["motor.inertia"], BY_TORQUE)
    with pytest.raises(BadParameters, match="criterion inverse"):
        diagnose([record], drive, [], BY_TORQUE)
    chain = two_mass().with_values({"motor.inertia": 0.05, "load.inertia": 0.02, "shaft.stiffness": 400.0,
                                    "shaft.damping": 1.0, "total.viscous": 0.1})
    with pytest.raises(BadOption, match="friction of each body"):
        diagnose([record], chain, ["total.viscous"], BY_TORQUE)


@pytest.mark.slow
def test_a_record_too_short_for_a_test_is_refused_and_one_without_torque_has_no_fit_percent():
    record = moved(FRICTION, 11)
    drive, free, start_values = base_of(record, one_body().with_values(BODY), ("motor.coulomb",))
    with pytest.raises(NotEnoughData, match="test blocks"):
        diagnose([record], drive, free, BY_TORQUE, [moved(FRICTION, 21, seconds=0.5)], start_values)
    other = moved(FRICTION, 21)
    silent = replace(other, signals={**other.signals, "motor_torque": 0.0 * other.signals["motor_torque"]})
    found = diagnose([record], drive, free, BY_TORQUE, [silent], start_values)
    assert np.isnan(found.gain.held_out_fit_before) and np.isfinite(found.gain.held_out_rmse_before)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [21, 22, 23])
def test_instruments_that_fail_on_the_held_out_record_make_no_cause(seed):
    """A drive fitted to it by least squares is the base's best there, whatever its reference."""
    record, other = moved(NOTHING, 11), moved(NOTHING, seed, seconds=4.0)
    still = np.full(other.size, 3.0)
    still[:5] = 3.1
    other = replace(other, signals={**other.signals, "reference_speed": still})
    drive, free, start_values = base_of(record, one_body().with_values(BODY), ("motor.coulomb",))
    assert diagnose([record], drive, free, BY_TORQUE, [other], start_values).causes == ()


def test_correlated_errors_count_as_fewer():
    """Bartlett: a moving mean over m values has 3 m / (2 m^2 + 1) of the independent ones."""
    white = np.random.default_rng(5).standard_normal(40_000)
    for m in (1, 2, 5, 10):
        share = independent_share(np.convolve(white, np.ones(m), "valid"))
        assert share == pytest.approx(3.0 * m / (2.0 * m**2 + 1.0), rel=0.15)


@pytest.mark.parametrize("code", [c.code for c in CAUSES.values() if c.imposed])
def test_every_cause_of_an_imposed_motion_begins_with_laws_of_bodies_and_shafts(code):
    time = STEP * np.arange(2000)
    record = experiment(np.cos(9.0 * time), np.sin(9.0 * time))
    drive = two_mass().with_values({
        "motor.inertia": 0.05, "motor.viscous": 0.02, "motor.coulomb": 0.1, "load.inertia": 0.02,
        "load.viscous": 0.01, "load.coulomb": 0.0, "shaft.stiffness": 400.0, "shaft.damping": 1.0})
    if code == "coulomb-motor":
        drive = drive.with_values({"motor.coulomb": 0.0})
    roles = roles_of([record], drive)
    task = Task(drive, ("motor.inertia", "load.viscous"), roles, (record,))
    problem = task.problem()
    base = Model("base", task, problem, first_point(drive, problem, roles), Noise(1.0, None, np.ones(1)), 0.0)
    starts = CAUSES[code].imposed(base)
    owners = {*drive.bodies, *drive.shafts, "friction"}
    assert starts
    for start in starts:
        new = set(start.task.free) - set(task.free)
        assert new and {n.partition(".")[0] for n in new} <= owners
        assert start.task.drive.bodies == drive.bodies
        check_no_signal_path(start.task.drive, start.task.free)


@pytest.mark.slow
def test_causes_that_the_torque_does_not_identify_say_so():
    record = moved(NOTHING, 11, seconds=3.0)
    drive, free, start_values = base_of(record, one_body().with_values(BODY), ("motor.coulomb",))
    found = diagnose([record], drive, free, DiagnoseOptions(("converter-lag", "outliers"), criterion="inverse"), (),
                     start_values)
    assert {c.state for c in found.rounds[0].candidates} == {"not-shown"}
    assert all("simulation" in c.reason for c in found.rounds[0].candidates)


@pytest.mark.slow
def test_the_figures_of_a_gain_are_those_of_the_equation_of_motion():
    """By scipy's filter and a mean over each interval, samples about reversals left out."""
    record, other = moved(FRICTION, 11), moved(FRICTION, 21)
    drive, free, start_values = base_of(record, one_body().with_values(BODY), ("motor.coulomb",))
    found = diagnose([record], drive, free, BY_TORQUE, [other], start_values)
    band = found.estimate.fit["band_hz"]
    speed, torque = (sosfiltfilt(butter(4, 2.0 * band * STEP, output="sos"), other.signals[role])
                     for role in ("motor_speed", "motor_torque"))
    acceleration, mean, torque = np.diff(speed) / STEP, 0.5 * (speed[1:] + speed[:-1]), torque[:-1]
    turned = np.concatenate([[False], mean[1:] * mean[:-1] < 0.0])
    used = np.convolve(turned, np.ones(2 * int(1.0 / (band * STEP)) + 3), "same") < 0.5
    used[:100] = used[-100:] = False
    for v, rmse, fit in ((drive.values, found.gain.held_out_rmse_before, found.gain.held_out_fit_before),
                         (found.estimate.drive.values, found.gain.held_out_rmse_after,
                          found.gain.held_out_fit_after)):
        required = v["motor.inertia"] * acceleration + v["motor.viscous"] * mean + v["motor.idle_torque"]
        residual = (torque - required - v["motor.coulomb"] * np.sign(mean))[used]
        error = np.sqrt(np.mean(residual**2))
        assert rmse == pytest.approx(error, rel=0.05)
        assert fit == pytest.approx(100.0 * (1.0 - error / np.std(torque[used])), abs=1.0)
