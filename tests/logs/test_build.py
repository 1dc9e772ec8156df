"""The one door: grids, gaps, missing values and what is refused."""

import numpy as np
import pytest

from drivetool.errors import BadRecording, NotEnoughData
from drivetool.logs.channels.channel_map import SCHEMA, ChannelMap
from drivetool.logs.door.build import build_experiment
from drivetool.logs.experiment import Channel, Recording

N, STEP = 300, 0.001
UNITS = {"torque": "Nm", "speed": "rad/s", "angle": "rad"}


def recording(times=None, units=None, **signals):
    """Signals on one clock, or on their own where `times` has one."""
    shared = np.arange(len(next(iter(signals.values())))) * STEP
    channels = {}
    for name, values in signals.items():
        unit = (units or {}).get(name, UNITS[name.rpartition("_")[2]])
        channels[name] = Channel((times or {}).get(name, shared), np.asarray(values, dtype=float), unit)
    return Recording("log.parquet", "0" * 64, channels)


def sine(n=N, f=3.0):
    return np.sin(2 * np.pi * f * np.arange(n) * STEP)


def codes(experiment):
    return [f.code for f in experiment.findings]


def one_clock(time, torque=None, **more):
    n = len(time)
    torque = sine(n) if torque is None else torque
    return recording({"motor_torque": time, **dict.fromkeys(more, time)}, motor_torque=torque, **more)


def test_jitter_below_five_percent_is_taken_as_it_is():
    rng = np.random.default_rng(1)
    time = np.arange(N) * STEP + rng.uniform(-0.045, 0.045, N) * STEP
    found = build_experiment(one_clock(time, motor_speed=sine()))
    assert found.signals["motor_speed"].tobytes() == sine().tobytes()
    assert found.segments == ((0, N),) and codes(found) == []
    assert found.step == pytest.approx(STEP, rel=1e-3)


def test_jitter_above_five_percent_is_resampled():
    rng = np.random.default_rng(1)
    time = np.arange(N) * STEP + rng.uniform(-0.2, 0.2, N) * STEP
    speed = np.sin(2 * np.pi * 3 * time)
    found = build_experiment(one_clock(time, motor_speed=speed))
    assert codes(found) == ["resampled"]
    at = found.start + found.time
    inside = np.isfinite(found.signals["motor_speed"])
    assert inside.mean() > 0.99
    truth = np.sin(2 * np.pi * 3 * at)
    np.testing.assert_allclose(found.signals["motor_speed"][inside], truth[inside], atol=1e-4)
    assert set(found.signals["motor_torque"]) <= set(sine())


@pytest.mark.parametrize(("every", "late"), [(2, 0.0003), (10, 0.0002), (1, 0.0007)])
def test_a_sensor_keeps_its_clock_and_the_torque_its_impulse(every, late):
    slow = np.arange(0, N, every) * STEP + late
    speed = np.sin(2 * np.pi * 3 * slow)
    found = build_experiment(recording({"motor_speed": slow}, motor_torque=sine(), motor_speed=speed))
    assert "resampled" in codes(found) and found.step == pytest.approx(STEP)
    known = np.flatnonzero(np.isfinite(found.signals["motor_speed"]))
    np.testing.assert_array_equal(found.signals["motor_speed"][known], speed[:len(known)])
    assert set(np.diff(known)) == {every} and len(known) > N // every - 2
    torque, share = found.signals["motor_torque"], late / STEP
    first, last = found.segments[0]
    mixed = (1 - share) * sine()[:-1] + share * sine()[1:]
    np.testing.assert_allclose(torque[first:last - 1], mixed[first:last - 1], atol=1e-9)


def test_a_second_sensor_that_is_slow_is_not_interpolated_far():
    slow = np.arange(0, N, 10) * STEP + 0.0002
    found = build_experiment(recording({"load_speed": slow}, motor_torque=sine(), motor_speed=sine(),
                                       load_speed=np.sin(2 * np.pi * 3 * slow)))
    known = np.flatnonzero(np.isfinite(found.signals["load_speed"]))
    assert set(np.diff(known)) == {10}
    assert codes(found) == ["resampled", "resampled"]
    np.testing.assert_allclose(found.signals["load_speed"][known], sine()[known], atol=1e-3)
    # Nor is one of a third of the rate filled up.
    third = np.arange(0, N, 3) * STEP + 0.0002
    found = build_experiment(recording({"load_speed": third}, motor_torque=sine(), motor_speed=sine(),
                                       load_speed=np.sin(2 * np.pi * 3 * third)))
    assert np.isfinite(found.signals["load_speed"]).sum() <= len(third)


def test_a_slow_input_is_held():
    slow = np.arange(0, N, 10) * STEP
    values = np.arange(30.0)
    found = build_experiment(recording({"load_torque": slow}, motor_torque=sine(), load_torque=values))
    np.testing.assert_array_equal(found.signals["load_torque"], np.repeat(values, 10))


