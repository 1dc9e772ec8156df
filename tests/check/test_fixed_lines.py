"""A narrow-band line of fixed frequency is no order, and a ripple at a steady speed stays one."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.check.starts import scan
from drivetool.check.starts.scan import FIXED_LINE_SCORE_RATIO, FixedLines

STEP, SIZE = 1e-3, 8000
LINES = np.linspace(0.0, 450.0, 2001)[1:]
FLAT = np.ones((len(LINES), 1))  # a drive that a torque moves alike at every frequency: innovations are the torque
TIME = STEP * np.arange(SIZE)


def plateaus(share, slow=10.0, fast=25.0):
    """(SIZE,) speed that is slow for a share of the time, then fast, with a ramp of a tenth between them."""
    return np.interp(TIME / TIME[-1], [0.0, share, min(share + 0.1, 1.0), 1.1], [slow, slow, fast, fast])


def explained(speed, wave, order, noise=1.0, seed=3, cut=SIZE):
    """Whether a fixed frequency is behind an order, in a record of one stretch or of two."""
    angle = np.cumsum(speed) * STEP
    torque = wave(angle) + np.random.default_rng(seed).normal(0.0, noise, SIZE)
    parts = [slice(0, cut), slice(cut, SIZE)] if cut < SIZE else [slice(0, SIZE)]
    torques, angles, speeds = ([x[p] for p in parts] for x in (torque, angle, speed))
    score = abs(np.sum(torque * np.exp(-1j * order * angle))) ** 2 / SIZE
    return FixedLines(torques, LINES, FLAT, STEP).explains(order, score, torques, angles, speeds)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.65])
@pytest.mark.parametrize("seed", range(5))
def test_a_fixed_line_at_the_speed_of_a_plateau_is_no_order(share, seed):
    order = 2.0 * np.pi * 50.0 / 10.0  # the line's frequency at the slow speed
    assert explained(plateaus(share), lambda _: np.sin(2.0 * np.pi * 50.0 * TIME), order, seed=seed)


@pytest.mark.parametrize("cut", [SIZE, 3000])
@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_ripple_is_an_order_at_a_steady_speed_too(share, seed, cut):
    speed = plateaus(share) * (1.0 + 0.001 * np.sin(2.0 * TIME))
    assert not explained(speed, lambda angle: 0.3 * np.sin(7.0 * angle + 0.4), 7.0, seed=seed, cut=cut)


def test_a_ripple_stays_with_a_stronger_fixed_line_at_other_speeds():
    def wave(angle):
        return 0.3 * np.sin(7.0 * angle) + 2.0 * np.sin(2.0 * np.pi * 150.0 * TIME)

    assert not explained(plateaus(0.5), wave, 7.0)  # 11 and 28 Hz


def test_many_short_stretches_of_noise_make_no_frequency_better():
    """Every stretch has a phase of its own for a frequency, and one for all only for an order."""
    speed = plateaus(0.5)
    angle = np.cumsum(speed) * STEP
    found = 0
    for seed in range(20):
        torque = 0.12 * np.sin(7.0 * angle) + np.random.default_rng(seed).normal(size=SIZE)
        torques, angles, speeds = (np.split(x, 40) for x in (torque, angle, speed))
        score = abs(np.sum(torque * np.exp(-7j * angle))) ** 2 / SIZE
        found += FixedLines(torques, LINES, FLAT, STEP).explains(7.0, score, torques, angles, speeds)
    assert found == 0


@pytest.mark.parametrize(("factor", "share"), [(0.5, 1.0), (2.0, 0.65)])
def test_half_and_double_of_the_factor_are_wrong(monkeypatch, factor, share):
    monkeypatch.setattr(scan, "FIXED_LINE_SCORE_RATIO", factor * FIXED_LINE_SCORE_RATIO)
    ripple = factor < 1.0
    wave = (lambda angle: np.sin(7.0 * angle)) if ripple else (lambda _: np.sin(2.0 * np.pi * 50.0 * TIME))
    order = 7.0 if ripple else 2.0 * np.pi * 50.0 / 10.0
    assert explained(plateaus(share), wave, order) == ripple
