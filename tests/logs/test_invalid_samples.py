"""Samples that are none: values that no neighbour supports, numbers that jump over the range of their register."""

import numpy as np
import pytest

from drivetool.logs.channels.channel_map import SCHEMA, ChannelMap
from drivetool.logs.door.build import build_experiment
from drivetool.logs.experiment import Channel, Recording
from drivetool.logs.samples import unmeasured_samples as module
from drivetool.logs.samples.unmeasured_samples import without_unmeasured

N, STEP = 6000, 1e-3
TIME = np.arange(N) * STEP


def motion(seed=1, noise=0.02):
    """(torque, speed, angle) of one body under multisine torque; the speed with noise, the angle of an encoder."""
    rng = np.random.default_rng(seed)
    torque = np.sum([np.sin(2 * np.pi * f * TIME + p) for f, p in zip(np.arange(1, 40, 3.0),
                                                                      rng.uniform(0, 6, 13), strict=True)], axis=0)
    speed = 5.0 + np.cumsum(torque) * STEP / 0.01
    count = 2 * np.pi / 65536
    return torque, speed + noise * rng.standard_normal(N), np.round(np.cumsum(speed) * STEP / count) * count


def built(entries=None, **signals):
    units = {"torque": "Nm", "speed": "rad/s", "angle": "rad"}
    log = Recording("log.parquet", "0" * 64, {
        role: Channel(TIME, np.asarray(values, float), units[role.rpartition("_")[2]])
        for role, values in signals.items()})
    roles = {role: {"channel": role, **(entries or {}).get(role, {})} for role in signals}
    return build_experiment(log, ChannelMap.from_mapping({"schema": SCHEMA, "roles": roles}))


def findings_of(experiment, code):
    return [f for f in experiment.findings if f.code == code]


def left_out(experiment, role):
    return set(np.flatnonzero(np.isnan(without_unmeasured(experiment).signals[role])).tolist())


@pytest.mark.parametrize(("share", "value"), [(0.001, 0.0), (0.02, 0.0), (0.01, -327.68), (0.005, 8191.0)])
@pytest.mark.parametrize("role", ["motor_speed", "motor_angle"])
def test_values_of_a_sensor_that_had_none(share, value, role):
    torque, speed, angle = motion()
    good = {"motor_speed": speed, "motor_angle": angle}[role]
    bad = np.random.default_rng(5).random(N) < share
    bad[:10] = bad[-10:] = False
    found = built(motor_torque=torque, **{role: np.where(bad, value, good)})
    finding, = findings_of(found, "outliers-left-out")
    assert f"drops to exactly {value:g}" in finding.text
    gone = left_out(found, role)
    assert gone <= set(np.flatnonzero(bad).tolist())
    # What stays is as near as a sample of noise may be, or one of several in a row.
    alone = bad & ~np.roll(bad, 1) & ~np.roll(bad, -1) & (np.abs(good - value) > 1.0)
    assert np.mean([k in gone for k in np.flatnonzero(alone)]) > 0.95


def test_outliers_of_any_value():
    torque, speed, _ = motion()
    at = np.array([500, 1700, 4000])
    speed[at] += [10.0, -12.0, 40.0]
    found = built(motor_torque=torque, motor_speed=speed)
    assert left_out(found, "motor_speed") == set(at.tolist())
    assert "has outliers" in findings_of(found, "outliers-left-out")[0].text


def shock():
    """A hard stop, a ring-down at a fifth of the rate, and steps."""
    wave = np.where(TIME > 2, np.exp(-8 * (TIME - 2)) * np.sin(2 * np.pi * 200 * (TIME - 2)) * 20, 0.0)
    return wave + np.where(TIME > 4, 7.0, 0.0)


