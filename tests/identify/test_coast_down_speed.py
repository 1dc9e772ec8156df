"""A coast-down by a speed: white or filtered noise is no misfit; a missing law, a brake or a cut speed is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from drivetool.drive import one_body
from drivetool.identify.coast_down import stretches
from drivetool.identify.setup.options import Options
from drivetool.identify.steady.estimator import steady
from tests.coasting import RPM, STEP, Motor, motion, recording

SLOW, PAPER = 20 * STEP, Motor()
RATIOS = {"viscous_over_inertia": PAPER.viscous / PAPER.inertia,
          "coulomb_over_inertia": PAPER.coulomb / PAPER.inertia}
COAST_DOWN = Options(method="coast-down")
SAID = {"nonlinear-friction", "scatter-beyond-noise", "speed-drops-to-zero"}


def noise(size, seed, kind):
    """Noise of 0.1 rad/s: white, by a lag of a two-hundredth of the record, by a moving average of a fiftieth."""
    white = np.random.default_rng(seed).standard_normal(2 * size)
    pole, length = np.exp(-200.0 / size), max(size // 50, 2)
    coloured = {"white": white, "lag": lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], white),
                "average": np.convolve(white, np.ones(length), "same") / np.sqrt(length)}[kind]
    return 0.1 * coloured[size // 2:size // 2 + size]


def noisy(seed, kind, motor=PAPER, torque=lambda t: 0.0, fast=2000 * RPM):
    """A coast-down by a speed sensor."""
    speed = motion(motor, torque, fast, 80 * RPM, 5.0, SLOW)[1]
    return recording(seed, f"coast-{seed}.parquet", SLOW, motor_speed=speed + noise(len(speed), seed, kind))


def said(estimate):
    """The findings on what differs from the model."""
    return {f.code: f for f in estimate.findings if f.code in SAID}


@pytest.mark.parametrize("kind", ["white", "lag", "average"])
def test_noise_is_no_misfit(kind):
    for seed in range(4):
        runs = [noisy(seed + 10 * k, kind, fast=(2000 - 300 * k) * RPM) for k in range(1 + seed % 3)]
        estimate = steady(runs, one_body(), COAST_DOWN)
        assert not said(estimate), (kind, seed)
        for line in estimate.ratios:
            assert abs(line.value - RATIOS[line.name]) < 4.0 * line.std


@pytest.mark.parametrize("kind", ["white", "lag", "average"])
def test_a_missing_drag_is_named(kind):
    found = said(steady([noisy(1, kind, replace(PAPER, drag=5e-7))], one_body(), COAST_DOWN))
    assert found["nonlinear-friction"].evidence["law"] == "drag"
    assert "motor.viscous" in found["nonlinear-friction"].text


def test_a_brake_and_a_wrong_held_value_are_said():
    brake = noisy(1, "lag", torque=lambda t: -PAPER.coulomb * (t > 0.3))
    assert "nonlinear-friction" in said(steady([brake], one_body(), COAST_DOWN))
    drive = one_body().with_values({"motor.inertia": PAPER.inertia, "motor.viscous": 1.3 * PAPER.viscous})
    held = replace(COAST_DOWN, hold=("motor.inertia", "motor.viscous"))
    found = said(steady([noisy(1, "white")], drive, held))
    assert "a held value is wrong (motor.inertia, motor.viscous)" in found["nonlinear-friction"].text


@pytest.mark.parametrize("least", [20.0, 60.0])
def test_a_speed_that_is_zero_below_a_least_speed_is_left_out_there(least):
    speed = noisy(1, "white").signals["motor_speed"]
    cut = np.concatenate([np.where(speed > least, speed, 0.0), np.zeros(100)])
    estimate = steady([recording(1, step=SLOW, motor_speed=cut)], one_body(), COAST_DOWN)
    assert set(said(estimate)) == {"speed-drops-to-zero"}
    for line in estimate.ratios:
        assert abs(line.value - RATIOS[line.name]) < 4.0 * line.std


@pytest.mark.parametrize(("factor", "dropped"), [(3.5, False), (7.0, True)])
def test_a_drop_is_much_faster_than_the_friction_before(factor, dropped):
    """Friction that rises before standstill is none; half and double of the least factor are wrong."""
    before = np.arange(400.0, 100.0, -1.0)
    speed = np.concatenate([before, np.arange(100.0, 0.0, -factor), np.zeros(50)])
    e = recording(1, motor_speed=speed, motor_torque=np.zeros(len(speed)))
    (stretch,) = stretches.stretches_of([e], 0.0)
    assert bool(stretch.dropped) is dropped


@pytest.mark.parametrize("change", [0.5, 2.0])
def test_half_and_double_of_that_factor_are_wrong(change, monkeypatch):
    monkeypatch.setattr(stretches, "MIN_DROP_FACTOR", change * stretches.MIN_DROP_FACTOR)
    with pytest.raises(AssertionError):
        for factor, dropped in ((3.5, False), (7.0, True)):
            test_a_drop_is_much_faster_than_the_friction_before(factor, dropped)
