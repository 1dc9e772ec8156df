"""Quantisation steps of a channel: found wherever there are any, a fault where they are coarse."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.check.faults.record_faults import encoder_step_findings, record_faults_of
from drivetool.check.fit.quantisation import resolution
from drivetool.logs import Experiment
from tests.recover import STEP

SIZE = 12_000
TIME = STEP * np.arange(SIZE)


@pytest.mark.parametrize("seed", range(4))
def test_steps_are_found_also_of_values_that_hardly_repeat(seed):
    rng = np.random.default_rng(seed)
    way = np.cumsum(1.0 + 0.5 * rng.standard_normal(SIZE))
    assert resolution(np.round(way / 0.25) * 0.25) == pytest.approx(0.25, rel=1e-9)
    assert resolution(np.round(way[:900] / 3.0) * 3.0) == pytest.approx(3.0, rel=1e-9)
    assert resolution(way) is None and resolution(rng.standard_normal(SIZE)) is None


@pytest.mark.parametrize("least", [3.0, 7.0, 40.0])
def test_steps_are_found_of_a_motion_in_which_no_two_values_are_neighbours(least):
    """An angle that only ever moves on, by so many steps in a sample at least and at most four times as many."""
    rng = np.random.default_rng(5)
    way = np.cumsum(rng.integers(int(least), int(4.0 * least), SIZE))
    assert resolution(0.00346 * way) == pytest.approx(0.00346, rel=1e-9)
    assert resolution(0.00346 * (way + 0.3 * rng.standard_normal(SIZE))) is None


@pytest.mark.parametrize(("steps", "reported"), [(12.0, True), (400.0, False)])
def test_encoder_steps_that_are_white_are_reported_as_noise(steps, reported):
    """So many steps of 1 mrad in a sample, beside a noise of a third of one; or of a third of 30 of them."""
    rng = np.random.default_rng(6)
    way, noise = np.arange(SIZE) + 100.0 * np.sin(TIME), rng.standard_normal(SIZE) / 36.0
    angle = 0.001 * np.round(steps * (way + noise))
    record = Experiment("encoder", "0" * 64, STEP, 0.0, {"motor_torque": np.cos(TIME), "motor_angle": angle},
                        ((0, SIZE),), torque_is="command")
    assert not record_faults_of([record], ("quantisation",))[1]
    notes = encoder_step_findings([record])
    assert [n.code for n in notes] == ["encoder-quantisation"] * reported
    if reported:
        share = (1.0 / 12.0) / (1.0 / 12.0 + (steps / 36.0) ** 2)
        assert notes[0].evidence["resolution"] == pytest.approx(0.001, rel=1e-9)
        assert notes[0].evidence["share_of_noise"] == pytest.approx(share, rel=0.1)


@pytest.mark.parametrize(("counts", "found"), [(2000.0, True), (200_000.0, False)])
def test_an_angle_is_coarse_where_fast_motion_makes_few_steps_in_a_sample(counts, found):
    """The noise of both encoders is nothing but their steps: 3 and 300 a sample at 10 rad/s."""
    speed = 10.0 * np.sin(2.0 * np.pi * 0.3 * TIME)
    step = 2.0 * np.pi / counts
    angle = np.round(STEP * np.cumsum(speed) / step) * step
    record = Experiment("encoder", "0" * 64, STEP, 0.0, {"motor_torque": np.cos(TIME), "motor_angle": angle},
                        ((0, SIZE),), torque_is="command")
    faults = record_faults_of([record], ("quantisation",))[1]
    assert [f.code for f in faults] == ["quantisation"] * found
    if found:
        assert faults[0].finding.evidence["resolution"] == pytest.approx(step, rel=1e-9)
        assert "rad;" in faults[0].finding.text


@pytest.mark.parametrize(("steps", "found"), [(0.5, False), (1.5, True), (3.0, True)])
def test_a_speed_is_coarse_from_steps_as_large_as_its_noise(steps, found):
    """The variance of rounding is a twelfth of the step's square, beside the noise's own."""
    rng = np.random.default_rng(4)
    speed = np.round((10.0 * np.sin(TIME) + rng.standard_normal(SIZE)) / steps) * steps
    record = Experiment("speed", "0" * 64, STEP, 0.0, {"motor_torque": np.cos(TIME), "motor_speed": speed},
                        ((0, SIZE),), torque_is="command")
    faults = record_faults_of([record], ("quantisation",))[1]
    assert [f.code for f in faults] == ["quantisation"] * found
    if found:
        share = steps**2 / 12.0 / (1.0 + steps**2 / 12.0)
        assert faults[0].finding.evidence["share_of_noise"] == pytest.approx(share, rel=0.1)
