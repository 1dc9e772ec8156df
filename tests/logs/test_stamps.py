"""Time as people's logs have it: coarse stamps, counters that start again, numbers without a unit, empty rows."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings, strategies as st
from mcap.writer import Writer

from drivetool.drive import one_body
from drivetool.errors import BadOption, BadRecording, DriveToolError
from drivetool.identify.greybox import greybox
from drivetool.identify.setup import Options
from drivetool.logs.channels.channel_map import SCHEMA, ChannelMap
from drivetool.logs.channels.time_numbers import MAX_SAMPLE_INTERVAL
from drivetool.logs.clocks.batched_times import find_batches
from drivetool.logs.clocks.coarse_clock import restore_uniform_times
from drivetool.logs.door.build import build_experiment, open_experiment
from drivetool.logs.experiment import Channel, Recording
from tests.logs.test_readers import write_mcap

N = 4000
INERTIA = 0.02


def axis(step, n=N, seed=3):
    """(torque, speed) of one body without friction: what it does is a sum."""
    rng = np.random.default_rng(seed)
    torque = np.repeat(rng.uniform(-1.0, 1.0, n // 50 + 1), 50)[:n]
    speed = np.concatenate([[0.0], np.cumsum(torque)[:-1]]) * step / INERTIA
    return torque, speed + 0.01 * rng.standard_normal(n)


def channel_map(roles=None, **more):
    given = {"motor_torque": {"channel": "torque", "unit": "Nm"},
             "motor_speed": {"channel": "speed", "unit": "rad/s"}}
    return ChannelMap.from_mapping({"schema": SCHEMA, "roles": roles or given, **more})


def logged(torque, speed):
    """A recording of (time, values) for both."""
    return Recording("log.parquet", "0" * 64, {"motor_torque": Channel(*torque, "Nm"),
                                               "motor_speed": Channel(*speed, "rad/s")})


def codes(experiment):
    return {f.code for f in experiment.findings}


def inertia(experiment):
    start = one_body("Nm", "rad").with_values({"motor.inertia": 0.01})
    row = next(p for p in greybox([experiment], start, Options()).parameters if p.name == "motor.inertia")
    return row.value, row.std


# --- stamps that were cut

def cut_to_resolution(time, resolution):
    return np.floor(time / resolution + 1e-6) * resolution


@pytest.mark.parametrize(("step", "resolution"), [
    (2.5e-4, 1e-3), (1 / 3000, 1e-3), (1 / 1700, 1e-3), (1 / 900, 1e-3), (1 / 300, 1e-3), (0.02, 1.0),
    (1e-5, 1e-4)])
@pytest.mark.parametrize("drift", [0.0, 1e-6])
def test_the_clock_behind_coarse_stamps(step, resolution, drift):
    time = np.arange(N) * step * (1 + drift)
    found, size = restore_uniform_times(cut_to_resolution(time, resolution))
    assert size == pytest.approx(resolution, rel=1e-3)
    assert np.ptp(found - time) < max(0.2 * step, 0.02 * resolution)
    assert np.abs(found - time).max() < 0.6 * resolution


@pytest.mark.parametrize("share", [0.001, 0.01, 0.09])
@pytest.mark.parametrize(("step", "resolution"), [(2.5e-4, 1e-3), (5e-4, 1e-3), (1e-4, 1e-3), (1 / 3000, 1e-3)])
def test_samples_that_were_lost_behind_coarse_stamps(step, resolution, share):
    rng = np.random.default_rng(7)
    kept = np.sort(rng.choice(N, N - round(share * N), replace=False))
    found, size = restore_uniform_times(cut_to_resolution(kept * step, resolution))
    there = np.bincount((cut_to_resolution(kept * step, resolution) / resolution).round().astype(int))
    worst = round(resolution / step) - there[1:-1].min()
    off = found - kept * step
    assert size == pytest.approx(resolution) and np.ptp(off - off.mean()) < (2 * worst + 0.01) * step
    assert np.abs(off).max() < (worst + 0.51) * step and np.mean(np.abs(off - np.median(off)) < 0.01 * step) > 0.6


@pytest.mark.parametrize("step", [1 / 1900, 1 / 3900, 1 / 3100])
def test_a_rate_that_is_no_whole_number_per_stamp_has_lost_none(step):
    time = np.arange(N) * step
    found, _ = restore_uniform_times(cut_to_resolution(time, 1e-3))
    assert np.ptp(found - time) < 0.2 * step


def test_of_many_lost_no_clock_is_made():
    kept = np.sort(np.random.default_rng(7).choice(N, round(0.8 * N), replace=False))
    assert restore_uniform_times(cut_to_resolution(kept * 2.5e-4, 1e-3)) is None


def test_the_inertia_behind_coarse_stamps_with_losses():
    torque, speed = axis(2.5e-4)
    kept = np.sort(np.random.default_rng(1).choice(N, N - N // 100, replace=False))
    stamps = cut_to_resolution(kept * 2.5e-4, 1e-3)
    found = build_experiment(logged((stamps, torque[kept]), (stamps, speed[kept])))
    assert {"clock-corrected", "samples-missing"} == codes(found) and found.segments == ((0, found.size),)
    value, std = inertia(found)
    assert abs(value - INERTIA) < 3.0 * std and std < 0.01 * INERTIA


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32), st.integers(1, 60), st.floats(0.0, 0.4))
def test_other_clocks_are_left_as_they_are(seed, lost, jitter):
    rng = np.random.default_rng(seed)
    time = np.delete(np.arange(N) * 1e-3, rng.choice(N, lost, replace=False))
    assert restore_uniform_times(time) is None
    assert restore_uniform_times(np.sort(time + jitter * 1e-3 * rng.standard_normal(len(time)))) is None


def test_rows_that_were_logged_twice_are_no_faster_clock():
    torque, speed = axis(1e-3)
    time = np.repeat(np.arange(N) * 1e-3, 2)
    found = build_experiment(logged((time, np.repeat(torque, 2)), (time, np.repeat(speed, 2))))
    assert found.step == pytest.approx(1e-3) and codes(found) == {"time-stamps-invalid"}
    np.testing.assert_array_equal(found.signals["motor_speed"], speed)


@pytest.mark.slow
@pytest.mark.parametrize(("step", "resolution"), [(1 / 3000, 1e-3), (0.004, 0.01)])
def test_the_inertia_of_coarse_stamps_is_that_of_whole_ones(step, resolution):
    torque, speed = axis(step)
    whole, coarse = (build_experiment(logged((time, torque), (time, speed)))
                     for time in (np.arange(N) * step, cut_to_resolution(np.arange(N) * step, resolution)))
    assert "clock-corrected" in codes(coarse) and not codes(whole)
    np.testing.assert_allclose(inertia(coarse), inertia(whole), rtol=1e-3)


# --- receive times in batches

def receive_times(size, interval, step=0.002):
    """Times at which messages of a uniform clock arrive that wait for each other, one every `interval` seconds."""
    k = np.arange(N)
    return (k // size * size + size - 1) * step + (k % size) * interval + 1e-3


def messages(path, size, interval, published=True, stamped=True):
    torque, speed = axis(0.002)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        sid = writer.register_schema("axis", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/axis", "json", sid)
        for k, late in enumerate((receive_times(size, interval) * 1e9).astype(int).tolist()):
            stamp = {"header": {"stamp": {"sec": k // 500, "nanosec": k % 500 * 2_000_000}}} if stamped else {}
            text = json.dumps({**stamp, "torque": float(torque[k]), "speed": float(speed[k])})
            writer.add_message(channel, late, text.encode(), 2_000_000 * k if published else late)
        writer.finish()


@pytest.mark.parametrize(("size", "interval"), [(25, 2e-5), (4, 1e-4), (40, 0.0)])
@pytest.mark.parametrize(("clock", "more"), [
    ("publish_time", {}), ("header.stamp", {"published": False}), ("", {"published": False, "stamped": False})])
def test_messages_that_arrive_in_batches(tmp_path, size, interval, clock, more):
    messages(tmp_path / "a.mcap", size, interval, **more)
    if not clock and interval:
        with pytest.raises(BadRecording, match=f"receive times: batches of {size} samples"):
            open_experiment(tmp_path / "a.mcap", channel_map())
        return
    found = open_experiment(tmp_path / "a.mcap", channel_map())
    # Where a batch has one stamp, it is a coarse clock.
    finding, = [f for f in found.findings if f.code == "clock-corrected"]
    assert not clock or finding.evidence["clock"] == clock
    assert found.step == pytest.approx(0.002, rel=1e-4) and len(found.segments) == 1
    np.testing.assert_array_equal(found.signals["motor_speed"], axis(0.002)[1])


def test_a_table_of_receive_times_is_refused():
    torque, speed = axis(0.002)
    time = receive_times(10, 5e-5)
    with pytest.raises(BadRecording, match=r"batches of 10 samples, one every 0\.02 s"):
        build_experiment(logged((time, torque), (time, speed)))


@pytest.mark.parametrize("make", [
    lambda rng: np.arange(N) * 1e-3 + np.cumsum(np.where(np.arange(N) % 300 == 0, rng.uniform(1, 5, N), 0)),
    lambda rng: np.arange(N) * 1e-3 + np.cumsum(np.where(np.arange(N) % 40 == 0, rng.exponential(0.5, N), 0)),
    lambda rng: np.cumsum(rng.exponential(1e-3, N)),
    lambda rng: np.concatenate([np.arange(0, 30, 0.03), 30 + np.arange(N) * 6e-4]),  # one rate after the other
    lambda rng: np.sort((np.arange(N) + 0.4 * rng.standard_normal(N)) * 1e-3)])
def test_pauses_and_jitter_are_no_batches(make):
    assert find_batches(make(np.random.default_rng(2))) is None


# --- counters

def write_counter_log(tmp_path, bits, unit, dtype, step=0.002, **entry):
    torque, speed = axis(step)
    ticks = {"us": 10**6, "ms": 10**3, "ns": 10**9}[unit]
    counts = (np.round(np.arange(N) * step * ticks).astype(np.int64) - int(2.4 * ticks)) % 2**bits
    pq.write_table(pa.table({"torque": torque, "speed": speed, "t": counts.astype(dtype)}), tmp_path / "a.parquet")
    return open_experiment(tmp_path / "a.parquet", channel_map(time={"channel": "t", "unit": unit, **entry}))


@pytest.mark.slow
@pytest.mark.parametrize(("bits", "unit", "dtype"), [
    (32, "us", np.uint32), (32, "us", np.float64), (32, "ns", np.uint32), (16, "ms", np.uint16)])
def test_a_counter_that_starts_again(tmp_path, bits, unit, dtype):
    with pytest.raises(BadRecording, match=rf"overflowing counter of 2\^{bits} {unit}\..*wrap: {2**bits}"):
        write_counter_log(tmp_path, bits, unit, dtype)
    found = write_counter_log(tmp_path, bits, unit, dtype, wrap=2**bits)
    assert found.step == pytest.approx(0.002) and found.segments == ((0, N),) and not codes(found)
    assert inertia(found)[0] == pytest.approx(INERTIA, rel=5e-3)


def test_a_clock_that_was_set_back_is_no_counter(tmp_path):
    time = np.arange(N) * 0.002
    time[2000:] -= 1.7
    with pytest.raises(BadRecording) as caught:
        build_experiment(logged((time, axis(0.002)[0]), (time, axis(0.002)[1])))
    assert "counter" not in str(caught.value) and "keep to=" in str(caught.value)


def test_the_wrap_of_a_clock_is_a_number_of_counts():
    with pytest.raises(BadOption, match="counts for wrap of time"):
        channel_map(time={"channel": "t", "wrap": -1})


# --- numbers without a unit

def write_plain_log(tmp_path, step, **more):
    torque, speed = axis(step)
    pq.write_table(pa.table({"t": np.arange(N) * step, "torque": torque, "speed": speed}), tmp_path / "a.parquet")
    return open_experiment(tmp_path / "a.parquet", channel_map(**more))


@pytest.mark.parametrize("step", [0.25, 1.0, 20.0, 500.0])
def test_numbers_that_may_be_milliseconds_are_no_seconds(tmp_path, step):
    with pytest.raises(BadRecording, match=r"unit of the time channel 't' of a.parquet.*unit: ms"):
        write_plain_log(tmp_path, step)
    assert write_plain_log(tmp_path, step, time={"channel": "t", "unit": "ms"}).step == pytest.approx(1e-3 * step)


def test_what_is_fast_enough_is_in_seconds(tmp_path):
    assert write_plain_log(tmp_path, 0.5 * MAX_SAMPLE_INTERVAL).step == pytest.approx(0.5 * MAX_SAMPLE_INTERVAL)
    assert write_plain_log(tmp_path, 1.0, time={"channel": "t", "unit": "s"}).step == pytest.approx(1.0)


def test_messages_that_may_be_stamped_in_milliseconds(tmp_path):
    torque, speed = axis(0.002)
    write_mcap(tmp_path / "a.mcap", {"torque": torque, "speed": speed, "t": 2.0 * np.arange(N)})
    with pytest.raises(BadRecording, match="unit of the time channel 't'"):
        open_experiment(tmp_path / "a.mcap", channel_map(time="t"))


@pytest.mark.parametrize(("origin", "step", "unit"), [(1.75e9, 0.02, None), (1.75e9, 0.002, "s"),
                                                      (1.75e12, 2.0, "ms"), (4.2e6, 0.002, None)])
def test_single_precision_does_not_reach_from_1970(tmp_path, origin, step, unit):
    torque, speed = axis(0.002)
    time = origin + step * np.arange(N)
    entry = {"time": {"channel": "t", "unit": unit}} if unit else {"time": "t"}

    def read(dtype):
        columns = {"t": time.astype(dtype), "torque": torque, "speed": speed}
        pq.write_table(pa.table(columns), tmp_path / "a.parquet")
        return open_experiment(tmp_path / "a.parquet", channel_map(**entry))

    with pytest.raises(BadRecording, match=r"single precision in 't', which resolve .* Export the time in double"):
        read(np.float32)
    assert read(np.float64).step == pytest.approx(step * (1e-3 if unit == "ms" else 1.0), rel=1e-3)


def test_single_precision_may_be_a_coarse_clock(tmp_path):
    """Half of what is refused: steps of 0.125 s, with a uniform clock behind them."""
    torque, speed = axis(0.002)
    time = 1.5e6 + 0.002 * np.arange(N)
    pq.write_table(pa.table({"t": time.astype(np.float32), "torque": torque, "speed": speed}),
                   tmp_path / "a.parquet")
    assert "clock-corrected" in codes(open_experiment(tmp_path / "a.parquet", channel_map(time="t")))


@pytest.mark.parametrize("shift", [9.0, -9.0, 1e3])
def test_a_shift_out_of_the_record(shift):
    time = 0.002 * np.arange(N)
    log = logged((time, axis(0.002)[0]), (time, axis(0.002)[1]))
    torque = {"channel": "motor_torque", "shift": shift}
    with pytest.raises(BadRecording,
                       match=rf"shift after which motor_torque overlaps .* found {shift:g} s in a record of 8 s"):
        build_experiment(log, channel_map({"motor_torque": torque, "motor_speed": {"channel": "motor_speed"}}))
    both = {role: {"channel": role, "shift": shift} for role in ("motor_torque", "motor_speed")}
    assert build_experiment(log, channel_map(both)).size == N
    far = logged((time - shift, axis(0.002)[0]), (time, axis(0.002)[1]))  # clocks that count from other times
    assert build_experiment(far, channel_map({"motor_torque": torque, "motor_speed": {"channel": "motor_speed"}}))


# --- rows and messages without a value

def join_late_samples(every, late):
    """Two tables joined on time: each row has the values of one, NaN in the place of the other's."""
    torque, speed = axis(0.002)
    time, other = np.arange(N) * 0.002, np.arange(0, N, every) * 0.002 + late
    stamps = np.concatenate([time, other])
    order = np.argsort(stamps, kind="stable")
    nothing = np.full(len(other), np.nan)
    return stamps[order], np.concatenate([torque, nothing])[order], np.concatenate([speed, nothing])[order]