def test_gaps_split_and_single_losses_do_not():
    keep = np.ones(N, dtype=bool)
    keep[[50, 51, 120]] = False
    keep[200:240] = False
    time = (np.arange(N) * STEP)[keep]
    found = build_experiment(one_clock(time, sine()[keep], motor_speed=sine()[keep]))
    assert found.segments == ((0, 200), (240, N))
    assert sorted(codes(found)) == ["recording-interrupted", "samples-missing"]
    gap = next(f for f in found.findings if f.code == "recording-interrupted")
    assert gap.evidence["gaps"] == 1 and gap.evidence["longest"] == pytest.approx(0.041)
    speed, torque = found.signals["motor_speed"], found.signals["motor_torque"]
    assert np.array_equal(speed[keep], sine()[keep]) and np.all(np.isnan(speed[~keep]))
    assert torque[50] == torque[51] == sine()[49] and torque[120] == sine()[119]


def test_a_slowly_drifting_clock_is_uniform():
    time = np.arange(20_000) * STEP
    time = time + 1e-4 * time**2
    found = build_experiment(one_clock(time, sine(20_000), motor_speed=sine(20_000)))
    assert codes(found) == [] and found.size == 20_000


def test_missing_sensor_values_stay_missing():
    speed = sine()
    speed[[10, 11]] = np.nan
    speed[100] = np.inf
    found = build_experiment(recording(motor_torque=sine(), motor_speed=speed))
    assert list(np.flatnonzero(np.isnan(found.signals["motor_speed"]))) == [10, 11, 100]
    assert found.findings[0].code == "samples-missing"
    assert found.findings[0].evidence["share"] == pytest.approx(0.01)
    assert found.segments == ((0, N),)


def test_a_value_that_is_missing_is_what_a_row_is_that_is_missing():
    # Two in a row are the everyday loss and held over; three are a gap.
    for lost, segments in ([100, 101, 106], ((0, N),)), ([100, 101, 102, 106], ((0, 100), (103, N))):
        torque, keep = sine(), np.delete(np.arange(N), lost)
        torque[lost] = np.nan
        found = build_experiment(recording(motor_torque=torque, motor_speed=sine()))
        assert found.segments == segments
        assert "samples-missing" in codes(found) and ("torque-missing" in codes(found)) == (len(segments) == 2)
        rows = build_experiment(one_clock(keep * STEP, sine()[keep], motor_speed=sine()[keep]))
        assert rows.segments == segments
        for first, last in segments:
            np.testing.assert_array_equal(rows.signals["motor_torque"][first:last],
                                          found.signals["motor_torque"][first:last])


@pytest.mark.parametrize(("torn", "severity"), [(100, "note"), (900, "warning")])
def test_a_warning_says_where_most_of_a_record_is_left_out(torn, severity):
    n = 1200
    there = (np.arange(n) % 13 < 9) | (np.arange(n) >= torn)  # pieces of 9 samples, and a whole rest
    found = build_experiment(recording(motor_torque=np.where(there, sine(n), np.nan), motor_speed=sine(n)))
    finding = next(f for f in found.findings if f.code == "recording-interrupted")
    used = sum(b - a for a, b in found.segments)
    assert finding.severity == severity and finding.evidence["samples"] + used == finding.evidence["of"]


def test_repeated_stamps_are_dropped():
    time = np.insert(np.arange(N) * STEP, 40, 0.039)
    values = np.insert(sine(), 40, 99.0)
    found = build_experiment(one_clock(time, values, motor_speed=values))
    assert codes(found) == ["time-stamps-invalid"]
    assert found.signals["motor_speed"].tobytes() == sine().tobytes()


def test_stamps_beyond_all_time_are_missing_or_refused():
    time = np.arange(N) * STEP
    time[[7, 50]] = 1e300, -np.inf
    found = build_experiment(one_clock(time, motor_speed=sine()))
    assert codes(found)[0] == "time-stamps-invalid" and found.findings[0].evidence["samples"] == 2
    time[50] = 50 * STEP
    time[N - 1] = 1e14
    with pytest.raises(BadRecording, match="one stretch of time"):
        build_experiment(one_clock(time, motor_speed=sine()))


def test_linear_axis_and_current():
    units = {"motor_torque": "kN", "motor_speed": "mm/s", "motor_angle": "mm"}
    angle = np.cumsum(sine()) * STEP
    found = build_experiment(recording(units=units, motor_torque=sine(), motor_speed=sine(),
                                       motor_angle=angle))
    assert (found.torque_unit, found.motion_unit) == ("N", "m")
    np.testing.assert_allclose(found.signals["motor_torque"], 1000 * sine())
    coast = build_experiment(recording(units={"motor_speed": "m/s"}, motor_speed=sine()))
    assert (coast.torque_unit, coast.motion_unit) == ("N", "m")
    odd = build_experiment(recording(units={"motor_torque": "N"}, motor_torque=sine(), motor_speed=sine()))
    assert codes(odd) == ["units-mixed"]


def test_a_table_may_move_in_other_units():
    found = build_experiment(recording(units={"table_speed": "mm/s"}, motor_torque=sine(), motor_speed=sine(),
                                       table_speed=sine()))
    assert found.motion_unit == "rad"


def back_in_time():
    time = np.arange(N) * STEP
    time[150:] -= 0.05
    return one_clock(time, motor_speed=sine())


