"""Fits of recordings whose logger changed its rate: all rates are fitted, as one recording."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body, two_mass
from drivetool.identify.blackbox.estimator import blackbox
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.noise.noise import Noise, filtered, with_torque_noise
from drivetool.identify.problem.problem import Point
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.rates import STEPS_OF_EVERY_RATE, at_rates, rates_left_out
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from drivetool.identify.steady.estimator import steady
from drivetool.logs import Channel, Recording, parts_at_all_rates
from drivetool.logs.door.build import build_experiment
from tests.recover import resonance
from tests.simulator.experiments import multisine, staircase
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine, machine_by_seed
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

STEP = 1e-3
DRY = Machine(inertia=(0.01,), viscous=(0.02,), coulomb=(0.1,))
SMOOTH = Machine(inertia=(0.01,), viscous=(0.02,), idle_torque=(0.05,))
START = {"motor.inertia": 0.013, "motor.viscous": 0.03}
TWO, THREE = ((4.0, 1), (12.0, 4)), ((4.0, 1), (10.0, 4), (4.0, 1))  # seconds, every so many steps


def logged(parts, torque):
    """(samples that the logger takes, torque (n,) that is held between them)."""
    edges = np.round(np.cumsum([0.0, *(seconds for seconds, _ in parts)]) / STEP).astype(int)
    keep = np.concatenate([np.arange(a, b, every)
                           for a, b, (_, every) in zip(edges[:-1], edges[1:], parts, strict=True)])
    return keep, np.repeat(torque[keep], np.diff([*keep, edges[-1]]))


def recording(time, torque, speed, name="log"):
    channels = {"motor_torque": Channel(time, torque, "Nm"), "motor_speed": Channel(time, speed, "rad/s")}
    return Recording(name, hashlib.sha256(name.encode()).hexdigest(), channels)


def recorded(machine, parts, seed=1, torque_noise=0.004, speed_noise=0.01, lines=(0.25, 0.7, 1.3, 2.9, 5.1),
             size=0.15, name="log"):
    """A record of several rates; the torque, and its noise, are held from sample to sample."""
    n = round(sum(seconds for seconds, _ in parts) / STEP)
    keep, torque = logged(parts, multisine(lines, size, n * STEP, STEP, seed)[:n])
    noise = np.repeat(white_noise(len(keep), torque_noise, 7 * seed + 1), np.diff([*keep, n]))
    run = (simulate_linear(machine, torque, STEP, None, noise) if machine.is_linear
           else simulate_fast(machine, torque, STEP, torque_noise=noise))
    speed = run.speeds[keep, 0] + white_noise(len(keep), speed_noise, 7 * seed + 2)
    return recording(keep * STEP, torque[keep], speed, name)


def parameters_of(estimate):
    return {p.name: p for p in estimate.parameters}


@pytest.mark.parametrize("parts", [TWO, pytest.param(THREE, marks=pytest.mark.slow)])
def test_inertia_and_friction_of_every_rate_together(parts):
    whole = build_experiment(recorded(DRY, parts))
    drive, plain = one_body().with_values(START | {"motor.coulomb": 0.07}), Options(criterion="innovations")
    found = greybox([whole], drive, plain)
    alone = [parameters_of(greybox([part], drive, plain)) for part in parts_at_all_rates([whole])]
    for name, value in (("motor.inertia", 0.01), ("motor.viscous", 0.02), ("motor.coulomb", 0.1)):
        assert abs(parameters_of(found)[name].value - value) < 3.0 * parameters_of(found)[name].std
        assert parameters_of(found)[name].std < min(each[name].std for each in alone)
    assert found.fit["n"] == sum(part.used for part in parts_at_all_rates([whole]))
    # One file, and no repeats of a recording.
    assert found.data == (whole.source,)
    assert all(p.repeatability is None for p in found.parameters)


@pytest.mark.slow
@pytest.mark.parametrize("parts", [TWO, THREE])
def test_other_candidates_agree_at_every_rate(parts):
    """A regression and free runs smooth each rate by its own noise; they still agree."""
    for seed in range(3):
        made = build_experiment(recorded(SMOOTH, parts, seed))
        found = parameters_of(greybox([made], one_body().with_values(START), Options()))
        for name, value in (("motor.inertia", 0.01), ("motor.viscous", 0.02), ("motor.idle_torque", 0.05)):
            p = found[name]
            assert abs(p.value - value) < 3.0 * p.std and p.std_structure < 2.0 * p.std_noise


@pytest.mark.slow
@pytest.mark.parametrize("torque_noise", [pytest.param(0.004, marks=pytest.mark.long), 0.02])
def test_stated_stds_are_those_of_the_scatter(torque_noise):
    seeds, drive = range(30), one_body().with_values(START)
    found = [parameters_of(
        greybox([build_experiment(recorded(SMOOTH, ((2.0, 1), (6.0, 4)), 50 + s, torque_noise))], drive,
                Options(criterion="innovations"))) for s in seeds]
    for name, value in (("motor.inertia", 0.01), ("motor.viscous", 0.02), ("motor.idle_torque", 0.05)):
        z = [(each[name].value - value) / each[name].std for each in found]
        assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.4  # 3.1 standard errors of 30


@pytest.mark.slow
def test_two_masses_and_their_shaft():
    machine = machine_by_seed(3)
    f, rated = resonance(machine), machine.rated_torque
    made = recorded(machine if machine.is_linear else replace(machine, coulomb=(0.0, 0.0), half_gap=(0.0,)), TWO, 2,
                    0.002 * rated, 0.002 * rated * 0.25 / sum(machine.inertia),
                    np.linspace(0.03, 2.0, 15) * f, 0.02 * rated)
    names = {"motor.inertia": machine.inertia[0], "load.inertia": machine.inertia[1],
             "shaft.stiffness": machine.stiffness[0], "shaft.damping": machine.damping[0]}
    values = {n: 1.05 * v for n, v in names.items()} | {"total.viscous": sum(machine.viscous)}
    drive = two_mass().with_values(values)
    for fit, options in ((greybox, Options(criterion="innovations")), (blackbox, Options())):
        found = parameters_of(fit([build_experiment(made)], drive, options))
        for name in ("motor.inertia", "load.inertia", "shaft.stiffness"):
            assert abs(found[name].value - names[name]) < 4.0 * found[name].std


def test_steady_speeds_are_found_at_every_rate():
    levels = [20.0, 40.0, 60.0, -20.0, -40.0, -60.0]
    reference = staircase(levels, 3.0, 0.3, STEP)
    parts = ((9.9, 1), (len(reference) * STEP - 9.9, 4))
    n = len(reference)
    run = simulate_fast(DRY, np.zeros(n), STEP, controller=PI(reference, 0.1, 0.5),
                        sensor_noise=white_noise(n, 0.01, 1))
    keep, _ = logged(parts, run.command)
    whole = build_experiment(recording(keep * STEP, run.command[keep], run.measured[keep]))
    assert len(whole.others) == 1
    found = steady([whole], one_body(), Options())
    assert found.fit["intervals"] == 6 and found.data == (whole.source,)
    for name, value in (("motor.viscous", 0.02), ("motor.coulomb", 0.1)):
        assert abs(parameters_of(found)[name].value - value) < max(3.0 * parameters_of(found)[name].std,
                                                                   1e-3 * value)
    record = [e for e in found.exhibits if e.kind == "record"]
    # Each picture marks its own intervals alone: three speeds at each rate.
    marked = [np.isfinite(e.curves["steady intervals"][1]) for e in record]
    assert [int(np.sum(np.diff(m.astype(int)) == 1)) + int(m[0]) for m in marked] == [3, 3]


def test_a_known_start_is_that_of_the_first_rate():
    whole = build_experiment(recorded(SMOOTH, TWO))
    parts, drive = parts_at_all_rates([whole]), one_body().with_values(START)
    task = Task(drive, ("motor.inertia",), roles_of(parts, drive), tuple(parts), {-1: {"motor.speed": 0.0}})
    assert [bool(t.start) for t in task.traces()] == [True, False]
    # Nor is it known where the rate that a step takes is not the first one.
    task = replace(task, experiments=(parts[1],))
    assert [bool(t.start) for t in task.traces()] == [False]


@pytest.mark.slow
def test_parts_are_no_repeats_and_recordings_are():
    """Two recordings of machines that differ scatter; two rates of one recording are one of them."""
    other = replace(SMOOTH, viscous=(0.022,))
    two = [build_experiment(recorded(SMOOTH, ((1.5, 1), (4.0, 4)))),
           build_experiment(recorded(other, ((1.5, 1), (4.0, 4)), 2, name="other"))]
    found = parameters_of(greybox(two, one_body().with_values(START), Options(criterion="innovations")))
    assert found["motor.viscous"].repeatability == pytest.approx(0.002 / np.sqrt(2.0), rel=0.3)


def test_a_memory_of_the_torque_noise_is_as_long_at_every_rate():
    """With the noise of a held sample, the filter's innovations are white and of the stated size."""
    noise = Noise(8.0, float(np.exp(-STEP / 0.05)), np.ones(1))
    parts = parts_at_all_rates([build_experiment(recorded(SMOOTH, ((10.0, 1), (40.0, 4))))])
    drive = one_body().with_values({"motor.inertia": 0.01, "motor.viscous": 0.02, "motor.idle_torque": 0.05})
    problem = Task(drive, (), roles_of(parts, drive), tuple(parts)).problem()
    rng, traces = np.random.default_rng(1), []
    for t, plant in zip(problem.traces, problem.plants(np.empty(0), False), strict=True):
        tau = Noise(8.0, float(np.exp(-t.step / 0.05)), np.ones(1))
        y = plant.outputs(with_torque_noise(t, tau, 1e-2, rng), np.zeros(plant.nx))
        traces.append(replace(t, outputs=y + 1e-2 * rng.standard_normal(y.shape)))
    problem = replace(problem, traces=tuple(traces), sensor_std=1e-2)
    passes = filtered(problem, Point(np.empty(0), tuple(np.zeros(1) for _ in traces)), noise, keep=False)
    assert len(passes) == 2  # rates
    for f in passes:
        z = f.innovations[100:, 0] / np.sqrt(f.variance[100:, 0]) / 1e-2
        assert np.mean(z**2) == pytest.approx(1.0, abs=0.06) and abs(np.mean(z[1:] * z[:-1])) < 0.05


def test_which_steps_fit_every_rate_and_which_report_what_they_leave_out():
    whole = build_experiment(recorded(SMOOTH, TWO))
    for step in (*STEPS_OF_EVERY_RATE, "validate", "diagnose", "compare", "spectra", "simulate"):
        left = rates_left_out(step, [whole], Options())
        assert [f.code for f in left] == ([] if step in STEPS_OF_EVERY_RATE else ["rate-changes"])
        assert len(at_rates(step, [whole], Options())) == (2 if step in STEPS_OF_EVERY_RATE else 1)
    for options in (Options(criterion="inverse"), Options(criterion="frequency"), Options(structure="oe")):
        (left,) = rates_left_out("greybox", [whole], options)
        assert left.severity == "warning" and left.evidence["left_out"] == whole.others[0].used
        assert f"{whole.others[0].used} at" in left.text
    single = build_experiment(recorded(SMOOTH, ((6.0, 1),)))
    assert rates_left_out("spectra", [single]) == [] and at_rates("spectra", [single]) == [single]
