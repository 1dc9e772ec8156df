"""The noise model under which causes are tested, and bases that do not diverge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from drivetool.check.fit.model import (
    Model,
    all_samples,
    fit,
    fit_from_start,
    initial_noise,
    reestimate_noise,
    with_likeliest_noise,
)
from drivetool.check.full_diagnosis import Request, base_and_alternatives
from drivetool.check.outcome.diagnosis import DiagnoseOptions
from drivetool.identify.setup import Task, first_point, roles_of
from tests.recover import STEP, drive_like, experiment, one_sensor, resonance, reversing_record, tried
from tests.simulator.experiments import multisine
from tests.simulator.machine import machine_by_seed
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

FREE = ("motor.inertia", "load.inertia", "motor.viscous", "load.viscous", "load.idle_torque", "shaft.stiffness",
        "shaft.damping")
MOTOR, LOAD = 1e-3, 4e-5  # noise of the speeds over the top speed


def two_sensors(seed):
    """A record with motor and load speed, and their noises."""
    machine, size = machine_by_seed(seed), 4000
    rated = machine.rated_torque
    torque = multisine(np.linspace(0.05, 2.0, 12) * resonance(machine), 0.1 * rated, size * STEP, STEP, seed)[:size]
    run = simulate_linear(machine, torque, STEP, None, white_noise(size, 0.002 * rated, 3 * seed))
    top = np.abs(run.speeds).max()
    motor, load = (run.speeds[:, k] + white_noise(size, share * top, 3 * seed + 1 + k)
                   for k, share in enumerate((MOTOR, LOAD)))
    return machine, experiment(torque, motor, load_speed=load)


def fitted(machine, record, guess):
    """The base as diagnose fits it, from a guess of the load sensor's noise over that of the motor's."""
    drive = drive_like(machine, list(FREE))
    task = Task(drive, FREE, roles_of([record], drive), (record,))
    assert task.roles.outputs == ("motor_speed", "load_speed")
    problem = replace(task.problem(), scale=np.array([1.0, guess]))
    point, masks = first_point(drive, problem, task.roles), all_samples(problem)
    return fit(Model("base", task, problem, point, initial_noise(problem, point, masks)), masks)


@pytest.mark.parametrize("wrong", [0.05, 20.0])
@pytest.mark.parametrize("seed", [20, 23])
def test_sensor_noises_are_found_from_a_wrong_guess(seed, wrong):
    model = fitted(*two_sensors(seed), wrong * LOAD / MOTOR)
    # The std of a std over 4000 samples is a hundredth.
    assert model.noise.scale[1] == pytest.approx(LOAD / MOTOR, rel=0.05)


def test_only_counted_samples_determine_the_noise_of_a_sensor():
    """The load sensor three times as loud over the second half."""
    machine, record = two_sensors(20)
    model = fitted(machine, record, LOAD / MOTOR)
    top = np.abs(record.signals["motor_speed"]).max()
    more = np.concatenate((np.zeros(2000), white_noise(2000, np.sqrt(8.0) * LOAD * top, 9)))
    louder = replace(record, signals={**record.signals, "load_speed": record.signals["load_speed"] + more})
    other = replace(model, problem=replace(model.task, experiments=(louder,)).problem())
    early = np.arange(4000) < 2000
    quiet, loud = (fit(other, [mask]).noise.scale[1] for mask in (early, ~early))
    assert quiet == pytest.approx(LOAD / MOTOR, rel=0.1)
    assert loud == pytest.approx(3.0 * quiet, rel=0.2)


def linear(seed, memory, share):
    """(a base of a record whose torque noise remembers, or not; its std over the sensor's).

    share  std of the torque noise over the rated torque
    """
    machine, size = machine_by_seed(seed), 4000
    rated = machine.rated_torque
    torque = multisine(np.linspace(0.05, 2.0, 12) * resonance(machine), 0.1 * rated, size * STEP, STEP, seed)[:size]
    noise = white_noise(size, share * rated, 3 * seed)
    noise = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], noise)
    run = simulate_linear(machine, torque, STEP, None, noise)
    sensor = 1e-3 * np.abs(run.speeds).max()
    record = experiment(torque, run.speeds[:, 0] + white_noise(size, sensor, 3 * seed + 1))
    free = tuple(n for n in FREE if n != "load.viscous")
    drive = drive_like(machine, list(free))
    return fit_from_start(Task(drive, free, roles_of([record], drive), (record,))), share * rated / sensor


@pytest.mark.parametrize("seed", [20, 23])
def test_correlated_torque_noise_is_estimated_with_its_pole(seed):
    """A time constant of 50 samples, some eighty times in the record: identified to a third of itself."""
    base, ratio = linear(seed, 0.98, 0.01)
    found = reestimate_noise(base, all_samples(base.problem))
    assert found.value < base.value - 50.0 and found.noise.slow is None
    assert 1.0 - found.noise.memory == pytest.approx(0.02, rel=0.35)
    assert found.noise.ratio == pytest.approx(ratio, rel=0.25)


@pytest.mark.parametrize("share", [0.002, 0.01])
@pytest.mark.parametrize("seed", [20, 23])
def test_white_torque_noise_is_left_white_and_found_as_loud_as_it_is(seed, share):
    base, ratio = linear(seed, 0.0, share)
    assert reestimate_noise(base, all_samples(base.problem)) is base
    assert base.noise.ratio == pytest.approx(ratio, rel=0.25)


@pytest.mark.parametrize("share", [0.01, 0.03])
def test_slow_noise_replaces_a_law_until_that_is_there(share):
    """Dry friction: a base without it is likelier under slow noise, the friction itself under white noise."""
    machine = machine_by_seed(20)
    record, _ = reversing_record(replace(machine, coulomb=(share * machine.rated_torque, 0.0)), 20, 4.0)
    free = ("motor.inertia", "load.inertia", "total.viscous", "total.idle_torque", "shaft.stiffness",
            "shaft.damping")
    drive = drive_like(machine, list(free))
    base = fit_from_start(Task(drive, free, roles_of([record], drive), (record,)))
    masks = all_samples(base.problem)
    slow = reestimate_noise(base, masks)
    assert slow.noise.memory > 0.99 and slow.value < base.value - 50.0
    cause = tried("coulomb-motor", base).model
    assert reestimate_noise(cause, masks) is cause and cause.noise.memory is None
    assert cause.value < slow.value - 50.0


def test_torque_noise_that_remembers_is_left_where_white_noise_is_likelier():
    """A cause that is missing looks like slow noise; once it is there, the memory must be able to go."""
    white, _ = one_sensor(20)
    masks = all_samples(white.problem)
    slow = fit(replace(white, noise=replace(white.noise, memory=0.99)), masks, max_iterations=2, refit_noise=False)
    assert slow.value > white.value + 10.0
    again = reestimate_noise(slow, masks)
    assert again.noise.memory is None and again.value < white.value + 1.0


@pytest.mark.parametrize("seed", [23])  # of 20 the small ratio is the likelier one, by 2.6
def test_an_absorbed_torque_noise_is_estimated_again_on_other_records(seed):
    base, ratio = one_sensor(seed)
    deaf = replace(base, noise=replace(base.noise, ratio=1e-4 * ratio))
    assert with_likeliest_noise(deaf, all_samples(base.problem)).noise.ratio == pytest.approx(ratio, rel=0.25)


def bases_of(task, start_values):
    """(the base, the bases elsewhere) of a diagnosis of a task whose own fit began there."""
    return base_and_alternatives(task, Request(1, (task.drive, task.free), task.free, (), DiagnoseOptions(),
                                               start_values, ()))


@pytest.mark.slow
def test_a_diverged_base_starts_again_from_its_start_values():
    base, _ = one_sensor(20)
    start_values = {n: base.fitted.drive.value(n) for n in base.task.free}
    diverged = base.task.at({"motor.inertia": 40.0 * start_values["motor.inertia"],
                           "load.inertia": 30.0 * start_values["load.inertia"],
                           "shaft.stiffness": 1e-3 * start_values["shaft.stiffness"]})
    assert bases_of(diverged, {})[0].value > base.value + 100.0
    assert bases_of(diverged, start_values)[0].value == pytest.approx(base.value, abs=1.0)


@pytest.mark.parametrize(("factor", "bent"), [(1.3, False), (1.7, True)])
def test_a_base_more_than_half_off_its_start_is_also_evaluated_there(factor, bent):
    """Under the noise that it has there: no start is wrong by so much, so it may make up for a law."""
    base, _ = one_sensor(20)
    start_values = {n: base.fitted.drive.value(n) for n in base.task.free}
    start_values["shaft.stiffness"] *= factor
    root, elsewhere = bases_of(base.fitted, start_values)
    assert root.value == pytest.approx(base.value, abs=1.0)
    assert [dict(zip(m.task.free, m.point.values, strict=True)) for m in elsewhere] == [
        pytest.approx(start_values)] * bent
    assert all(m.value > root.value + 100.0 and m.noise != root.noise for m in elsewhere)
