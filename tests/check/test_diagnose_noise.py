"""The noise model under which causes are judged, and bases and causes that are not lost on the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check import hypothesis
from drivetool.check.causes import FITTED
from drivetool.check.causes.starts import added
from drivetool.check.diagnose import base_model
from drivetool.check.heldout import both, cautious
from drivetool.check.hypothesis import NEEDED, Tried, attempt, sizeable
from drivetool.check.model import Model, everything, first_noise, fit, listened, whitened
from drivetool.check.structure import carried
from drivetool.identify.estimate import Parameter
from drivetool.identify.setup import first_point, roles_of
from drivetool.identify.task import Task
from tests.recover import STEP, drive_like, experiment, one_sensor, resonance
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
    point, masks = first_point(drive, problem, task.roles), everything(problem)
    return fit("base", task, problem, point, first_noise(problem, point, masks), masks, rounds=10)


@pytest.mark.parametrize("wrong", [0.05, 20.0])
@pytest.mark.parametrize("seed", [20, 23])
def test_sensor_noises_are_found_from_a_wrong_guess(seed, wrong):
    model = fitted(*two_sensors(seed), wrong * LOAD / MOTOR)
    # The std of a std over 4000 samples is a hundredth.
    assert model.noise.scale[1] == pytest.approx(LOAD / MOTOR, rel=0.05)


def test_only_what_counts_tells_how_loud_a_sensor_is():
    """The load sensor three times as loud over the second half."""
    machine, record = two_sensors(20)
    model = fitted(machine, record, LOAD / MOTOR)
    top = np.abs(record.signals["motor_speed"]).max()
    more = np.concatenate((np.zeros(2000), white_noise(2000, np.sqrt(8.0) * LOAD * top, 9)))
    louder = replace(record, signals={**record.signals, "load_speed": record.signals["load_speed"] + more})
    problem = replace(model.task, experiments=(louder,)).problem()
    early = np.arange(4000) < 2000
    quiet, loud = (listened(problem, model.point, model.noise, [mask]).scale[1] for mask in (early, ~early))
    assert quiet == pytest.approx(LOAD / MOTOR, rel=0.1)
    assert loud == pytest.approx(3.0 * quiet, rel=0.2)


def test_torque_noise_that_remembers_is_left_where_white_noise_is_likelier():
    """A cause that is missing looks like slow noise; once it is there, the memory must be able to go."""
    white, _ = one_sensor(20)
    masks = everything(white.problem)
    slow = fit("base", white.task, white.problem, white.point, replace(white.noise, memory=0.99), masks,
               rounds=2, renew=False)
    assert slow.value > white.value + 10.0
    again = whitened(slow, masks)
    assert again.noise.memory is None and again.value < white.value + 1.0
    assert [m.noise.memory for m in both(slow, masks)] == [0.99, None]


@pytest.mark.parametrize("seed", [20, 23])
def test_a_torque_noise_that_was_absorbed_is_heard_again(seed):
    base, ratio = one_sensor(seed)
    deaf = replace(base, noise=replace(base.noise, ratio=1e-4 * ratio))
    masks = everything(base.problem)
    assert cautious(deaf, masks).noise.ratio == pytest.approx(ratio, rel=0.25)
    right = replace(base, noise=replace(base.noise, ratio=ratio))
    assert cautious(right, masks) is right
    remembering = replace(base, noise=replace(base.noise, memory=0.9))
    assert cautious(remembering, masks) is remembering


def test_a_base_that_was_led_astray_begins_again_from_its_start_values():
    base, _ = one_sensor(20)
    begun = {n: base.fitted.drive.value(n) for n in base.task.free}
    astray = base.task.at({"motor.inertia": 40.0 * begun["motor.inertia"],
                           "load.inertia": 30.0 * begun["load.inertia"],
                           "shaft.stiffness": 1e-3 * begun["shaft.stiffness"]})
    assert base_model(astray).value > base.value + 100.0
    assert base_model(astray, None, begun).value == pytest.approx(base.value, abs=1.0)


def coulomb_beside(base, value):
    """A Coulomb friction on top of a base, taken to be as likely as said."""
    start = added(base, {"motor.coulomb": 0.01 * abs(base.fitted.drive.value("load.idle_torque"))}, ())
    problem = start.task.problem()
    return Model("coulomb-motor", start.task, problem, carried(base, start.task, problem), base.noise, value)


def test_a_cause_that_is_begun_again_is_not_lost(monkeypatch):
    """Beside a base that has taken its parameters over its fit may end anywhere."""
    base, _ = one_sensor(20)
    model, cause = coulomb_beside(base, base.value - 50.0), next(c for c in FITTED if c.code == "coulomb-motor")
    monkeypatch.setattr(hypothesis, "fit", lambda *_, **__: replace(model, value=base.value + 1e3))
    assert attempt(cause, base, everything(base.problem), Tried(cause, (model,), {})).model is model


@pytest.mark.parametrize(("gain", "worth", "absent"), [
    (50.0, NEEDED - 1.0, "no-gain"), (50.0, NEEDED + 1.0, None), (NEEDED - 1.0, 50.0, "no-gain")])
def test_a_cause_without_a_standard_error_to_go_by_must_be_worth_something(monkeypatch, gain, worth, absent):
    """worth: by how much the base is less likely that begins with its parameters."""
    base, _ = one_sensor(20)
    model = coulomb_beside(base, base.value - gain)
    line = Parameter("motor.coulomb", 1.0, "Nm", 0.0, 10.0, (-19.0, 21.0))
    monkeypatch.setattr(hypothesis, "values_of", lambda *_: (line,))
    monkeypatch.setattr(hypothesis, "without", lambda model, *_: replace(model, value=model.value + worth))
    tried = Tried(next(c for c in FITTED if c.code == "coulomb-motor"), (model,), {"motor.coulomb": 1.0})
    assert sizeable(tried, base, everything(base.problem)).absent == absent
