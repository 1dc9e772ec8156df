"""Logged speed against differentiated angle: what is said, and that nothing is said without cause."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt

from drivetool.logs.channels.channel_map import SCHEMA, ChannelMap
from drivetool.logs.door.build import open_experiment
from drivetool.logs.samples.speed_check import compare_speed_and_angle, differentiate

N, STEP = 20_000, 1e-3


def motion(kind):
    """(angle, speed) without noise."""
    rng = np.random.default_rng(5)
    if kind == "steps":
        speed = lfilter([0.01], [1, -0.99], np.repeat(rng.normal(size=N // 500) * 30, 500))
    elif kind == "sine":
        speed = 10 * np.sin(2 * np.pi * 3 * np.arange(N) * STEP)
    else:
        speed = 5 * sosfilt(butter(4, 0.3, output="sos"), rng.normal(size=N))
    return np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * STEP)]), speed


def speed_findings(angle, speed):
    return {f.code: f for f in compare_speed_and_angle(angle, speed, STEP, ((0, len(angle)),), "motor")}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["steps", "sine", "noise"])
@pytest.mark.parametrize("counts", [None, 4096, 200])
def test_true_and_false_alarms(kind, counts):
    angle, speed = motion(kind)
    if counts:
        angle = np.round(angle * counts / (2 * np.pi)) * 2 * np.pi / counts
    speed = speed + np.random.default_rng(6).normal(size=N) * 0.2
    assert speed_findings(angle, speed) == {}
    if counts == 200 and kind == "noise":
        return  # the motion is smaller than an encoder step: nothing can be said, and nothing is
    assert set(speed_findings(angle, 1.05 * speed)) == {"speed-angle-mismatch"}
    assert set(speed_findings(angle, -speed)) == {"speed-angle-mismatch"}
    late = speed_findings(angle, np.roll(speed, 4))
    assert set(late) <= {"speed-delay", "speed-filtered"}
    assert next(iter(late.values())).evidence["lag"] == pytest.approx(4 * STEP, rel=0.2)
    assert set(speed_findings(angle, np.random.default_rng(7).normal(size=N))) == {"speed-angle-mismatch"}


def test_a_filter_is_distinguished_from_a_delay():
    angle, speed = motion("noise")
    behind = speed_findings(angle, lfilter([0.1], [1, -0.9], speed))
    assert set(behind) == {"speed-filtered"}
    assert behind["speed-filtered"].evidence["corner"] == pytest.approx(1 / (2 * np.pi * 9 * STEP), rel=0.1)
    late = speed_findings(angle, np.roll(speed, 4))
    assert set(late) == {"speed-delay"}
    assert late["speed-delay"].evidence["lag"] == pytest.approx(4 * STEP, rel=0.02)


def test_standing_still_most_of_the_time():
    angle, speed = motion("steps")
    speed[3000:] = 0.0
    angle[3000:] = angle[3000]
    assert speed_findings(angle, speed) == {}
    assert speed_findings(angle, np.zeros(N)) == {}


def test_missing_values_and_segments():
    angle, speed = motion("steps")
    speed = speed.copy()
    speed[5000] = np.nan
    assert compare_speed_and_angle(angle, speed, STEP, ((0, 3000), (3001, N)), "motor") == []
    short = compare_speed_and_angle(angle, -speed, STEP, ((0, 40),), "motor")
    assert short == []


def test_differentiator():
    speed = differentiate(np.array([0.0, 1.0, 4.0, 9.0]), 0.5)
    np.testing.assert_array_equal(speed, [np.nan, 4.0, 8.0, np.nan])


@pytest.mark.skipif("DRIVETOOL_RECORDS" not in os.environ, reason="DRIVETOOL_RECORDS is not set")
def test_motor_bench_logs_filtered_speeds():
    roles = {"motor_torque": "iq", "motor_angle": "theta_m", "motor_speed": "omega_m",
             "load_angle": "theta_l", "load_speed": "omega_l"}
    experiment = open_experiment(Path(os.environ["DRIVETOOL_RECORDS"]) / "motorbench-a.parquet",
                                 ChannelMap.from_mapping({"schema": SCHEMA, "roles": roles}))
    assert [f.code for f in experiment.findings] == ["speed-filtered", "speed-filtered"]
    for finding in experiment.findings:
        assert finding.evidence["corner"] == pytest.approx(20.4, abs=0.1)
        assert finding.evidence["scale"] == pytest.approx(1.0, abs=1e-3)
