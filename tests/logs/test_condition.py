"""Clocks, counters, rates and conditioning: closed forms, and nothing done without saying so."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.signal import lfilter

from drivetool.drive import one_body
from drivetool.errors import BadOption, BadRecording, NotEnoughData
from drivetool.identify.greybox import greybox
from drivetool.identify.setup import Options
from drivetool.logs.channels.channel_map import SCHEMA, ChannelMap
from drivetool.logs.clocks.rate import average_over_steps, low_pass_reference
from drivetool.logs.conditioning.steps import condition, parse_step
from drivetool.logs.door.build import build_experiment, open_experiment
from drivetool.logs.experiment import Channel, Experiment, Recording
from drivetool.logs.samples.spikes import hold_count, quantisation_step, remove_spikes
from drivetool.logs.samples.unmeasured_samples import without_unmeasured
from drivetool.logs.samples.wrap import looks_wrapped, unwrap
from tests.logs.test_parquet import wide

N, STEP = 3000, 1e-3
TIME = np.arange(N) * STEP


def motion(n=N, seed=2, step=STEP):
    """(speed, angle) of something that is pushed around."""
    rng = np.random.default_rng(seed)
    speed = lfilter([0.02], [1, -0.98], np.repeat(rng.normal(size=n // 100 + 1) * 20, 100)[:n])
    return speed, np.cumsum(speed) * step


def channel_map(roles, **more):
    return ChannelMap.from_mapping({"schema": SCHEMA, "roles": roles, **more})


def recording(**channels):
    return Recording("log.mcap", "0" * 64, {name: Channel(*parts) for name, parts in channels.items()})


def codes(experiment):
    return [f.code for f in experiment.findings]


def torque():
    return TIME, np.sign(np.sin(20 * TIME)), "Nm"


# --- counters

@given(st.integers(2, 16), st.lists(st.integers(-900, 900), min_size=2, max_size=200), st.integers(0, 10**6))
def test_unwrapping_undoes_wrapping(bits, steps, start):
    wrap = 2**bits
    counts = start + np.cumsum(np.clip(steps, -(wrap // 2) + 1, wrap // 2 - 1)).astype(float)
    found, _ = unwrap(np.mod(counts, wrap), wrap, "motor_angle")
    np.testing.assert_array_equal(found - found[0], counts - counts[0])


def test_counts_per_revolution_with_wrap_around():
    _, angle = motion()
    counts = np.round(angle * 4096 / (2 * np.pi))
    log = recording(motor_torque=torque(), enc=(TIME, np.mod(counts, 1024), None))
    entry = {"channel": "enc", "unit": "counts", "per_rev": 4096, "wrap": 1024, "sign": -1}
    found = build_experiment(log, channel_map({"motor_torque": "motor_torque", "motor_angle": entry}))
    start = np.mod(counts, 1024)[0]
    np.testing.assert_allclose(found.signals["motor_angle"], -(counts - counts[0] + start) * 2 * np.pi / 4096,
                               rtol=0, atol=1e-9)
    assert codes(found) == []
    del entry["wrap"]
    found = build_experiment(log, channel_map({"motor_torque": "motor_torque", "motor_angle": entry}))
    assert codes(found) == ["value-wraps"] and found.findings[0].evidence["size"] == pytest.approx(1024, rel=0.01)


def test_an_ambiguous_wrap_is_reported_and_a_position_is_no_wrap():
    values = np.mod(np.arange(50) * 0.45, 1.0)
    assert [f.code for f in unwrap(values, 1.0, "motor_angle")[1]] == ["wrap-ambiguous"]
    moves = np.concatenate([np.zeros(500), np.linspace(0, 1, 3), np.ones(500), np.linspace(1, 0, 3)])
    assert looks_wrapped(moves, "motor_angle", "rad") == []
    spiky = np.sin(TIME)
    spiky[700] = 50.0
    assert looks_wrapped(spiky, "motor_angle", "rad") == []


@pytest.mark.parametrize(("entry", "words"), [
    ({"unit": "counts"}, ["counts per revolution", "per_rev: 8192"]),
    ({"unit": "rad", "per_rev": 4096}, ["unit counts", "leave per_rev out"]),
    ({"unit": "counts", "per_rev": 0}, ["per_rev", "zero"]),
    ({"unit": "deg", "wrap": "x"}, ["wrap"]),
    ({"time": {"channel": "t", "unit": "rpm"}}, ["time of motor_angle", "rpm"]),
    ({"time": {"chanel": "t"}}, ["'chanel'", "Did you mean 'channel'"]),
])
def test_mistakes_in_an_entry(entry, words):
    with pytest.raises(BadOption) as caught:
        channel_map({"motor_angle": {"channel": "x", **entry}})
    for word in words:
        assert word in str(caught.value)


# --- clocks

@pytest.mark.parametrize("offset", [0.0123, -0.3, 5000.0])
def test_a_clock_offset_is_estimated_and_not_applied(offset):
    speed, angle = motion(20 * N, step=1e-4)
    fine = np.arange(20 * N) * 1e-4
    slow = np.arange(0.0007, 5.9, 2.5e-3)
    rng = np.random.default_rng(3)
    log = recording(motor_torque=(np.arange(5900) * STEP, np.sign(np.sin(20 * np.arange(5900) * STEP)), "Nm"),
                    motor_speed=(np.arange(5900) * STEP, speed[::10][:5900] + 0.02 * rng.normal(size=5900),
                                 "rad/s"),
                    motor_angle=(slow + offset, np.interp(slow, fine, angle), "rad"))
    if offset > 10:
        with pytest.raises(BadRecording, match=r"motor_angle.*do not overlap.*write `shift: -50(00|)"):
            build_experiment(log)
        return
    found = build_experiment(log)
    finding = next(f for f in found.findings if f.code == "clock-offset")
    assert finding.evidence["shift"] == pytest.approx(-offset, abs=3e-4) and "nothing was shifted" in finding.text
    assert "speed-delay" not in codes(found)
    shifted = build_experiment(log, channel_map({
        "motor_torque": "motor_torque", "motor_speed": "motor_speed",
        "motor_angle": {"channel": "motor_angle", "shift": -offset}}))
    assert "clock-corrected" in codes(shifted) and "clock-offset" not in codes(shifted)


def test_clocks_that_agree_are_not_suspected():
    speed, angle = motion(20 * N, step=1e-4)
    fine = np.arange(20 * N) * 1e-4
    slow = np.arange(0.0007, 5.9, 2.5e-3)
    time = np.arange(5900) * STEP
    found = build_experiment(recording(
        motor_torque=(time, np.sign(np.sin(20 * time)), "Nm"), motor_speed=(time, speed[::10][:5900], "rad/s"),
        load_speed=(slow, np.interp(slow, fine, speed), "rad/s"), motor_angle=(slow, np.interp(slow, fine, angle),
                                                                             "rad")))
    assert "clock-offset" not in codes(found)


def test_late_samples_are_sorted_and_a_clock_set_back_is_refused():
    order = np.arange(N)
    order[[500, 501]] = order[[501, 500]]
    order[1000:1010] = np.roll(order[1000:1010], 3)
    speed, _ = motion()
    push = np.sign(np.sin(20 * TIME))
    found = build_experiment(recording(motor_torque=(TIME[order], push[order], "Nm"),
                                       motor_speed=(TIME[order], speed[order], "rad/s")))
    assert codes(found) == ["time-stamps-invalid"] and found.signals["motor_speed"].tobytes() == speed.tobytes()
    for back in (0.002, 0.0105, 0.2):
        time = TIME.copy()
        time[1500:] -= back
        with pytest.raises(BadRecording, match=r"time that does not go backwards.*after sample 1499 at 1\.499"):
            build_experiment(recording(motor_torque=(time, push, "Nm"), motor_speed=(time, speed, "rad/s")))


def test_thirty_per_cent_of_the_samples_missing():
    keep = np.sort(np.random.default_rng(4).choice(N, int(0.7 * N), replace=False))
    speed, _ = motion()
    found = build_experiment(recording(motor_torque=(TIME[keep], np.sign(np.sin(20 * TIME))[keep], "Nm"),
                                       motor_speed=(TIME[keep], speed[keep], "rad/s")))
    assert found.step == pytest.approx(STEP, rel=1e-9)
    by_code = {f.code: f for f in found.findings}
    gaps, = [f.evidence["gaps"] for f in found.findings if "gaps" in f.evidence]
    assert gaps == np.sum(np.diff(keep) > 3.5)
    assert by_code["samples-missing"].severity == "warning"
    for first, last in found.segments:
        seen = np.isfinite(found.signals["motor_speed"][first:last])
        at = np.round((found.time[first:last][seen] + found.start) / STEP).astype(int)
        np.testing.assert_array_equal(found.signals["motor_speed"][first:last][seen], speed[at])


# --- rates

def test_a_faster_sensor_is_low_passed_without_delay_or_aliases():
    fine = np.arange(40_000) * 1e-4
    at = np.arange(0.2, 3.8, STEP) + 0.00003
    for f in (3.0, 80.0, 250.0):
        np.testing.assert_allclose(low_pass_reference(at, STEP, fine, np.sin(2 * np.pi * f * fine)),
                                   np.sin(2 * np.pi * f * at), atol=2e-3)
    for f in (510.0, 990.0, 1003.0, 4321.0):
        assert np.abs(low_pass_reference(at, STEP, fine, np.sin(2 * np.pi * f * fine))).max() < 2e-2
    assert np.abs(low_pass_reference(at, STEP, fine, np.sin(2 * np.pi * 1003.0 * fine))).max() < 2e-4
    np.testing.assert_allclose(low_pass_reference(at, STEP, fine, np.full(40_000, 7.5)), 7.5, rtol=1e-14)


def test_a_faster_input_keeps_its_impulse():
    fine = np.arange(1000) * 1e-4
    values = np.random.default_rng(1).normal(size=1000)
    found = average_over_steps(np.arange(100) * 1e-3, 1e-3, fine, values)
    np.testing.assert_allclose(found, values.reshape(100, 10).mean(axis=1), rtol=1e-9, atol=1e-12)
    for lost, unknown in ([345], set()), (np.arange(340, 360), {34, 35}):
        found = average_over_steps(np.arange(100) * 1e-3, 1e-3, np.delete(fine, lost), np.delete(values, lost))
        assert set(np.flatnonzero(np.isnan(found))) == unknown


def test_the_grid_is_that_of_the_fastest_sensor():
    fine = np.arange(10 * N) * 1e-4
    square, speed = np.sign(np.sin(20 * TIME)), np.sin(2 * np.pi * 5 * fine)
    found = build_experiment(recording(motor_torque=(TIME, square, "Nm"), motor_speed=(fine, speed, "rad/s")))
    assert codes(found) == [] and found.step == pytest.approx(1e-4)
    np.testing.assert_array_equal(found.signals["motor_speed"], speed)
    np.testing.assert_array_equal(found.signals["motor_torque"], np.repeat(square, 10))


def test_a_held_command_off_the_grid_keeps_its_impulse():
    slow = np.arange(0, N, 20) * STEP + 0.0003
    values = np.random.default_rng(1).normal(size=len(slow))
    found = build_experiment(recording(motor_torque=(slow, values, "Nm"),
                                       motor_speed=(TIME, np.sin(10 * TIME), "rad/s")))
    assert codes(found) == ["resampled", "torque-missing"] and found.step == pytest.approx(STEP)
    assert found.findings[1].severity == "note"
    torque = found.signals["motor_torque"]
    first, last = found.segments[0]
    assert (first, last) == (1, N)
    np.testing.assert_allclose(torque[10::20], values, rtol=1e-9)
    # Of step 20, 0.3 ms belong to the value before.
    np.testing.assert_allclose(torque[20::20], 0.3 * values[:-1] + 0.7 * values[1:], rtol=1e-9)


def test_a_reference_that_is_faster_is_low_passed():
    fine = np.arange(10 * N) * 1e-4
    found = build_experiment(recording(
        motor_torque=(TIME, np.sign(np.sin(20 * TIME)), "Nm"), motor_speed=(TIME, np.cos(TIME), "rad/s"),
        reference_speed=(fine, np.sin(2 * np.pi * 5 * fine) + np.sin(2 * np.pi * 997 * fine), "rad/s")))
    assert codes(found) == ["resampled", "resampled"] and found.step == pytest.approx(STEP)
    assert found.findings[0].evidence["cut_off"] == pytest.approx(400.0)
    seen = found.signals["reference_speed"]
    inside = np.isfinite(seen)
    assert inside.sum() >= N - 22
    np.testing.assert_allclose(seen[inside], np.sin(10 * np.pi * TIME)[inside], atol=1e-3)


def test_repeated_values_are_reported():
    speed, _ = motion()
    assert hold_count(np.repeat(speed[::4], 4)) == 4 and hold_count(speed) == 1
    assert hold_count(np.round(speed, 1)) == 1 and hold_count(np.zeros(500)) == 1
    slow = np.repeat(speed[::4], 4)
    found = build_experiment(recording(motor_torque=torque(), motor_speed=(TIME, slow, "rad/s")))
    assert codes(found) == ["samples-not-measured"]
    assert "at 250 Hz and was logged at 1000 Hz" in found.findings[0].text
    np.testing.assert_array_equal(found.signals["motor_speed"], slow)
    # What a sensor did not measure is missing for a physical model: its first value of each four is left.
    known = np.isfinite(without_unmeasured(found).signals["motor_speed"])
    assert known[::4].all() and known.sum() == -(-len(slow) // 4)


def test_a_straight_line_between_two_samples_is_no_measurement():
    noise = np.random.default_rng(3)
    speed, _ = motion()
    speed = speed + 1e-2 * noise.standard_normal(len(speed))
    line = np.interp(TIME, TIME[::5], speed[::5])
    for values in (line, line.astype(np.float32).astype(float)):
        found = build_experiment(recording(motor_torque=torque(), motor_speed=(TIME, values, "rad/s")))
        assert codes(found) == ["samples-not-measured"] and "at 200 Hz" in found.findings[0].text
        speeds = without_unmeasured(found).signals["motor_speed"]
        known = np.flatnonzero(np.isfinite(speeds))
        assert set(known[known < 5 * (len(TIME) // 5) - 5] % 5) == {0}
        np.testing.assert_array_equal(speeds[known], values[known])
    # Nor is measured speed a line, with steps of a coarse sensor or without, in steady motion or at rest.
    for values in (speed, np.round(speed, 1), np.linspace(0.0, 3.0, len(TIME)), 2.0 + 1e-9 * speed, TIME):
        kept = build_experiment(recording(motor_torque=torque(), motor_speed=(TIME, values, "rad/s")))
        assert not {"samples-not-measured", "signal-saturated"} & set(codes(kept))
        assert np.isfinite(without_unmeasured(kept).signals["motor_speed"]).all()


def test_a_sensor_at_the_end_of_its_range_measures_nothing():
    noise = np.random.default_rng(4)
    speed = 5.0 * np.sin(6.0 * TIME) + 1e-2 * noise.standard_normal(len(TIME))
    cut = np.clip(speed, -10.0, 4.0)
    found = build_experiment(recording(motor_torque=torque(), motor_speed=(TIME, cut, "rad/s")))
    assert codes(found) == ["signal-saturated"] and "exactly 4 at" in found.findings[0].text
    np.testing.assert_array_equal(np.isnan(without_unmeasured(found).signals["motor_speed"]), speed > 4.0)
    # Standstill, a highest value that comes once, and plateaus of a signal without noise are none.
    rest = np.where(TIME < 0.3, 0.0, np.abs(speed))
    for values in (speed, rest, np.minimum(5.0 * np.sin(6.0 * TIME), 4.0)):
        kept = build_experiment(recording(motor_torque=torque(), motor_speed=(TIME, values, "rad/s")))
        assert "signal-saturated" not in codes(kept)
        assert np.isfinite(without_unmeasured(kept).signals["motor_speed"]).all()


# --- conditioning

def experiment(**signals):
    n = len(next(iter(signals.values())))
    return Experiment("log", "0" * 64, STEP, 0.0, signals, ((0, n // 2), (n // 2, n)))


def apply_steps(given, *steps):
    return condition(given, [parse_step(text) for text in steps])


def test_spikes_take_the_median_and_edges_stay():
    rng = np.random.default_rng(9)
    clean = np.repeat(rng.normal(size=30) * 10, 100) + 0.1 * rng.normal(size=N)
    places = np.arange(30, N, 100)
    dirty = clean.copy()
    dirty[places] += 5 * np.where(np.arange(len(places)) % 2, 1, -1)
    dirty[7] = np.nan
    found = apply_steps(experiment(motor_speed=dirty, motor_torque=clean), "despike")
    changed = np.flatnonzero(found.signals["motor_speed"] != dirty)
    assert set(places) <= set(changed) and len(changed) <= len(places) + 3  # and one is the NaN
    assert np.abs(found.signals["motor_speed"][places] - clean[places]).max() < 0.5
    note = found.findings[0]
    assert (note.severity, note.code) == ("note", "conditioned")
    assert len(places) <= note.evidence["replaced_motor_speed"] <= len(places) + 2
    assert "despike window=7 threshold=5" in note.text
    only = apply_steps(experiment(motor_speed=dirty, motor_torque=dirty), "despike roles=motor_torque")
    assert only.signals["motor_speed"].tobytes() == dirty.tobytes()


def test_quantised_values_are_no_spikes():
    toggling = np.round(0.5 + 0.01 * np.sin(TIME * 50) + 0.02 * np.random.default_rng(1).normal(size=N))
    assert not remove_spikes(toggling)[1].any()
    assert quantisation_step(np.round(motion()[0] / 0.025) * 0.025) == pytest.approx(0.025, rel=1e-9)
    assert quantisation_step(motion()[0]) == 0.0 and quantisation_step(np.ones(9)) == 0.0


def test_the_low_pass_has_no_delay_and_treats_all_alike():
    slow, fast = np.sin(2 * np.pi * 5 * TIME), np.sin(2 * np.pi * 200 * TIME)
    given = experiment(motor_speed=slow + fast, motor_torque=slow + fast)
    found = apply_steps(given, "lowpass cutoff=50 order=4")
    assert found.signals["motor_speed"].tobytes() == found.signals["motor_torque"].tobytes()
    middle = slice(100, N // 2 - 100)
    # |H|^2 = 1 / (1 + (tan(pi f T) / tan(pi fc T))^(2 n)) of the bilinear Butterworth, once for each way.
    gain = 1 / (1 + (np.tan(np.pi * 0.005) / np.tan(np.pi * 0.05)) ** 8)
    np.testing.assert_allclose(found.signals["motor_speed"][middle], gain * slow[middle], atol=1e-4)


def test_missing_values_stay_missing_in_the_low_pass():
    values = np.sin(2 * np.pi * 5 * TIME)
    values[[100, 101]] = np.nan
    values[400:450] = np.nan
    found = apply_steps(experiment(motor_speed=values, motor_torque=TIME), "lowpass cutoff=100")
    np.testing.assert_array_equal(np.isnan(found.signals["motor_speed"]), np.isnan(values))


def test_detrend_by_segment():
    values = np.where(np.arange(N) < N // 2, 3 + 2 * TIME, -5 - TIME)
    given = experiment(motor_angle=values, motor_torque=np.ones(N))
    found = apply_steps(given, "detrend order=1 roles=motor_angle")
    np.testing.assert_allclose(found.signals["motor_angle"], 0, atol=1e-12)
    assert np.all(found.signals["motor_torque"] == 1)
    mean = apply_steps(experiment(motor_angle=values), "detrend").signals["motor_angle"]
    assert abs(mean[:N // 2].mean()) < 1e-12 and abs(mean[N // 2:].mean()) < 1e-12


def test_decimation_keeps_the_integral():
    # A speed that integrates the torque exactly under zero order hold does so after decimation.
    torque = lfilter([0.02], [1, -0.98], np.random.default_rng(1).normal(size=N))
    speed = np.concatenate([[0], np.cumsum(torque)[:-1]]) * STEP
    given = Experiment("log", "0" * 64, STEP, 0.0, {"motor_torque": torque, "motor_speed": speed}, ((0, N),))
    found = apply_steps(given, "decimate factor=5")
    assert found.step == pytest.approx(5 * STEP) and found.size == N // 5 and found.segments == ((0, N // 5),)
    rise = np.diff(found.signals["motor_speed"])[20:-20]
    np.testing.assert_allclose(rise, found.signals["motor_torque"][20:-21] * found.step, atol=2e-6)
    assert np.std(rise) > 3e-4


def test_differentiate_turns_an_angle_into_a_speed():
    found = apply_steps(experiment(motor_angle=TIME**2, motor_torque=TIME), "differentiate")
    assert set(found.signals) == {"motor_torque", "motor_speed"}
    inside = np.isfinite(found.signals["motor_speed"])
    np.testing.assert_allclose(found.signals["motor_speed"][inside], 2 * TIME[inside], rtol=1e-9, atol=1e-9)
    assert inside.sum() == N - 4


def keep_and_omit(*texts, **signals):
    """An experiment of a recording of which parts are kept or omitted."""
    units = {"torque": "Nm", "speed": "rad/s", "angle": "rad"}
    channels = {role: (TIME, values, units[role.rpartition("_")[2]]) for role, values in signals.items()}
    return build_experiment(recording(**channels), None, [parse_step(text) for text in texts])


def test_parts_that_are_kept_make_up_the_recording_and_what_is_omitted_is_gone():
    given = {"motor_speed": TIME**2, "motor_torque": TIME}
    parts = [keep_and_omit("keep to=1.2", **given), keep_and_omit("keep from=1.2", **given)]
    for role, values in given.items():
        np.testing.assert_array_equal(np.concatenate([part.signals[role] for part in parts]), values)
    assert [part.segments for part in parts] == [((0, 1200),), ((0, 1800),)]
    assert parts[1].start == parts[1].offset == pytest.approx(1.2)
    left = keep_and_omit("omit from=1.2 to=1.3", **given)
    assert left.segments == ((0, 1200), (1300, N))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(left.signals["motor_speed"])), np.arange(1200, 1300))
    # Less than what a lost sample bridges is left out all the same, and the motion starts anew.
    little = keep_and_omit("omit from=1.2 to=1.202", **given)
    assert little.segments == ((0, 1200), (1202, N))
    # Seconds are the recording's, whatever was cut off before.
    both = keep_and_omit("keep from=1", "omit from=1.2 to=1.3", **given)
    assert both.segments == ((0, 200), (300, 2000))
    assert [f.text for f in keep_and_omit("keep to=1.2", **given).findings] == [
        "log.mcap: keep from=0 to=1.2: 1200 of 3000 samples kept."]


def test_a_held_command_acts_on_in_a_part_that_is_kept():
    values = np.arange(30.0)
    log = recording(motor_torque=(TIME[::100], values, "Nm"), motor_speed=(TIME, np.sin(TIME), "rad/s"))
    found = build_experiment(log, None, [parse_step("keep from=1.234 to=2")])
    assert found.segments == ((0, 766),) and found.offset == pytest.approx(1.234)
    np.testing.assert_array_equal(found.signals["motor_torque"], np.repeat(values, 100)[1234:2000])


def test_a_part_of_a_coarse_clock_keeps_all_its_samples():
    fine = np.arange(8000) * 2.5e-4
    stamps = np.floor(fine / 1e-3 + 1e-6) * 1e-3
    held_torque, speed = np.repeat(np.random.default_rng(2).normal(size=200), 40), np.cos(9 * fine)
    log = recording(motor_torque=(stamps, held_torque, "Nm"), motor_speed=(stamps, speed, "rad/s"))
    found = build_experiment(log, None, [parse_step("keep from=0.3003 to=1.9")])
    assert sorted(codes(found)) == ["clock-corrected", "conditioned"] and found.step == pytest.approx(2.5e-4)
    assert found.segments == ((0, found.size),) and abs(found.size - 6400) <= 8
    # A torque on a clock of its own is not taken for rows that were logged twice.
    alone = recording(motor_torque=(stamps[:-40], held_torque[:-40], "Nm"), motor_speed=(stamps, speed, "rad/s"))
    assert "time-stamps-invalid" not in codes(build_experiment(alone))


@pytest.mark.parametrize(("late", "parts"), [
    (lambda time: time - 9.0, ["keep to=2.4"]),
    (lambda time: np.full(len(time), np.nan), ["keep to=2.4", "omit from=2.4 to=9"]),
    (lambda time: time + 1e9, ["keep to=2.4"]),
    (lambda time: np.repeat(time[:1], len(time)), ["keep to=2.4", "omit from=2.4 to=9"]),
])
def test_a_part_that_is_left_out_is_not_checked(late, parts):
    speed = np.sin(7 * TIME)
    time = np.concatenate([TIME[:2500], late(TIME[2500:])])
    log = recording(motor_torque=(time, torque()[1], "Nm"), motor_speed=(time, speed, "rad/s"))
    for part in parts:
        found = build_experiment(log, None, [parse_step(part)])
        assert codes(found) == ["conditioned"] and found.segments == ((0, 2400),)
        np.testing.assert_array_equal(found.signals["motor_speed"], speed[:2400])


@pytest.mark.slow
def test_an_inertia_is_what_it_is_beside_a_part_that_is_omitted():
    torque = np.sign(np.sin(7.0 * TIME))
    speed = np.concatenate([[0.0], np.cumsum(torque)[:-1]]) * STEP / 0.5
    speed += 1e-4 * np.random.default_rng(4).normal(size=N)
    speed[1400:1600] += np.linspace(0.0, 1.0, 200)  # a hand on the shaft
    speed[1600:] += 1.0
    start = one_body("Nm", "rad").with_values({"motor.inertia": 0.4})

    def fitted_inertia(*steps):
        given = keep_and_omit(*steps, motor_torque=torque, motor_speed=speed)
        lines = {p.name: p for p in greybox([given], start, Options()).parameters}
        return lines["motor.inertia"]

    found = fitted_inertia("omit from=1.39 to=1.61")
    assert abs(found.value - 0.5) < 3.0 * found.std and found.std < 1e-3
    whole = fitted_inertia()
    assert whole.status == "not-identifiable" or whole.std > 3.0 * found.std


@pytest.mark.parametrize(("text", "words"), [
    ("smooth", ["'smooth'", "despike"]), ("lowpas cutoff=3", ["Did you mean 'lowpass'"]),
    ("lowpass", ["cutoff for lowpass", "lowpass cutoff=5"]), ("lowpass cutoff=x", ["a number", "'x'"]),
    ("omit from=3", ["to for omit"]), ("keep from=-1", ["'-1'"]),
    ("lowpass cutoff=-3", ["'-3'"]), ("decimate factor=1.5", ["whole number", "'1.5'"]),
    ("despike windw=3", ["Did you mean 'window'"]), ("lowpass cutoff=5 roles=motor_speed", ["roles=motor_speed"]),
    ("detrend roles=motor_sped", ["Did you mean 'motor_speed'"]),
])
def test_mistakes_in_a_step(text, words):
    with pytest.raises(BadOption) as caught:
        parse_step(text)
    for word in words:
        assert word in str(caught.value)
    with pytest.raises(BadOption):
        channel_map({"motor_torque": "x"}, condition=[text])


@pytest.mark.parametrize(("text", "kind", "words"), [
    ("lowpass cutoff=500", BadOption, ["below half the rate, 500 Hz"]),
    ("decimate factor=100", NotEnoughData, ["at least 50 samples"]),
    ("keep to=0.02", NotEnoughData, ["at least 50 samples", "keep from=0 to=0.02"]),
    ("omit from=0 to=3", NotEnoughData, ["at least 50 samples"]),
    ("keep from=3.5", BadOption, ["within 0 to 3 s", "keep from=3.5"]),
    ("omit from=2 to=1", BadOption, ["from before to"]),
    ("differentiate", BadOption, ["an angle without a speed"]),
    ("despike roles=load_speed", BadOption, ["role load_speed", "motor_torque"]),
])
def test_steps_that_do_not_fit_the_record(text, kind, words):
    with pytest.raises(kind) as caught:
        condition(keep_and_omit(text, motor_torque=TIME, motor_speed=TIME), [parse_step(text)])
    for word in words:
        assert word in str(caught.value)


def test_steps_of_the_map_come_first_and_nothing_is_changed_in_place(tmp_path):
    import pyarrow.parquet as pq

    columns = {"motor_torque": np.sign(np.sin(np.arange(900) / 30)), "motor_speed": motion(900)[0]}
    pq.write_table(wide(columns), tmp_path / "a.parquet")
    given = channel_map({role: role for role in columns}, condition=["despike"])
    found = open_experiment(tmp_path / "a.parquet", given, ["lowpass cutoff=300"])
    assert [f.evidence["step"] for f in found.findings if f.code == "conditioned"] == ["despike", "lowpass"]
    assert not found.signals["motor_speed"].flags.writeable
    plain = open_experiment(tmp_path / "a.parquet")
    assert plain.signals["motor_speed"].tobytes() == columns["motor_speed"].tobytes()


# --- speeds made of counts

@pytest.mark.parametrize("noise", [0.0, 2e-4])
def test_a_speed_made_of_counts_is_reported_and_its_sum_is_the_angle(noise):
    rng, count = np.random.default_rng(7), 2.0 * np.pi / 4096
    time = np.arange(6000) * 1e-3
    angle = 0.4 * np.sin(9.0 * time) + 3.0 * time + noise * rng.standard_normal(len(time))
    rounded = count * np.round(angle / count)
    speed = np.diff(rounded, prepend=rounded[0]) / 1e-3
    made = recording(motor_torque=(time, np.sin(time), "Nm"), motor_speed=(time, speed, "rad/s"))
    found = build_experiment(made)
    assert codes(found) == ["quantised-speed"]
    assert found.findings[0].evidence["count"] == pytest.approx(count, rel=1e-6)
    summed = condition(found, [parse_step("integrate")])
    assert "motor_speed" not in summed.signals
    np.testing.assert_allclose(summed.signals["motor_angle"], rounded - rounded[0], atol=1e-9)


def test_a_rounded_speed_is_not_made_of_counts():
    time = np.arange(6000) * 1e-3
    speed = 3.6 * np.cos(9.0 * time) + 3.0
    for noise, size in ((0.0, 0.05), (0.02, 0.05), (0.2, 0.05)):
        noisy = speed + noise * np.random.default_rng(8).standard_normal(len(time))
        found = build_experiment(recording(motor_torque=(time, np.sin(time), "Nm"),
                                           motor_speed=(time, size * np.round(noisy / size), "rad/s")))
        assert "quantised-speed" not in codes(found)


def test_what_cannot_be_integrated_is_said():
    with pytest.raises(BadOption, match="a speed in"):
        condition(experiment(motor_torque=np.zeros(100), motor_angle=np.arange(100.0)), [parse_step("integrate")])
    speed = np.ones(100)
    speed[40] = np.nan
    with pytest.raises(BadOption, match="1 missing"):
        condition(experiment(motor_torque=np.zeros(100), motor_speed=speed), [parse_step("integrate")])
