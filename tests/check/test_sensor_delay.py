"""A logged speed against the rate of the angle that is logged beside it."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.check.faults.record_faults import record_faults_of
from drivetool.check.faults.sensor_delay import speed_delay
from drivetool.check.full_diagnosis import with_speed_filter, without_excluded_filter
from drivetool.drive import two_mass
from tests.hidden import greybox_options, make_case, write_start
from tests.hidden.command import greybox_and_diagnose, read, run
from tests.recover import experiment

KINDS = [(70001, "closed-loop", "nominal"), (70002, "reversing", "nominal"), (70003, "one-directional", "loud")]


def record(code, seed, kind, noise, size=None):
    sensors = ("motor_speed", "motor_angle")
    signals = dict(make_case(code, seed, kind, sensors, noise, size, seed).records[0].logged)
    return experiment(signals.pop("motor_torque"), signals.pop("motor_speed"), **signals)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "kind", "noise"), KINDS)
def test_the_time_of_a_filter_is_found_within_its_error(seed, kind, noise):
    found = speed_delay(record("speed-filter", seed, kind, noise, size=3.0))
    assert abs(found.lag - 3e-3) < 4.0 * found.std
    assert found.lag > 6.0 * found.std


@pytest.mark.slow
@pytest.mark.parametrize("code", ["none", "converter-lag"])
@pytest.mark.parametrize(("seed", "kind", "noise"), KINDS)
def test_what_delays_both_is_no_lag_of_the_speed(seed, kind, noise, code):
    e = record(code, seed, kind, noise)
    found = speed_delay(e)
    assert abs(found.lag) < 4.0 * found.std
    assert "speed-filter" not in {f.code for f in record_faults_of([e], ["speed-filter"])[1]}


@pytest.mark.slow
def test_a_filter_that_is_found_joins_the_drive_and_one_that_is_not_there_is_ruled_out():
    late, prompt = (record(code, *KINDS[0]) for code in ("speed-filter", "none"))
    _, faults = record_faults_of([late], ["speed-filter"])
    drive, free = with_speed_filter(two_mass(), ["motor.inertia"], faults)
    assert drive.value("sensor.bandwidth") == pytest.approx(500.0, rel=0.1)  # two samples of a millisecond
    assert free == ("motor.inertia", "sensor.bandwidth")
    assert without_excluded_filter(["speed-filter", "dead-time"], [prompt]) == ["dead-time"]


@pytest.mark.slow
def test_a_filter_that_the_base_has_is_not_found_again(tmp_path):
    case = make_case("speed-filter", 70002, "reversing", ("motor_speed", "motor_angle"), "nominal", 3.0, 70002)
    logs, _ = case.write_records(tmp_path)
    words = ["--candidates", "speed-filter,quadratic-drag"]
    first = greybox_and_diagnose(tmp_path, logs, write_start(case, tmp_path), greybox_options(case), words)
    assert (first.verdict, first.causes) == ("named", ("speed-filter",)), first.stderr
    done = run(tmp_path, ["diagnose", *(p.name for p in logs), "--params", "extended.yaml", "--out", "again.yaml",
                          *words])
    again = read(tmp_path / "again.yaml", done.stderr)
    assert (again.verdict, again.causes) == ("nothing-found", ()), again.stderr
    state = {c["code"]: c["state"] for c in again.candidates}
    assert state["speed-filter"] == "in-the-model"


def test_without_an_angle_nothing_is_reported_or_ruled_out():
    e = experiment(np.ones(5000), np.linspace(0.0, 5.0, 5000))
    assert speed_delay(e) is None
    assert without_excluded_filter(["speed-filter", "dead-time"], [e]) == ["speed-filter", "dead-time"]


def test_a_standstill_says_nothing():
    e = experiment(np.ones(5000), np.zeros(5000), motor_angle=np.zeros(5000))
    assert speed_delay(e) is None