@pytest.mark.parametrize("make", [
    lambda rng: motion()[1], lambda rng: motion()[2], lambda rng: shock() + 0.05 * rng.standard_normal(N),
    lambda rng: rng.standard_t(20, N), lambda rng: np.cumsum(rng.standard_normal(N)),
    lambda rng: np.round(np.sin(3 * TIME) * 40), lambda rng: np.round(0.4 * rng.standard_normal(N)),
    lambda rng: np.abs(np.sin(20 * TIME)) + 1e-6 * rng.standard_normal(N)])
def test_what_moves_is_measured(make):
    values = make(np.random.default_rng(8))
    found = built(motor_torque=motion()[0], motor_speed=values)
    assert not findings_of(found, "outliers-left-out") and not left_out(found, "motor_speed")


def test_a_command_and_a_shaft_may_have_peaks_of_one_sample():
    torque, speed, _ = motion()
    peaks = 0.01 * np.sin(TIME) + np.where(np.arange(N) % 700 == 0, 50.0, 0.0)
    found = built(motor_torque=peaks, shaft_torque=peaks + 1e-3 * torque, motor_speed=speed)
    assert not findings_of(found, "outliers-left-out")


def near_the_bound(times):
    """Whether a sample so many standard deviations of the noise away is left out, in most of 40 places."""
    torque, speed, _ = motion(noise=0.0)
    rng = np.random.default_rng(3)
    at = np.arange(100, N - 100, 145)
    speed = 0.01 * speed + 0.02 * rng.standard_normal(N)
    speed[at] = 0.01 * motion(noise=0.0)[1][at] + 0.02 * times
    return len(left_out(built(motor_torque=torque, motor_speed=speed), "motor_speed")) > 0.5 * len(at)


@pytest.mark.parametrize(("threshold", "times", "out"), [
    (module.OUTLIER_THRESHOLD, 6.0, False), (module.OUTLIER_THRESHOLD, 11.0, True), (4.0, 6.0, True),
    (16.0, 11.0, False)])
def test_eight_standard_deviations(monkeypatch, threshold, times, out):
    monkeypatch.setattr(module, "OUTLIER_THRESHOLD", threshold)
    assert near_the_bound(times) is out


# --- modulo

@pytest.mark.parametrize(("bits", "size"), [(16, 300.0), (12, 150.0), (8, 12.0)])
@pytest.mark.parametrize("role", ["motor_torque", "motor_speed"])
def test_negative_numbers_read_as_unsigned(bits, size, role):
    torque, speed, _ = motion()
    signals = {"motor_torque": torque, "motor_speed": speed - speed.mean()}
    raw = np.round(signals[role] * size / np.abs(signals[role]).max())
    wrapped = {**signals, role: np.mod(raw, 2**bits)}
    found = built(**wrapped)
    finding, = findings_of(found, "value-wraps")
    assert finding.evidence["size"] == 2**bits and f"wrap: {2**bits}" in finding.action
    undone = built({role: {"wrap": 2**bits}}, **wrapped)
    assert not findings_of(undone, "value-wraps")
    np.testing.assert_array_equal(undone.signals[role], raw)


def test_a_speed_beyond_its_register():
    torque, speed, _ = motion()
    raw = np.round(speed * 40000 / np.abs(speed).max())
    over = np.mod(raw + 2**15, 2**16) - 2**15
    finding, = findings_of(built(motor_torque=torque, motor_speed=over), "value-wraps")
    assert finding.evidence["size"] == 2**16


@pytest.mark.parametrize("raw", [
    np.where(np.sin(20 * TIME) > 0, 250.0, 0.0), np.round(120 * np.sin(9 * TIME)), np.round(250 * (TIME % 1 > 0.5)),
    np.round(100 * np.sign(np.sin(9 * TIME)) + 20 * np.sin(50 * TIME)),
    np.where(np.arange(N) % 50 == 0, 255.0, 3.0)])
def test_what_switches_is_no_counter(raw):
    _, speed, _ = motion()
    assert not findings_of(built(motor_torque=raw, motor_speed=speed), "value-wraps")
