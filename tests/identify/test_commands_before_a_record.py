"""The command before a stretch: unknown to a drive with a dead time, unless the stretch is cut from a record."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.drive.simulation import Trace
from drivetool.identify.setup.setup import after_transient
from tests.drive.test_kernel import STEP, drive_of, levels, plant_of
from tests.hidden.command import greybox_and_diagnose
from tests.recover import experiment
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine, at_rest
from tests.simulator.records import write_parquet

SPINDLE = Machine((0.021,), (0.004,), (0.35,), (0.0,), (), (), (), rated_torque=10.0)
DELAY = 1.8e-3


def test_a_stretch_goes_on_as_the_record_of_which_it_is_cut():
    plant = plant_of(drive_of(replace(SPINDLE, dead_time=2.6 * STEP)), ("motor_speed",))
    torque = levels(SPINDLE, 400, 3, hold=1)[:, None]
    whole, states, _ = plant.simulate(Trace(torque, np.zeros((400, 1)), STEP), np.zeros(1), keep=True)
    piece = Trace(torque[150:], np.zeros((250, 1)), STEP, lead=torque[:150])
    np.testing.assert_allclose(plant.outputs(piece, states[150]), whole[150:], atol=1e-9)
    alone = plant.outputs(replace(piece, lead=None), states[150])
    assert np.abs(alone - whole[150:]).max() > 0.01


@pytest.mark.parametrize(("delay", "free", "missing"), [
    (0.0, (), 0), (DELAY, (), 5), (0.0, ("converter.dead_time",), 2)])
def test_sensor_samples_before_the_first_torque_has_come_through_are_left_out(delay, free, missing):
    drive = one_body().with_values({"motor.inertia": 1.0, **({"converter.dead_time": delay} if delay else {})})
    led = after_transient(experiment(np.ones(2000), np.ones(2000)), drive, free)
    assert np.isnan(led.signals["motor_speed"]).sum() == missing
    assert np.all(np.isfinite(led.signals["motor_torque"]))


@pytest.mark.slow
def test_a_record_that_begins_under_another_torque_identifies_the_dead_time(tmp_path):
    """The torque before it was zero: held to be that of the first sample, the dead time came out eleven errors off.

    The base takes nearly all of the motion for noise of the torque, from where the noise must find back.
    """
    rng, n = np.random.default_rng(1009), 6000
    command = 4.0 * np.repeat(rng.uniform(-1.0, 1.0, n // 20), 20) + np.where(np.arange(n) < n // 2, 4.7, 0.0)
    machine = replace(SPINDLE, dead_time=DELAY)
    run = simulate_fast(machine, command, STEP, at_rest(machine), None, 0.1 * rng.standard_normal(n))
    path = tmp_path / "log.parquet"
    speed = run.speeds[:n, 0] + 0.08 * rng.standard_normal(n)
    write_parquet(path, {"motor_torque": (command, "Nm"), "motor_speed": (speed, "rad/s")}, STEP)
    start = tmp_path / "start.yaml"
    start.write_text("schema: drivetool/parameters/1\ndrive: {bodies: [motor], shafts: []}\nparameters:\n"
                     "  motor.inertia: {value: 0.0235, unit: kg m^2}\n"
                     "  motor.viscous: {value: 0.0047, unit: Nm s/rad}\n")
    found = greybox_and_diagnose(tmp_path, [path], start, (),
                                 ["--candidates", "dead-time,converter-lag,torque-ripple"])
    assert "dead-time" in (*found.causes, *found.between), found
    line = found.parameters["converter.dead_time"]
    assert abs(line["value"] - DELAY) < 3.5 * line["std"]