def percent():
    return recording(units={"shaft_torque": "%"}, motor_torque=sine(), shaft_torque=sine())


BAD = {
    "backwards": (back_in_time, BadRecording,
                  ["time that does not go backwards", "after sample 149 at 0.149000 s", "-0.049 s"]),
    "mixed motion": (lambda: recording(units={"load_angle": "m"}, motor_torque=sine(), motor_speed=sine(),
                                       load_angle=sine()), BadRecording,
                     ["one unit of motion", "motor_speed in rad", "load_angle in m"]),
    "mixed torque": (lambda: recording(units={"shaft_torque": "A"}, motor_torque=sine(), shaft_torque=sine()),
                     BadRecording, ["one unit of torque", "motor_torque in Nm", "shaft_torque in A"]),
    "all missing": (lambda: recording(motor_torque=sine(), motor_speed=np.full(N, np.nan)), BadRecording,
                    ["values of motor_speed", "none"]),
    "no overlap": (lambda: recording({"motor_speed": 1e6 + np.arange(N) * STEP}, motor_torque=sine(),
                                     motor_speed=sine()), BadRecording, ["motor_torque", "do not overlap"]),
    "unit": (lambda: recording(units={"motor_speed": None}, motor_torque=sine(), motor_speed=sine()),
             BadRecording, ["unit of speed for motor_speed", "rpm"]),
    "percent": (percent, BadRecording, ["rated value of shaft_torque"]),
    "two inputs": (lambda: recording(units={"motor_torque": "A", "motor2_torque": "V"}, motor_torque=sine(),
                                     motor2_torque=sine(), shaft_torque=sine()),
                   BadRecording, ["one unit of torque", "motor_torque in A", "motor2_torque in V"]),
    "vast": (lambda: one_clock(np.concatenate([np.arange(150) * STEP, 1e7 + np.arange(150) * STEP])),
             BadRecording, ["one stretch of time", "Cut the record"]),
    "constant": (lambda: recording(motor_torque=np.ones(N), motor_speed=np.zeros(N)), NotEnoughData,
                 ["torque or a motion that changes", "motor_speed, motor_torque", "excited"]),
    "constant speed": (lambda: recording(motor_speed=np.ones(N)), NotEnoughData, ["changes"]),
    "short": (lambda: recording(motor_torque=sine(49), motor_speed=sine(49)), NotEnoughData,
              ["at least 50 samples", "found 49"]),
    "one sample": (lambda: recording(motor_torque=[1.0]), NotEnoughData, ["motor_torque", "1"]),
    "no sample": (lambda: recording(motor_torque=[]), BadRecording, ["motor_torque", "none"]),
    "pieces": (lambda: recording(motor_torque=np.where(np.arange(N) % 12 > 2, sine(), np.nan), motor_speed=sine()),
               NotEnoughData, ["without a gap", "found 0"]),
}


@pytest.mark.parametrize("case", BAD)
def test_refused(case):
    make, kind, words = BAD[case]
    with pytest.raises(kind) as caught:
        build_experiment(make())
    for word in words:
        assert word in str(caught.value)


def test_one_constant_signal_is_a_finding():
    found = build_experiment(recording(motor_torque=np.zeros(N), motor_speed=sine()))
    assert codes(found) == ["constant-signal"] and found.findings[0].severity == "warning"


def test_the_recording_is_not_changed():
    log = recording(motor_torque=sine(), motor_speed=sine())
    build_experiment(log)
    assert all(channel.values.flags.writeable for channel in log.channels.values())
    assert log.channels["motor_speed"].values.tobytes() == sine().tobytes()


def test_map_formula():
    content = {"schema": SCHEMA, "roles": {
        "motor_torque": {"channel": "motor_torque", "unit": "mNm", "scale": 4, "offset": 8, "sign": -1}},
        "torque_is": "measurement"}
    found = build_experiment(recording(motor_torque=sine()), ChannelMap.from_mapping(content))
    np.testing.assert_allclose(found.signals["motor_torque"], -(4 * sine() + 8) * 1e-3, rtol=1e-15)
    assert found.torque_is == "measurement"


@pytest.mark.parametrize("size", [0.2, 0.3])
def test_late_stamps_are_no_lost_samples(size):
    n = 2000
    time = np.sort((np.arange(n) + size * np.random.default_rng(3).standard_normal(n)) * STEP)
    found = build_experiment(one_clock(time, motor_speed=np.sin(2 * np.pi * 3 * time)))
    assert found.step == pytest.approx(STEP, rel=1e-4) and codes(found) == ["resampled"]


def test_samples_lost_under_jitter_are_counted():
    n = 2000
    lost = [400, 1100, 1101, 1500]
    time = np.delete((np.arange(n) + 0.008 * np.random.default_rng(3).standard_normal(n)) * STEP, lost)
    found = build_experiment(one_clock(time, motor_speed=np.sin(2 * np.pi * 3 * time)))
    assert found.step == pytest.approx(STEP, rel=1e-4)
    assert next(f for f in found.findings if f.code == "samples-missing").evidence["samples"] == len(lost)
