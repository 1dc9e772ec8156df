"""Correlation of residual and input, against sums written out and against chance."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from drivetool.check.validation.correlation import block_averages, block_length, correlate, lag_count, whiteness

STEP = 0.01


def slow(rng, n, memory):
    """(n,) first-order noise of unit variance."""
    start = rng.normal()
    return lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], rng.normal(0.0, 1.0, n), zi=[memory * start])[0]


def test_sums_written_out():
    rng = np.random.default_rng(1)
    e, u = rng.normal(0.3, 1.0, 1200), slow(rng, 1200, 0.9)
    e[5:] += 0.2 * u[:-5]
    found = correlate([e], [u[:, None]], STEP, [], 1)
    m = lag_count(1200, STEP, [])
    assert found.lags == pytest.approx(STEP * np.arange(-m, m + 1)) and found.band.shape == (1, m)
    a, b = e - e.mean(), u - u.mean()
    for lag in (-30, -1, 0, 1, 5, 40):
        total = 0.0
        for i in range(1200):
            j = i - lag
            if 0 <= j < 1200:
                total += a[i] * b[j]
            elif lag > 0:
                total += a[i] * b[0]  # the torque is taken as held before the record
        assert found.r[0, m + lag] == pytest.approx(total / np.sqrt(np.sum(a**2) * np.sum(b**2)), abs=1e-12)
    assert found.largest == pytest.approx(np.abs(found.r[0, m + 1:]).max())
    assert found.outside == pytest.approx(np.mean(np.abs(found.r[0, m + 1:]) > found.band[0]))
    assert found.p < 1e-6


@pytest.mark.slow
def test_white_residual_has_the_band_of_the_reference():
    rng = np.random.default_rng(2)
    bands = [correlate([rng.normal(size=1400)], [rng.normal(size=(1400, 1))], STEP, [], 1).band.mean()
             for _ in range(20)]
    assert np.mean(bands) == pytest.approx(2.17 / np.sqrt(1400), rel=0.02)


@pytest.mark.slow
def test_band_is_bartletts_for_slow_series():
    rng = np.random.default_rng(3)
    runs = [correlate([slow(rng, 1400, 0.7)], [slow(rng, 1400, 0.95)[:, None]], STEP, [], 1)
            for _ in range(150)]
    m = runs[0].band.shape[1]
    spread = np.sqrt(np.mean([run.r[0, m + 1:] ** 2 for run in runs]))
    # sum over k of 0.7^|k| 0.95^|k| for first-order series
    bartlett = np.sqrt((1 + 0.7 * 0.95) / (1 - 0.7 * 0.95) / 1400)
    assert spread == pytest.approx(bartlett, rel=0.15)
    assert np.mean([run.band.mean() for run in runs]) / 2.17 == pytest.approx(spread, rel=0.15)


# memory of residual and input, feedback gain of the residual on the next torque
NULL = {"white": (0.0, 0.0, 0.0), "slow torque": (0.0, 0.99, 0.0), "coloured residual": (0.6, 0.98, 0.0),
        "closed loop": (0.0, 0.95, 2.0)}


@pytest.mark.slow
@pytest.mark.parametrize("own, memory, feedback", NULL.values(), ids=NULL)
def test_alarms_by_chance(own, memory, feedback):
    rng = np.random.default_rng(4)
    p = []
    for _ in range(200):
        e = slow(rng, 800, own)
        u = slow(rng, 800, memory) + feedback * lfilter([1.0], [1.0, -0.9], e)
        p.append(correlate([e[:300], e[300:]], [u[:300, None], u[300:, None]], STEP, [8.0], 1).p)
    for level in (0.01, 0.05):
        assert np.sum(np.array(p) <= level) <= binom.isf(1e-3, len(p), level)
    assert np.mean(np.array(p) <= 0.3) > 0.05  # a test that never rejects is none


def test_feedback_alone_is_reported_but_not_tested():
    rng = np.random.default_rng(5)
    e = rng.normal(size=1000)
    found = correlate([e], [(rng.normal(size=1000) + e)[:, None]], STEP, [], 1)
    m = found.band.shape[1]
    assert found.r[0, m] > 0.6 and found.largest < 0.15 and found.p > 0.01


def test_two_inputs_still_ones_and_too_little():
    rng = np.random.default_rng(6)
    e, u = rng.normal(size=600), rng.normal(size=(600, 3))
    u[:, 1] = 4.0
    e[3:] += 0.5 * u[:-3, 2]
    found = correlate([e], [u], STEP, [], 1)
    m = found.band.shape[1]
    assert found.r.shape == (2, 2 * m + 1) and np.argmax(np.abs(found.r[1])) == m + 3 and found.p < 1e-9
    assert correlate([e], [np.ones((600, 1))], STEP, [], 1) is None
    assert correlate([e[:15]], [u[:15]], STEP, [], 1) is None
    assert correlate([np.zeros(600)], [u], STEP, [], 1) is None


def test_blocks_keep_what_matters():
    assert block_length([np.zeros(100_000)], 1e-3, [5.0, 12.5]) == 10  # eight per period
    assert block_length([np.zeros(3000)], 1e-3, [12.5]) == 2  # but 1500 of them
    assert block_length([np.where(np.arange(1000) % 4 == 0, 1.0, np.nan)], 1e-3, [50.0]) == 4
    assert lag_count(10_000, 0.01, [12.5]) == 40 and lag_count(60, 0.01, [12.5]) == 15
    e = np.arange(10.0)
    e[[2, 6, 7, 8]] = np.nan
    found, inputs = block_averages([e], [np.arange(20.0).reshape(10, 2)], 3)
    assert found[0] == pytest.approx([1 / np.sqrt(2), 12 / np.sqrt(3), np.nan], nan_ok=True)
    assert inputs[0] == pytest.approx(np.array([[2, 3], [8, 9], [14, 15]]))


def test_a_faster_logger_does_not_change_the_correlation():
    rng = np.random.default_rng(7)
    torque = slow(rng, 4000, 0.98).repeat(5)
    e = rng.normal(0.0, 5.0, 20_000) + torque
    fast = correlate([e], [torque[:, None]], 1e-3, [12.5], 1)
    each_fifth = e.reshape(-1, 5).mean(axis=1) * np.sqrt(5)
    coarse = correlate([each_fifth], [torque[::5, None]], 5e-3, [12.5], 1)
    assert fast.largest == pytest.approx(coarse.largest, rel=0.05) and fast.largest > 0.2


def test_whiteness():
    rng = np.random.default_rng(8)
    p = [whiteness([rng.normal(size=400), rng.normal(size=300)]) for _ in range(300)]
    assert np.sum(np.array(p) < 0.05) <= binom.isf(1e-3, 300, 0.05)
    assert np.mean(p) == pytest.approx(0.5, abs=0.1)
    assert whiteness([slow(rng, 1000, 0.3)]) < 1e-6
    assert whiteness([np.zeros(1000)]) is None and whiteness([rng.normal(size=50)]) is None
