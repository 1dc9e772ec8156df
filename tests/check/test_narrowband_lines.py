"""Lines in the one-step errors: found at their frequency and of their size, and nothing where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.fit.model import fit_from_start
from drivetool.check.verdict.narrowband_lines import find_narrowband_lines, narrowband_findings
from drivetool.drive import one_body
from drivetool.identify.setup import Task, roles_of
from drivetool.logs import Experiment
from tests.recover import STEP, drive_like, experiment, linear_record, truth
from tests.simulator.effects import Effects
from tests.simulator.experiments import multisine
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import machine_by_seed, running
from tests.simulator.records import white_noise

FREE = ("motor.inertia", "load.inertia", "motor.viscous", "load.idle_torque", "shaft.stiffness", "shaft.damping")
MACHINE = machine_by_seed(2)
SENSOR = 0.002 * MACHINE.rated_torque * 0.25 / sum(MACHINE.inertia)


def base_of(record):
    """The base of a diagnosis of a record, started at the true values."""
    drive = drive_like(MACHINE, list(FREE))
    return fit_from_start(Task(drive, FREE, roles_of([record], drive), (record,)))


def with_line(record, frequency, rms):
    time = STEP * np.arange(len(record.signals["motor_speed"]))
    wave = np.sqrt(2.0) * rms * np.sin(2.0 * np.pi * frequency * time + 0.3)
    return replace(record, signals={**record.signals, "motor_speed": record.signals["motor_speed"] + wave})


@pytest.mark.parametrize(("frequency", "rms"), [(212.0, 0.5), (437.3, 0.8)])
def test_a_narrowband_line_is_found_at_its_frequency_with_its_size(frequency, rms):
    model = base_of(with_line(linear_record(MACHINE, 3, 10.0), frequency, rms * SENSOR))
    (line,) = find_narrowband_lines(model)
    assert line.frequency == pytest.approx(frequency, abs=1.5)
    assert line.rms == pytest.approx(rms * SENSOR, rel=0.25)  # the predictor leaves most of it
    (said,) = narrowband_findings(model, "rad/s")
    assert said.code == "narrow-band-disturbance" and f"{line.frequency:.4g} Hz" in said.text


def test_a_filter_with_a_large_gain_does_not_enlarge_a_line():
    """An angle under large torque noise: predictions follow the line, and innovations are twice as large."""
    rng, size, inertia, noise = np.random.default_rng(4), 12_000, 0.5, 1e-6
    torque = 0.8 * np.sign(np.sin(2.0 * np.pi * 0.7 * STEP * np.arange(size))) + rng.normal(0.0, 0.05, size)
    rate = (torque + rng.normal(0.0, 0.5, size)) / inertia
    speed = np.concatenate(([0.0], np.cumsum(rate[:-1] * STEP)))
    angle = np.concatenate(([0.0], np.cumsum(speed[:-1] * STEP + 0.5 * rate[:-1] * STEP**2)))
    wave = np.sqrt(2.0) * 0.7 * noise * np.sin(2.0 * np.pi * 445.0 * STEP * np.arange(size))
    signals = {"motor_torque": torque, "motor_angle": angle + rng.normal(0.0, noise, size) + wave}
    record = Experiment("angle", "0" * 64, STEP, 0.0, signals, ((0, size),), torque_is="command")
    drive = one_body().with_values({"motor.inertia": inertia, "motor.viscous": 1e-4})
    model = fit_from_start(Task(drive, ("motor.inertia", "motor.viscous"), roles_of([record], drive), (record,)))
    (line,) = find_narrowband_lines(model)
    assert line.frequency == pytest.approx(445.0, abs=1.5)
    assert line.rms == pytest.approx(0.7 * noise, rel=0.1)


def test_noise_has_no_narrowband_line():
    assert find_narrowband_lines(base_of(linear_record(MACHINE, 3, 10.0))) == []


def test_a_ripple_is_no_narrowband_line_where_the_speed_changes():
    start = running(MACHINE, 20.0)
    size = 10_000
    torque = start.torque * (1.0 + 0.3 * (np.arange(size) // 2500 % 2)) + white_noise(size, 0.5, 7)
    machine = replace(MACHINE, effects=Effects(ripple=(0.05 * MACHINE.rated_torque, 6.0, 0.2)))
    run = simulate_fast(machine, torque, STEP, start)
    model = base_of(experiment(torque, run.speeds[:, 0] + white_noise(size, SENSOR, 8)))
    assert truth(MACHINE)["motor.inertia"] > 0.0 and find_narrowband_lines(model) == []


def test_one_speed_does_not_separate_a_line_from_a_ripple():
    start = running(MACHINE, 20.0)
    size = 8000
    torque = start.torque + white_noise(size, 0.5, 7)
    run = simulate_fast(MACHINE, torque, STEP, start)
    record = experiment(torque, run.speeds[:, 0] + white_noise(size, SENSOR, 8))
    assert find_narrowband_lines(base_of(with_line(record, 212.0, SENSOR))) == []


def test_what_the_torque_excites_is_a_model_error_and_no_line():
    """A multisine about the resonance and two angles: what the missing drag leaves there stands out as a line."""
    start, size = running(MACHINE, 20.0), 10_000
    period = multisine(np.arange(11.0, 150.0), 0.05 * MACHINE.rated_torque, 1.0, STEP, 3)
    torque = start.torque + np.tile(period, size // len(period))
    machine = replace(MACHINE, effects=Effects(quadratic=(0.0, 0.3 * MACHINE.rated_torque / 20.0**2)))
    run = simulate_fast(machine, torque, STEP, start)
    angles = {f"{body}_angle": run.angles[:, i] + white_noise(size, 1e-5, 8 + i)
              for i, body in enumerate(("motor", "load"))}
    record = Experiment("angles", "0" * 64, STEP, 0.0, {"motor_torque": torque, **angles}, ((0, size),),
                        torque_is="command")
    assert find_narrowband_lines(base_of(record)) == []
