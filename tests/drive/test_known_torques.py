"""Known torques: a further input that brakes a body, with a factor that is a parameter of exact sensitivities."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive.assemble import Layout
from drivetool.drive.chain import one_body, two_mass
from drivetool.drive.simulation.augment import plant_of
from drivetool.drive.simulation.simulate import CHUNK_SAMPLES, Trace

STEP, N = 1e-3, 1500
FACTOR = 0.7
T = np.arange(N) * STEP
TORQUE = 3.0 * np.sin(9.0 * T) + 0.5 * np.sign(np.sin(31.0 * T))
LAW = np.cos(23.0 * T) + 0.3 * (T > 0.6)
ONE = one_body().with_values({"motor.inertia": 0.02, "motor.viscous": 0.05, "motor.coulomb": 0.4,
                              "motor.idle_torque": 0.1})
TWO = two_mass().with_values({
    "motor.inertia": 0.02, "load.inertia": 0.05, "motor.viscous": 0.05, "load.viscous": 0.02, "load.coulomb": 0.1,
    "shaft.stiffness": 200.0, "shaft.damping": 0.1, "shaft.half_gap": 0.002})


def braked(drive, name, factor=FACTOR):
    return replace(drive, known_torques=(name,), values={**drive.values, name: factor})


def trace(*inputs, outputs=1):
    return Trace(np.column_stack(inputs), np.zeros((len(inputs[0]), outputs)), STEP)


def speeds(drive, inputs, *columns, outputs=("motor_speed",), free=()):
    plant = plant_of(drive, Layout(free, inputs, outputs, STEP, gradient=False))
    return plant.outputs(trace(*columns, outputs=len(outputs)), np.zeros(plant.nx))


def test_it_brakes_the_motor_as_less_torque_does():
    found = speeds(braked(ONE, "motor.law1"), ("motor_torque", "motor.law1"), TORQUE, LAW)
    expected = speeds(ONE, ("motor_torque",), TORQUE - FACTOR * LAW)
    assert np.ptp(expected) > 5.0
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_it_brakes_the_load_as_a_load_torque_does():
    both = ("motor_speed", "load_speed")
    found = speeds(braked(TWO, "load.law1"), ("motor_torque", "load.law1"), TORQUE, LAW, outputs=both)
    expected = speeds(TWO, ("motor_torque", "load_torque"), TORQUE, FACTOR * LAW, outputs=both)
    without = speeds(TWO, ("motor_torque", "load_torque"), TORQUE, 0.0 * LAW, outputs=both)
    assert np.abs(expected - without).max() > 0.1
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("drive, name", [(ONE, "motor.law1"), (TWO, "load.law1")])
def test_sensitivities_are_those_of_central_differences(drive, name):
    free, inputs = ("motor.inertia", name), ("motor_torque", name)
    drive = braked(replace(drive, values={**drive.values, "shaft.half_gap": 0.0} if drive.shafts else drive.values),
                   name)
    plant = plant_of(drive, Layout(free, inputs, ("motor_speed",), STEP))
    _, found = plant.jacobian(trace(TORQUE, LAW), np.zeros(plant.nx))
    assert found.shape[:2] == (len(TORQUE), 1)
    for column, parameter in enumerate(free):
        d = 1e-5 * drive.values[parameter]
        ends = [speeds(replace(drive, values={**drive.values, parameter: drive.values[parameter] + side}), inputs,
                       TORQUE, LAW) for side in (d, -d)]
        expected = (ends[0] - ends[1]) / (2.0 * d)
        np.testing.assert_allclose(found[:, :, column], expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("observed", [False, True])
def test_chunks_together_are_the_whole(observed):
    n = CHUNK_SAMPLES + 57
    t = np.arange(n) * STEP
    outputs = np.sin(7.0 * t)[:, None]
    outputs[100:200] = np.nan
    plant = plant_of(ONE, Layout(("motor.inertia", "motor.coulomb"), ("motor_torque",), ("motor_speed",), STEP))
    long, start = Trace(np.sin(5.0 * t)[:, None], outputs, STEP), np.array([0.3])
    gains = plant.filter(long, start, np.array([1e-4]), 1e-2, np.zeros(1)).gains if observed else None
    _, whole = plant.jacobian(long, start, gains)
    chunks = [(part, rows.copy()) for part, rows in plant.sensitivities(long, start, gains)]
    assert [part for part, _ in chunks] == [slice(0, CHUNK_SAMPLES), slice(CHUNK_SAMPLES, n)]
    np.testing.assert_array_equal(np.concatenate([rows for _, rows in chunks]), whole)
    flat = whole.reshape(n, -1)
    np.testing.assert_allclose(plant.normal_equations(long, start, gains), flat.T @ flat, rtol=1e-10)
