"""The steady filter of the scans answers to a torque step as the Kalman filter of the fits does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from drivetool.check.fit.model import fit_from_start
from drivetool.check.starts import scan
from drivetool.check.starts.load_step_scan import _step_shape, load_steps
from drivetool.check.starts.scan import (
    MAX_RIPPLE_FREQUENCY,
    RESPONSE_FREQUENCIES,
    _order_spectrum,
    disturbance_response,
    equivalent_motor_torque,
    likely_orders,
    response_energy,
    steady_filter,
)
from drivetool.identify.noise import filtered
from drivetool.identify.setup import Task, roles_of
from tests.recover import STEP, drive_like, experiment, one_sensor, resonance
from tests.simulator.effects import Effects
from tests.simulator.experiments import multisine
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import machine_by_seed
from tests.simulator.records import white_noise

AT = 2500
FREE = ("motor.inertia", "load.inertia", "motor.viscous", "load.idle_torque", "shaft.stiffness", "shaft.damping")


def base_with(second):
    """A base with a second sensor, or None, and the torque on its load as an input.

    What the sensor reads does not matter for what a torque leaves.
    """
    base, _ = one_sensor(4)
    record = base.task.experiments[0]
    nothing = np.zeros(len(record.signals["motor_speed"]))
    size = record.signals["motor_torque" if second == "shaft_torque" else "motor_speed"].std()
    record = replace(record, signals={
        **record.signals, "load_torque": nothing} | ({} if second is None else {second: nothing}))
    task = replace(base.task, experiments=(record,), roles=roles_of([record], base.task.drive))
    scale = base.noise.scale if second is None else np.array([1.0, size])
    return replace(base, task=task, problem=task.problem(), noise=replace(base.noise, scale=scale))


def innovations_left(base, torque):
    """(n, outputs) what torques (n, 2) on motor and load leave in the whitened innovations."""
    trace = base.problem.traces[0]
    acting = replace(base.problem, traces=(replace(trace, inputs=trace.inputs + torque),))
    without, other = (filtered(p, base.point, base.noise)[0] for p in (base.problem, acting))
    return (without.innovations - other.innovations) / np.sqrt(without.variance)


@pytest.mark.parametrize("second", [None, "shaft_torque", "load_speed"])
@pytest.mark.parametrize("memory, slow", [(None, None), (0.98, None), (0.999, None), (0.95, 0.2)])
def test_a_step_leaves_in_the_innovations_what_the_scan_looks_for(memory, slow, second):
    base = base_with(second)
    base = replace(base, noise=replace(base.noise, memory=memory, slow=slow))
    torque = np.zeros((base.problem.traces[0].size, 2))
    torque[AT:, 1] = 1.0
    left = innovations_left(base, torque)[AT:]
    shape = _step_shape(base, len(left))
    np.testing.assert_allclose(shape, left, rtol=0.0, atol=2e-3 * np.abs(left).max())


@pytest.mark.parametrize("second", [None, "shaft_torque", "load_speed"])
def test_a_torque_of_the_motor_leaves_what_the_scan_for_ripples_looks_for(second):
    base, hertz = base_with(second), 20.0
    t = base.problem.traces[0].step * np.arange(base.problem.traces[0].size)
    wave = 2.0 * np.pi * hertz * t
    left = innovations_left(base, np.column_stack([np.cos(wave), 0.0 * t]))[AT:]
    response = disturbance_response(base, np.array([hertz]))[0]
    expected = np.real(response * np.exp(1j * wave[AT:])[:, None])
    np.testing.assert_allclose(left, expected, rtol=0.0, atol=5e-3 * np.abs(expected).max())


def test_an_angle_that_is_not_measured_is_left_out():
    # A weight on the load needs the angle as a state, which no steady filter of a speed can have.
    base, _ = one_sensor(4)
    task = base.task.at({"load.imbalance_sine": 1e-9})
    turning = replace(base, task=task, problem=task.problem())
    found = steady_filter(turning)
    assert len(found) == 3 and all(part.size for part in found)
    for mine, plain in zip(found, steady_filter(base), strict=True):
        np.testing.assert_allclose(mine, plain, rtol=1e-6, atol=1e-12)


def test_a_load_step_is_looked_for_beside_an_imbalance():
    base, _ = one_sensor(4)
    task = base.task.at({"load.imbalance_sine": 1e-9})
    problem = task.problem()
    trace = problem.traces[0]
    inputs = trace.inputs.copy()
    inputs[AT:, 0] += np.ptp(inputs[:, 0])
    turning = replace(base, task=task, problem=replace(problem, traces=(replace(trace, inputs=inputs),)),
                      point=replace(base.point, starts=tuple(np.append(s, 0.0) for s in base.point.starts)))
    instant = load_steps(turning)[0][0][0]
    assert instant == pytest.approx(trace.origin + AT * trace.step, abs=0.02)


@pytest.mark.slow
def test_a_ripple_at_a_third_of_the_sampling_rate_is_looked_for():
    machine, size = machine_by_seed(20), 6000
    torque = 0.3 * machine.rated_torque * np.sin(2.0 * np.pi * 0.5 * STEP * np.arange(size))
    torque += multisine(np.linspace(0.1, 1.5, 12) * resonance(machine), 0.05 * machine.rated_torque, size * STEP,
                        STEP, 20)[:size]
    plain = simulate_fast(machine, torque, STEP)
    order = 2.0 * np.pi * 0.34 / STEP / np.quantile(np.abs(plain.speeds[:, 0]), 0.9)
    rippled = replace(machine, effects=Effects(ripple=(0.02 * machine.rated_torque, float(order), 0.4)))
    speed = simulate_fast(rippled, torque, STEP, None, None,
                          white_noise(size, 1e-3 * machine.rated_torque, 1)).speeds[:, 0]
    record = experiment(torque, speed + white_noise(size, 1e-4 * np.abs(speed).max(), 2))
    drive = drive_like(machine, list(FREE))
    base = fit_from_start(Task(drive, FREE, roles_of([record], drive), (record,)))
    way = np.ptp(np.cumsum(speed) * STEP)
    assert abs(likely_orders(base)[0] - order) < 2.0 * np.pi / way


@pytest.mark.parametrize("turning", [1.0, -1.0])
def test_the_score_of_an_order_is_what_its_shape_explains(turning):
    """What a torque of an order leaves, projected sample by sample; backwards the response is conjugate."""
    rng, size, step = np.random.default_rng(1), 3000, 1e-3
    lines = np.linspace(0.0, MAX_RIPPLE_FREQUENCY / step, RESPONSE_FREQUENCIES + 1)[1:]
    # A low-pass of 8 ms, in closed form: its memory is short against the record.
    keep = np.exp(-1.0 / 8.0)
    response = ((1.0 - keep) / (1.0 - keep * np.exp(-2j * np.pi * lines * step)))[:, None]
    e = lfilter([1.0], [1.0, -0.9], rng.normal(size=size))  # hardly anything of it is faster than a ripple
    angle = turning * (np.cumsum(20.0 + 10.0 * np.sin(0.004 * np.arange(size))) * step + 0.3)
    reach = np.ptp(angle)
    scores = _order_spectrum(equivalent_motor_torque(e[:, None], response, lines, step), angle, reach)
    place = angle - angle.min()
    for k in (8, 13, 40):
        order = k * np.pi / reach
        left = lfilter([1.0 - keep], [1.0, -keep], np.exp(1j * order * place))
        assert scores[k] == pytest.approx(e @ left, abs=0.3), k  # of about a hundred


def test_what_an_order_leaves_is_the_response_at_its_frequency_and_nothing_beyond_the_last_line():
    """A motor at 100 Hz backwards and at 200 Hz: the faster one is past all lines from an order of ten on."""
    lines = np.arange(1.0, RESPONSE_FREQUENCIES + 1.0)
    response = np.array([0.6, 0.8j]) / (1.0 + 1j * lines / 300.0)[:, None]
    speed = 2.0 * np.pi * np.repeat([-100.0, 200.0], (300, 500))
    grid = np.array([0.5, 1.5, 9.5, 12.0, 25.0])
    hertz = np.outer(grid, [100.0, 200.0])
    expected = np.where(hertz < RESPONSE_FREQUENCIES, 1.0 / (1.0 + (hertz / 300.0) ** 2), 0.0) @ [300.0, 500.0]
    np.testing.assert_allclose(response_energy(grid, speed, response, lines), expected, rtol=0.01)


def test_a_motor_that_shakes_faster_than_a_ripple_is_followed_has_none(monkeypatch):
    base, _ = one_sensor(4)
    step, speed = base.problem.traces[0].step, np.resize([1.0, -1.0], base.problem.traces[0].size)
    angle = np.concatenate(([0.0], np.cumsum(speed[:-1] * step)))
    monkeypatch.setattr(scan, "innovations", lambda base: ([np.zeros((len(speed), 1))], [angle], [speed]))
    assert 4.0 * np.pi / np.ptp(angle) > MAX_RIPPLE_FREQUENCY * 2.0 * np.pi / step
    assert likely_orders(base) == []
