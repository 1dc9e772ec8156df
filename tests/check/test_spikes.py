"""Single wrong values against what a drive does by itself: corners, ringing, noise."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.faults.spikes import spikes, with_outliers_restored, without_model_outliers, without_outliers
from drivetool.logs import Experiment
from tests.recover import one_sensor

STEP, SIZE, NOISE = 1e-3, 4000, 0.02
TIME = np.arange(SIZE) * STEP


def corners():
    """Speed under torque steps: straight up and down, a corner every 0.4 s, 1.5 per sample steep."""
    return 300.0 * np.abs((TIME + 0.2) % 0.8 - 0.4) * 5.0


def ringing():
    """A shaft that rings with a period of five samples from every half second on."""
    since = TIME % 0.5
    return 40.0 * np.exp(-since / 0.03) * np.sin(2.0 * np.pi * 200.0 * since)


@pytest.mark.parametrize("signal", [corners, ringing])
@pytest.mark.parametrize("seed", range(5))
def test_what_a_drive_does_is_no_spike(signal, seed):
    y = signal() + NOISE * np.random.default_rng(seed).standard_normal(SIZE)
    assert len(spikes(y)[0]) == 0


def test_a_step_of_the_logger_is_no_spike_and_what_is_far_more_is_one():
    """Steps of four times the noise on a slope: now and then a single sample lies on another level."""
    step = 4.0 * NOISE
    y = 900.0 * step * np.abs((TIME + 0.5) % 2.0 - 1.0) + NOISE * np.random.default_rng(3).standard_normal(SIZE)
    assert len(spikes(np.round(y / step) * step)[0]) == 0
    y[[1700, 2600]] += 40.0 * step
    assert list(spikes(np.round(y / step) * step)[0]) == [1700, 2600]


@pytest.mark.parametrize("at", [[700], [700, 702], [700, 703, 1900], [150, 2222, 3800]])
def test_spikes_are_found_alone_and_in_pairs(at):
    y = np.sin(2.0 * np.pi * TIME) + NOISE * np.random.default_rng(1).standard_normal(SIZE)
    y[at] += 40.0 * NOISE * np.resize([1.0, -1.0], len(at))
    assert list(spikes(y)[0]) == at


def test_what_is_spared_stays_and_what_was_left_out_comes_back_on_its_scale():
    y = np.sin(2.0 * np.pi * TIME) + NOISE * np.random.default_rng(2).standard_normal(SIZE)
    y[[700, 1900]] += 1.0
    e = Experiment("r", "0" * 64, STEP, 0.0, {"motor_torque": np.zeros(SIZE), "motor_speed": y}, ((0, SIZE),),
                   "Nm", "rad", "command", ())
    mended, (finding,) = without_outliers(e, {"motor_speed": [700]})
    assert finding.code == "outliers" and finding.evidence["count"] == 1
    assert list(np.flatnonzero(np.isnan(mended.signals["motor_speed"]))) == [1900]
    halved = replace(mended, signals={**mended.signals, "motor_speed": 0.5 * mended.signals["motor_speed"]})
    (whole,) = with_outliers_restored([halved], [e])
    np.testing.assert_allclose(whole.signals["motor_speed"], 0.5 * y, rtol=1e-12)


def outliers_of(seed, **options):
    """Samples that a fitted base finds impossible; none of them stands out from its neighbours."""
    base, _ = one_sensor(seed, 2e-5, **options)
    (record,), findings = without_model_outliers(base, base.task.experiments)
    logged = base.task.experiments[0].signals["motor_speed"]
    assert len(spikes(logged)[0]) == 0
    out = list(np.flatnonzero(np.isfinite(logged) & ~np.isfinite(record.signals["motor_speed"])))
    assert [f.evidence["count"] for f in findings] == [len(out)] * bool(out)
    noise = 1e-3 * np.nanmax(np.abs(logged))  # as the record was made
    for f in findings:
        assert f.evidence["noise_std"] == pytest.approx(noise, rel=0.05)
        height = max(map(abs, options["spikes"].values()))
        assert f.evidence["largest"] == pytest.approx(height * noise, abs=3.0 * noise)
    return out


@pytest.mark.parametrize("seed", [20, 23])
def test_what_a_model_finds_impossible_is_left_out_and_what_went_on_is_not(seed):
    """A sensor that is wrong by seven times its noise, and a speed that did change by as much."""
    assert outliers_of(seed, spikes={1000: 7.5, 2500: -8.0}) == [1000, 2500]
    assert outliers_of(seed, speed_steps={1000: 7.5, 2500: -8.0}) == []
    assert outliers_of(seed) == []
    assert outliers_of(seed, spikes={1: 9.0}) == []  # what acted before the record is not known
