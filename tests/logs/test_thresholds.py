"""Bounds that decide whether data is dropped, repaired or suspected: half of each, and twice, decide otherwise."""

import numpy as np
import pytest

from drivetool.errors import BadRecording, NotEnoughData
from drivetool.logs.clocks import batched_times as batches, clean_stamps as clean_clock, coarse_clock
from drivetool.logs.clocks.batched_times import find_batches as batches_of
from drivetool.logs.clocks.clean_stamps import clean_clock as cleaned
from drivetool.logs.clocks.coarse_clock import restore_uniform_times
from drivetool.logs.door.build import MIN_SEGMENT, build_experiment
from drivetool.logs.experiment import Channel, Recording
from drivetool.logs.grid import MIN_SAMPLES
from drivetool.logs.samples import speed_check, unmeasured_samples as unmeasured

N, STEP = 4000, 1e-3
BELOW_BOUND, ABOVE_BOUND = 0.71, 1.41  # shares of a bound


def built(time, torque, **sensors):
    channels = {"motor_torque": Channel(time, torque, "Nm")}
    units = {"motor_speed": "rad/s", "motor_angle": "rad"}
    return build_experiment(Recording("log", "0" * 64, channels | {
        role: Channel(time, values, units[role]) for role, values in sensors.items()}))


def codes(experiment):
    return {f.code for f in experiment.findings}


def noise(n=N, seed=1):
    return np.random.default_rng(seed).standard_normal(n)


def restores_coarse_clock(share):
    time = np.floor(np.arange(round(share * coarse_clock.MIN_LINE_SAMPLES)) * 2.5e-4 / 1e-3 + 1e-6) * 1e-3
    return restore_uniform_times(time) is not None


def sorts_displaced_sample(share):
    time = np.arange(N) * STEP
    places = round(share * clean_clock.MAX_DISPLACEMENT)
    late = np.concatenate([time[:1000], time[1001:1001 + places], time[1000:1001], time[1001 + places:]])
    try:
        cleaned(late, "motor_speed", "log")
    except BadRecording:
        return False
    return True


def finds_batches(share):
    k = np.arange(20 * round(share * batches.MIN_BATCHES))
    return batches_of(k // 20 * 0.04 + k % 20 * 2e-5) is not None


def finds_inner_steps(share):
    """Batches of four whose inner steps are a share of the mean one."""
    k = np.arange(N)
    return batches_of((k // 4 + share * batches.MAX_INNER_STEP * (k % 4) / 4) * 4 * STEP) is not None


def accepts_record(share):
    n = round(share * MIN_SAMPLES)
    try:
        built(np.arange(n) * STEP, noise(n), motor_speed=noise(n, 2))
    except NotEnoughData:
        return False
    return True


def keeps_segment(share):
    piece = round(share * MIN_SEGMENT)
    time = np.concatenate([np.arange(500), 600 + np.arange(piece), 700 + np.arange(500)]) * STEP
    return len(built(time, noise(len(time)), motor_speed=noise(len(time), 2)).segments) == 3


def reports_wrong_scale(share):
    time = np.arange(N) * STEP
    speed = np.sin(40 * time) + np.sin(9 * time)
    angle = -np.cos(40 * time) / 40 - np.cos(9 * time) / 9
    found = built(time, noise(), motor_speed=(1 + share * speed_check.SCALE_TOLERANCE) * speed, motor_angle=angle)
    return "speed-angle-mismatch" in codes(found)


def reports_saturation(share):
    speed = 0.1 * noise(seed=3) + np.sin(np.arange(N) / 60)
    speed[1000:1000 + round(share * unmeasured.MIN_SATURATED_SHARE * N)] = 5.0
    return "signal-saturated" in codes(built(np.arange(N) * STEP, noise(), motor_speed=speed))


@pytest.mark.parametrize(("acts", "above"), [
    (restores_coarse_clock, True), (sorts_displaced_sample, False), (finds_batches, True),
    (finds_inner_steps, False), (accepts_record, True), (keeps_segment, True), (reports_wrong_scale, True),
    (reports_saturation, True)])
def test_half_and_twice_decide_otherwise(acts, above):
    assert acts(ABOVE_BOUND) is above and acts(BELOW_BOUND) is not above