@pytest.mark.parametrize(("every", "late"), [(1, 0.001), (1, 0.0007), (7, 0.0), (250, 3e-4), (3, 0.0007)])
def test_rows_without_a_value_are_no_samples(every, late):
    time, torque, speed = join_late_samples(every, late)
    found = build_experiment(logged((time, torque), (time, speed)))
    alone = build_experiment(logged((np.arange(N) * 0.002, axis(0.002)[0]), (np.arange(N) * 0.002, axis(0.002)[1])))
    assert not codes(found) and found.segments == alone.segments and found.step == alone.step
    for role, values in alone.signals.items():
        np.testing.assert_array_equal(found.signals[role], values)


def test_tables_of_two_rates_joined_on_time():
    torque, speed = axis(0.002)
    commands = torque[::50]  # held, and logged at 10 Hz only
    time = np.arange(N) * 0.002
    column = np.full(N, np.nan)
    column[::50] = commands
    found = build_experiment(logged((time, column), (time, speed)))
    whole = build_experiment(logged((time, torque), (time, speed)))
    assert not codes(found)
    np.testing.assert_array_equal(found.signals["motor_torque"], whole.signals["motor_torque"])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_sensor_slower_than_the_torque_and_off_its_clock(seed):
    """Speed at 100 Hz, 0.4 ms behind a held torque at 1 kHz; exact, since the speed is a straight line between."""
    rng = np.random.default_rng(seed)
    fine = np.arange(20 * N // 10) * 1e-3
    torque = np.repeat(rng.uniform(-1, 1, len(fine) // 20), 20)
    clean = np.concatenate([[0.0], np.cumsum(torque)[:-1]]) * 1e-3 / INERTIA
    slow = np.arange(0, len(fine) - 10, 10) * 1e-3 + 0.0004
    speed = np.interp(slow, fine, clean) + 0.02 * rng.standard_normal(len(slow))
    value, std = inertia(build_experiment(logged((fine, torque), (slow, speed))))
    assert abs(value - INERTIA) < 3.0 * std and std < 1e-3 * INERTIA


def test_zeros_that_a_writer_leaves_out(tmp_path):
    torque, speed = axis(0.002)
    torque = np.where(np.arange(N) // 100 % 3 == 0, 0.0, torque)
    speed = np.concatenate([[0.0], np.cumsum(torque)[:-1]]) * 0.002 / INERTIA
    column = np.where(torque == 0.0, np.nan, torque)
    pq.write_table(pa.table({"time": np.arange(N) * 0.002, "torque": column, "speed": speed}),
                   tmp_path / "a.parquet")
    found = open_experiment(tmp_path / "a.parquet", channel_map())
    finding = next(f for f in found.findings if f.code == "samples-missing")
    assert finding.evidence["samples"] == np.isnan(column).sum() and "absent: 0" in finding.action
    assert len(found.segments) > 5
    roles = {"motor_torque": {"channel": "torque", "unit": "Nm", "absent": 0},
             "motor_speed": {"channel": "speed", "unit": "rad/s"}}
    zeros = open_experiment(tmp_path / "a.parquet", channel_map(roles))
    assert not codes(zeros)
    np.testing.assert_array_equal(zeros.signals["motor_torque"], torque)


def test_an_infinite_value_is_a_sample_that_failed():
    torque, speed = axis(0.002)
    speed[[100, 2000]] = np.inf
    time = np.arange(N) * 0.002
    found = build_experiment(logged((time, torque), (time, speed)))
    finding = next(f for f in found.findings if f.code == "samples-missing")
    assert finding.evidence["samples"] == 2 and np.isnan(found.signals["motor_speed"][[100, 2000]]).all()


def test_no_row_with_a_value(tmp_path):
    time = np.arange(N) * 0.002
    with pytest.raises(DriveToolError, match="values of motor_torque"):
        build_experiment(logged((time, np.full(N, np.nan)), (time, axis(0.002)[1])))
