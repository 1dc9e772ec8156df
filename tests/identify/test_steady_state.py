"""The steady-state statistic: about 1 on noise, large on a ramp, and the intervals it finds."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.signal import lfilter

from drivetool.identify.plateaus.state import L1, block_means, is_steady, ratio_statistic, steady_intervals


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 1e6), st.floats(-1e6, 1e6))
def test_about_one_on_white_noise_whatever_its_size_and_level(seed, size, level):
    x = level * size + size * np.random.default_rng(seed).normal(size=4000)
    ratio = ratio_statistic(x)
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)
    assert np.mean(ratio > 3) < 0.02


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(3.0, 1e6), st.sampled_from([-1, 1]))
def test_large_on_a_ramp(seed, slope, sign):
    x = sign * slope * np.arange(300) + np.random.default_rng(seed).normal(size=300)
    assert np.mean(ratio_statistic(x)[20:] > 3) > 0.99


def test_ramp_without_noise():
    assert ratio_statistic(np.arange(200.0))[-1] == pytest.approx((2 - L1) / L1**2, rel=1e-6)


def test_constants_and_rounding_are_steady():
    np.testing.assert_array_equal(ratio_statistic(np.full(50, 3.7)), np.ones(49))
    steady = is_steady(np.linspace(0, 1e-6, 50), floor=1e-4)
    assert steady.shape == (50,) and steady.all()


def test_a_step_between_two_values_is_seen_and_forgotten():
    x = np.concatenate([np.zeros(60), np.full(60, 1e4)]) + np.random.default_rng(1).normal(size=120)
    unsteady = np.flatnonzero(~is_steady(x))
    assert 60 in unsteady and np.all(np.abs(unsteady - 60) < 3)


def test_block_means_pass_over_missing_values():
    values = np.array([1.0, np.nan, 3.0, 5.0, np.nan, np.nan, 9.0])
    np.testing.assert_array_equal(block_means(values, 2), [1.0, 4.0, np.nan])


def staircase(colour, seed=3):
    """Three plateaus of 2000 samples, ramps of 500 between them; noise with a correlation of `colour`."""
    rng = np.random.default_rng(seed)
    level = np.concatenate([np.full(2000, 10.0), np.linspace(10, 20, 500), np.full(2000, 20.0),
                            np.linspace(20, 5, 500), np.full(2000, 5.0)])
    noise = lfilter([np.sqrt(1 - colour**2)], [1, -colour], rng.normal(size=(2, len(level))))
    torque = np.where((level == 10) | (level == 20) | (level == 5), 3.0, 30.0)
    return [level + 0.05 * noise[0], torque + 0.3 * noise[1]]


# 0.9: 19 samples count as one. From about 0.97 (66 as one) a plateau of 2000 no longer holds the 20 blocks.
@pytest.mark.parametrize("colour", [0.0, 0.5, 0.9])
def test_plateaus_are_found_whatever_the_colour_of_the_noise(colour):
    signals = staircase(colour)
    intervals, block = steady_intervals(signals, [(0, 7000)])
    plateaus = [(0, 2000), (2500, 4500), (5000, 7000)]
    for first, last in intervals:
        assert any(first >= a - block and last <= b + block for a, b in plateaus)
    for a, b in plateaus:
        assert sum(min(last, b) - max(first, a) for first, last in intervals if first < b and last > a) > 1000


def test_a_gap_ends_an_interval():
    intervals, _ = steady_intervals([s[:2000] for s in staircase(0.0)], [(0, 900), (1100, 2000)])
    assert intervals and all(last <= 900 or first >= 1100 for first, last in intervals)


def test_a_moving_signal_has_no_interval():
    t = np.arange(6000) * 1e-3
    rng = np.random.default_rng(2)
    speed = 10 * np.sin(2 * np.pi * 0.7 * t) + 0.01 * rng.normal(size=len(t))
    assert steady_intervals([speed, np.cos(2 * np.pi * 0.7 * t)], [(0, len(t))])[0] == []
