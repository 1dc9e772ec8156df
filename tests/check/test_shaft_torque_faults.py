"""The scale of a shaft torque sensor, from the motor alone, and its stated error."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivetool.check.faults.shaft import log_likelihood_gain_of_factor, scale_of, shaft_fault
from drivetool.check.fit.model import all_samples, fit_from_start
from drivetool.check.search.shaft_scale import most_likely_scale
from drivetool.drive import two_mass
from drivetool.drive.chain import three_mass
from drivetool.identify.setup import Task, roles_of
from drivetool.logs.door import open_experiment
from tests.hidden import make_case
from tests.hidden.start import plain_values
from tests.recover import STEP, drive_like, experiment, resonance
from tests.simulator.experiments import multisine
from tests.simulator.machine import machine_by_seed
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

FREE = ("motor.inertia", "load.inertia", "motor.viscous", "load.viscous", "load.idle_torque", "shaft.stiffness",
        "shaft.damping")
HIGH_INERTIA, LOW_INERTIA = (20, 23, 25), (26, 27)  # machines by seed, by the inertia behind the shaft


def recorded(seed, scale):
    """Machine, record with the shaft torque times a scale, drive like the machine."""
    machine, size = machine_by_seed(seed), 4000
    if seed in LOW_INERTIA:
        machine = replace(machine, inertia=(machine.inertia[0], 0.05 * machine.inertia[0]))
        machine = replace(machine, stiffness=(machine.inertia[1] * (2.0 * np.pi * 25.0) ** 2,))
        machine = replace(machine, damping=(0.02 * machine.stiffness[0] / (2.0 * np.pi * 25.0),))
    rated = machine.rated_torque
    torque = multisine(np.linspace(0.05, 1.5, 12) * resonance(machine), 0.1 * rated, size * STEP, STEP, seed)[:size]
    run = simulate_linear(machine, torque, STEP, None, white_noise(size, 0.01 * rated, 3 * seed))
    motor = run.speeds[:, 0] + white_noise(size, 3e-3 * np.abs(run.speeds).max(), 3 * seed + 1)
    shaft = run.shaft_torques[:, 0]
    shaft = scale * (shaft + white_noise(size, 0.01 * np.abs(shaft).max(), 3 * seed + 2))
    return experiment(torque, motor, shaft_torque=shaft), drive_like(machine, list(FREE))


@pytest.mark.parametrize("scale", [1.0, -1.0, 1.3])
@pytest.mark.parametrize("seed", HIGH_INERTIA + LOW_INERTIA)
def test_the_error_of_the_scale_is_one(seed, scale):
    record, drive = recorded(seed, scale)
    alone = experiment(record.signals["motor_torque"], record.signals["motor_speed"])
    model = fit_from_start(Task(drive, FREE, roles_of([alone], drive), (alone,)))
    factor, std = scale_of(model, record.signals["shaft_torque"], STEP)
    assert abs(factor - scale) < 3.0 * std
    assert std < (0.2 if seed in LOW_INERTIA else 0.03) * abs(scale)


@pytest.mark.slow
@pytest.mark.parametrize("seed", HIGH_INERTIA + LOW_INERTIA)
def test_a_right_sensor_is_no_fault(seed):
    record, drive = recorded(seed, 1.0)
    mended, _, faults = shaft_fault([record], drive, FREE, ("wrong-scale", "wrong-sign"))
    assert not faults and mended == (record,)


@pytest.mark.slow
@pytest.mark.parametrize("seed", HIGH_INERTIA)
@pytest.mark.parametrize(("scale", "code"), [(1.3, "wrong-scale"), (-1.0, "wrong-sign")])
def test_a_wrong_sensor_is(seed, scale, code):
    record, drive = recorded(seed, scale)
    mended, _, (fault,) = shaft_fault([record], drive, FREE, ("wrong-scale", "wrong-sign"))
    assert fault.code == code
    right = record.signals["shaft_torque"] / scale
    np.testing.assert_allclose(mended[0].signals["shaft_torque"], right, rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 1.05, 0.9])
@pytest.mark.parametrize("seed", HIGH_INERTIA + LOW_INERTIA)
def test_the_scale_fitted_together_with_the_drive_is_within_its_error(seed, scale):
    """And gains what two fits from the start gain."""
    record, drive = recorded(seed, scale)
    task = Task(drive, FREE, roles_of([record], drive), (record,))
    model = fit_from_start(task)
    log, std, lead, _ = most_likely_scale(model, all_samples(model.problem))
    assert abs(log - np.log(scale)) < 3.0 * std
    assert std < 0.02
    np.testing.assert_allclose(lead, log_likelihood_gain_of_factor(float(np.exp(log)), [task]), rtol=0.02, atol=1.0)


@pytest.mark.parametrize("factor", [0.7, 1.5, -1.0])
def test_a_factor_gains_nothing_where_the_sensor_says_nothing(factor):
    """Noise that has nothing to do with the drive is as likely in any unit: the closed form of the lead is zero."""
    record, drive = recorded(20, 1.0)
    noise = white_noise(4000, 1e3 * np.abs(record.signals["shaft_torque"]).max(), 7)
    record = replace(record, signals={**record.signals, "shaft_torque": noise})
    task = Task(drive, FREE, roles_of([record], drive), (record,))
    assert abs(log_likelihood_gain_of_factor(factor, [task])) < 2.0


@pytest.mark.slow
@pytest.mark.parametrize("with_start", [False, True])
def test_a_diverged_base_of_three_bodies_is_left_with_or_without_its_start_values(with_start):
    """Load inertias hundreds of times too low, a hundred times the compliance: due to a sensor of wrong sign."""
    case = make_case("wrong-sign-shaft", 67022, seed=67022, bodies=3, duration=3.0,
                     sensors=("motor_angle", "shaft_torque", "load_angle"))
    plain = plain_values(case.rig)
    start_values = {n: v * (1.1 if i % 2 else 0.9) for i, (n, v) in enumerate(plain.items())}
    astray = {"gear.inertia": 4e-5, "arm.inertia": 7e-5, "shaft.stiffness": 1.7, "shaft2.stiffness": 0.29,
              "shaft.damping": 1e-3, "shaft2.damping": 2e-4}
    with tempfile.TemporaryDirectory() as room:
        logs, _ = case.write_records(Path(room))
        records = [open_experiment(log) for log in logs]
    drive = three_mass().with_values(start_values | astray)
    _, _, faults = shaft_fault(records, drive, tuple(start_values), ("wrong-sign", "wrong-scale"),
                               start_values if with_start else {})
    assert [f.code for f in faults] == ["wrong-sign"]


@pytest.mark.slow
def test_where_the_motor_identifies_no_scale_all_channels_identify_the_sign():
    """Friction of the load that the base lacks is taken for noise: any shaft then fits the motor as well."""
    case = make_case(("coulomb-load", "wrong-sign-shaft"), 400004, seed=400004, record="moves",
                     sensors=("motor_speed", "load_speed"), duration=8.0, size={"coulomb-load": 0.0262})
    plain = plain_values(case.rig)
    astray = {"load.inertia": 3e-5, "shaft.stiffness": 0.44, "shaft.damping": 0.013}
    with tempfile.TemporaryDirectory() as room:
        logs, _ = case.write_records(Path(room))
        records = [open_experiment(log) for log in logs]
    drive = two_mass().with_values(plain | astray)
    mended, _, faults = shaft_fault(records, drive, tuple(plain), ("wrong-sign", "wrong-scale"), plain)
    assert [f.code for f in faults] == ["wrong-sign"]
    np.testing.assert_array_equal(mended[0].signals["shaft_torque"], -records[0].signals["shaft_torque"])
    _, _, faults = shaft_fault(mended, drive, tuple(plain), ("wrong-sign", "wrong-scale"), plain)
    assert faults == []
