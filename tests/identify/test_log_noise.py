"""The part of a logged torque that counts as recording noise."""

from dataclasses import replace

import numpy as np

from drivetool.identify.noise.log_noise import expected_recording_noise
from tests.recover import experiment

N, STEP = 6000, 1e-3
T = np.arange(N) * STEP
SMOOTH = 3.0 * np.sin(2.0 * np.pi * 0.7 * T) + np.sin(2.0 * np.pi * 2.3 * T + 1.0)


def found(torque, segments=None):
    made = experiment(torque, 0.0 * torque, step=STEP)
    made = made if segments is None else replace(made, segments=segments)
    return expected_recording_noise([made], "motor_torque")[0]


def noise(seed, std=0.3):
    return std * np.random.default_rng(seed).standard_normal(N)


def test_white_noise_on_a_smooth_command_is_found():
    for seed in range(3):
        true = noise(seed)
        likely = found(SMOOTH + true)
        assert np.corrcoef(true, likely)[0, 1] > 0.95
        assert 0.7 < likely.std() / true.std() < 1.0


def test_nothing_is_found_of_a_smooth_command():
    assert found(SMOOTH).std() < 1e-3 * SMOOTH.std()


def test_steps_pass_as_what_they_are():
    steps = np.random.default_rng(1).choice([-1.0, 1.0], N // 300).repeat(300)
    assert found(steps).std() < 0.1 * steps.std()
    true = noise(2, 0.1)
    assert np.corrcoef(true, found(steps + true))[0, 1] > 0.7


def test_a_stronger_signal_is_less_noise():
    quiet, loud = (found(SMOOTH + noise(3, std)) for std in (0.01, 0.3))
    assert np.std(quiet) < 0.05 * np.std(loud)


def test_each_stretch_is_filtered_by_itself():
    true = noise(4)
    torque = SMOOTH + true
    torque[2900:3100] = np.nan
    likely = found(torque, ((0, 2900), (3100, N)))
    assert not likely[2900:3100].any()
    for part in (slice(0, 2900), slice(3100, N)):
        assert np.corrcoef(true[part], likely[part])[0, 1] > 0.9


def test_a_record_too_short_for_a_spectrum_has_none():
    assert not found(SMOOTH[:200] + noise(5)[:200]).any()
