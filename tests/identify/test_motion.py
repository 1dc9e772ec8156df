"""The smoothed motion against closed forms, for a sensor of speed and one of the angle."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.errors import NotEnoughData
from drivetool.identify.motion.motion import MAX_CUTOFF, motions_of, smoothing_of
from drivetool.logs.samples import low_pass
from tests.identify.swing import STEP, record, swing
from tests.recover import experiment

S = swing()
INSIDE = slice(50, -50)
ROLES = pytest.mark.parametrize("role", ["motor_speed", "motor_angle"])


def noise(std, seed=1, n=4000):
    return std * np.random.default_rng(seed).standard_normal(n)


@ROLES
def test_means_over_the_intervals_are_the_closed_forms(role):
    seen = motions_of([record(S, role)], role)
    assert seen.each[0].smoothing.cutoff == MAX_CUTOFF
    m = seen.each[0]
    for name, expected in (("speed", S.mean_speed), ("acceleration", S.acceleration), ("side", S.side)):
        tolerance = 0.02 if name == "side" else 2e-3 * np.abs(expected).max()
        np.testing.assert_allclose(getattr(m, name)[INSIDE], expected[INSIDE], atol=tolerance, err_msg=name)
    turned = m.angle - S.middle
    assert np.ptp(turned[INSIDE]) < 1e-3 * np.ptp(S.middle)
    if role == "motor_angle":
        assert abs(turned[INSIDE]).max() < 1e-3
    np.testing.assert_allclose(m.time, (np.arange(len(S.speed)) + 0.5) * STEP)
    assert seen.top == pytest.approx(np.quantile(np.abs(S.speed), 0.99), rel=3e-3)
    assert m.known.all()


@ROLES
def test_a_reversal_is_located_inside_its_interval(role):
    crossing = 0.7  # of the interval between samples 250 and 251
    parts = ((1.0, 0.5, 0.5 * np.pi - 2.0 * np.pi * 0.5 * STEP * (250 + crossing)),)
    s = swing(1000, parts=parts)
    side = motions_of([record(s, role)], role).each[0].side
    assert s.speed[250] > 0.0 > s.speed[251]
    assert side[249:252] == pytest.approx([1.0, 2.0 * crossing - 1.0, -1.0], abs=0.02)


def test_short_gaps_are_bridged_and_long_ones_are_not_known():
    r = record(S)
    speed = r.signals["motor_speed"].copy()
    speed[500:503] = speed[1000:1040] = np.nan
    m = motions_of([replace(r, signals={**r.signals, "motor_speed": speed})], "motor_speed").each[0]
    assert m.known[495:508].all()
    assert m.speed[500:503] == pytest.approx(S.mean_speed[500:503], rel=1e-2)
    assert not m.known[1000:1039].any()
    assert m.known[900:999].all() and m.known[1041:1100].all()


@ROLES
def test_the_cut_off_falls_as_the_sensor_gets_noisy(role):
    size = np.abs(S.speed if role == "motor_speed" else S.angle).max()
    found = [smoothing_of([record(S, role, noise=noise(size * std))], role).cutoff for std in (0.0, 1e-3, 1e-1)]
    assert MAX_CUTOFF == found[0] > found[1] > found[2]


@ROLES
def test_the_noise_left_in_the_speed_is_that_of_filtered_noise(role):
    std = 0.2 if role == "motor_speed" else 2e-3
    smoothing = smoothing_of([record(S, role, noise=noise(std))], role)
    assert smoothing.cutoff < MAX_CUTOFF
    left = low_pass(noise(std, 2, 400_000), [(0, 400_000)], smoothing.cutoff, 3)
    left = left if role == "motor_speed" else np.diff(left) / STEP
    assert smoothing.speed_noise == pytest.approx(left.std(), rel=0.1)


@ROLES
def test_slow_is_where_noise_hides_the_sign(role):
    std = 0.5 if role == "motor_speed" else 2e-3
    seen = motions_of([record(S, role, noise=noise(std))], role)
    slow, least = seen.each[0].slow, 3.0 * seen.each[0].smoothing.speed_noise
    assert 0.0 < slow.mean() < 0.5
    assert np.abs(S.mean_speed[slow]).max() < 3.0 * least
    assert np.abs(S.mean_speed[~slow]).min() > 0.2 * least
    assert not np.any(slow[np.abs(S.mean_speed) > 3.0 * least])


@ROLES
@pytest.mark.parametrize("factor", [1e6, 1e-5])
def test_other_units_change_nothing_but_the_size(role, factor):
    r = record(S, role, noise=noise(1e-2))
    scaled = replace(r, signals={**r.signals, role: factor * r.signals[role]})
    a, b = motions_of([r], role), motions_of([scaled], role)
    assert b.each[0].smoothing.cutoff == a.each[0].smoothing.cutoff
    assert b.each[0].smoothing.speed_noise == pytest.approx(factor * a.each[0].smoothing.speed_noise, rel=1e-9)
    for name in ("speed", "acceleration", "angle"):
        expected = factor * a.all(name)
        np.testing.assert_allclose(b.all(name), expected, atol=1e-8 * np.abs(expected).max())
    np.testing.assert_allclose(b.all("side"), a.all("side"), atol=1e-8)
    np.testing.assert_array_equal(b.all("slow"), a.all("slow"))


def test_a_record_in_shreds_is_refused():
    speed = S.speed[:200].copy()
    speed[::40] = np.nan
    with pytest.raises(NotEnoughData, match="50 values of the sensor"):
        motions_of([experiment(np.ones(200), speed, step=STEP)], "motor_speed")
