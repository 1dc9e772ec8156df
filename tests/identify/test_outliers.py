"""A few samples that no noise explains do not bias the values, and are reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from tests.recover import drive_like, experiment, linear_record, truth
from tests.simulator.machine import machine_by_seed

MACHINE = machine_by_seed(1)
NAMES = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "total.viscous", "total.idle_torque")
# Where the motion is fast enough to hide them from a look at the sensor alone (outliers-left-out).
OUTLIERS = (1500, 2741, 2742, 4400)


@pytest.fixture(scope="module")
def record():
    return linear_record(MACHINE, 1)


def fitted(record, **options):
    return greybox([record], drive_like(MACHINE, list(NAMES), 0.1), Options(**options))


def with_outliers(record, size):
    speed = record.signals["motor_speed"].copy()
    noise = np.std(np.diff(speed, 2)) / np.sqrt(6.0)
    speed[list(OUTLIERS)] += size * noise * np.array([1.0, 1.0, 1.0, -1.0])
    return replace(record, signals=record.signals | {"motor_speed": speed})


@pytest.mark.slow
def test_outliers_of_a_sensor_are_left_out_and_reported(record):
    clean, found = fitted(record), fitted(with_outliers(record, 20.0))
    assert "outliers-left-out" not in {f.code for f in clean.findings}
    (left,) = [f for f in found.findings if f.code == "outliers-left-out"]
    assert len(OUTLIERS) <= left.evidence["count"] <= 4 * len(OUTLIERS)
    assert set(map(float, left.evidence["instants"].split())) >= {round(k * record.step, 2) for k in OUTLIERS}
    a, b = ({p.name: p for p in e.parameters} for e in (clean, found))
    for name in NAMES[:4]:
        assert abs(a[name].value - b[name].value) < 0.3 * a[name].std, name
        assert b[name].std == pytest.approx(a[name].std, rel=0.1), name
        assert abs(b[name].value - truth(MACHINE)[name]) < 3.0 * b[name].std, name


def test_a_simulation_fit_leaves_nothing_out(record):
    found = fitted(with_outliers(record, 60.0), criterion="simulation", segment=0.0)
    assert "outliers-left-out" not in {f.code for f in found.findings}


def one_body_record(name, noise, outlier=0.0):
    """Five seconds of a body under sines of torque, reversing, its speed with that noise."""
    t, rng = np.arange(5000) * 1e-3, np.random.default_rng([ord(name), round(1e3 * noise)])
    torque = np.sin(3.0 * t) + 0.5 * np.sin(17.0 * t + 1.0)
    acts, speed = torque + 0.03 * rng.standard_normal(t.size), np.zeros(t.size)
    for k in range(t.size - 1):  # exact for a torque that is held over the sample
        decay = np.exp(-0.05 / 0.02 * 1e-3)
        speed[k + 1] = decay * speed[k] + (1.0 - decay) * acts[k] / 0.05
    speed += noise * rng.standard_normal(t.size)
    speed[1232:1234] += outlier
    return experiment(torque, speed, name)


def test_a_recording_with_more_noise_than_the_others_has_no_outliers():
    """A sensor that was noisier on one day has no glitches; one that stands out of that noise is one."""
    start = one_body().with_values({"motor.inertia": 0.015})
    codes = [{f.code: f for f in greybox([one_body_record("a", 0.02), one_body_record("b", 0.02),
                                          one_body_record("c", 0.08, outlier)], start, Options()).findings}
             for outlier in (0.0, 1.2)]
    assert "outliers-left-out" not in codes[0]
    assert codes[1]["outliers-left-out"].evidence == {"count": 2, "instants": "1.23"}


@pytest.mark.slow
def test_many_far_samples_are_no_outliers(record):
    """A tenth of outlying samples is another noise distribution, not a fault of the sensor."""
    speed = record.signals["motor_speed"].copy()
    rng = np.random.default_rng(5)
    at = rng.random(record.size) < 0.05
    speed[at] += 60.0 * np.std(np.diff(speed, 2)) / np.sqrt(6.0) * rng.standard_normal(at.sum())
    found = fitted(replace(record, signals=record.signals | {"motor_speed": speed}))
    assert "outliers-left-out" not in {f.code for f in found.findings}
