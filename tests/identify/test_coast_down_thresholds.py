"""Every threshold of a coast-down where it is: half of it and double of it fail what it is there for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.errors import BadRecording, NotEnoughData
from drivetool.finding import Finding
from drivetool.identify.coast_down import laws, readings, report, stretches
from drivetool.identify.coast_down.coast_down_fit import CoastDownFit
from tests.coasting import RPM, STEP, Motor, counts, motion, recording

COUNT = 2.0 * np.pi / 1000


def off(experiment):
    """The stretches without torque; none where it is refused."""
    try:
        return [s for s in stretches.stretches_of([experiment], 0.0) if s.off]
    except NotEnoughData:
        return []


def falling(first, last, size=4000, noise=0.0):
    """A speed that falls in a straight line."""
    return np.linspace(first, last, size) + noise * np.random.default_rng(1).standard_normal(size)


def coasting():
    """A controller holds the speed within 1 % until the drive is switched off: there the coast-down begins."""
    k, fast = 4000, 2000 * RPM
    held = fast * (1.0 + 0.01 * np.sin(2.0 * np.pi * 3.0 * STEP * np.arange(k)))
    (stretch,) = off(recording(1, motor_speed=np.concatenate([held, motion(Motor(), lambda t: 0.0, fast, 80 * RPM,
                                                                          5.0)[1]])))
    assert k <= stretch.first
    assert stretch.first < k + 500  # within 4 % of the speed


def falls():
    """What loses 0.7 % of its speed is held by something, such as a controller; 1.5 % are a coast-down."""
    zero = np.zeros(4000)
    assert not off(recording(1, motor_speed=falling(100.0, 99.2), motor_torque=zero))
    assert off(recording(1, motor_speed=falling(100.0, 98.3), motor_torque=zero))


def steps():
    """A speed of 3.5 standard deviations of its noise is none; one of seven is."""
    zero = np.zeros(4000)
    assert not off(recording(1, motor_speed=falling(4.0, 3.0, noise=1.0), motor_torque=zero))
    assert off(recording(1, motor_speed=falling(8.0, 6.0, noise=1.0), motor_torque=zero))


def least():
    """Less than fifty samples are not enough; seventy are a coast-down."""
    speed, driven = np.concatenate([np.full(4000, 100.0), falling(100.0, 60.0, 70)]), np.arange(4070) < 4000
    found = recording(1, motor_speed=speed, motor_torque=0.1 * driven)
    assert len(off(found)) == 1
    found = recording(1, motor_speed=speed[:-35], motor_torque=0.1 * driven[:-35])
    assert not off(found)


def noise():
    """A hundred thousand samples of noise are no torque; a torque of seven standard deviations is one."""
    n = 100_000
    torque = np.random.default_rng(2).standard_normal(n)
    speed = falling(200.0, 20.0, n)
    (stretch,) = off(recording(1, motor_speed=speed, motor_torque=torque))
    assert (stretch.first, stretch.last) == (0, n)
    (stretch,) = off(recording(1, motor_speed=speed, motor_torque=torque + 7.0 * (np.arange(n) < n // 2)))
    assert n // 2 - stretches.MIN_COAST_DOWN_SAMPLES <= stretch.first < n // 2 + 10


def register():
    """A jump misses what the motor turns in a sample: 4067 is that of twelve digits, 1010 is of none."""
    for size, wrap in ((4067, "4096"), (1010, "1010")):
        jump = Finding("warning", "value-wraps", "", {"role": "motor_angle", "jumps": 3, "size": size})
        e = recording(1, motor_angle=np.arange(4000.0))
        with pytest.raises(BadRecording, match=f"wrap: {wrap}`"):
            stretches.stretches_of([replace(e, findings=(jump,))], 0.0)


def around():
    """Fifteen counts place no start of a fit; twenty-five do."""
    for size, enough in ((15, False), (25, True)):
        angle = np.repeat(np.arange(size + 1.0), 40) * COUNT
        try:
            readings.reading_of(recording(1, motor_angle=angle), 0, len(angle))
            assert enough
        except BadRecording:
            assert not enough


def counted():
    """Noise of a third of a step lets the steps show; of 0.7 steps it hides them."""
    angle, _ = motion(Motor(), lambda t: 0.0, 2240 * RPM, 80 * RPM, 5.0)
    for share, counter in ((0.3, True), (0.7, False)):
        blurred = angle + share * COUNT * np.random.default_rng(1).standard_normal(len(angle))
        e = recording(1, motor_angle=counts(blurred, 1))
        assert (readings.reading_of(e, 0, e.size).count > 0.0) is counter


def locked():
    """Samples about one count each: those kept err as if by chance, and no more are left out than that needs."""
    change, n = 1e-6, 40_000
    k = np.arange(n) - n // 2
    left_out = readings._phase_locked(1.0 - change * k)
    rng, sums = np.random.default_rng(1), []
    for _ in range(400):
        places = np.mod(rng.uniform() - 0.5 * change * (k - rng.uniform(-0.5, 0.5)) ** 2, 1.0)
        sums.append(float(np.sum(places[~left_out] - 0.5)))
    assert np.var(sums) < np.sum(~left_out) / 12.0  # the weights take them for independent
    assert left_out.mean() < 0.15


def lasting():
    """Fourteen samples that see one part of a count are few; thirty in a row are left out."""
    k = np.arange(400) - 200
    assert not readings._phase_locked(1.0 - k / 14.0**2)[np.abs(k) < 50].any()
    assert readings._phase_locked(1.0 - k / 30.0**2).any()


def identified():
    """A surplus 1.4 of its standard deviations from zero is a guess; one that is 2.5 away is identified."""
    for share, guess in ((0.7, True), (0.4, False)):
        fitted = CoastDownFit(("motor.drag",), np.ones(1), np.array([[share**2]]), np.ones((1, 1)), (), (),
                              np.ones(1),
                              np.ones(1), 1.0, 1)
        assert report.unidentified("motor.drag", ("motor.drag",), fitted) is guess


def said(misfit=1.0, together=None):
    """The findings of a coast-down, by code."""
    fitted = SimpleNamespace(misfit=misfit, names=())
    spread = report.CoastDownScatter(1.0, {"together": together} if together else {}, np.zeros((1, 1)))
    return {f.code: f
            for f in report.coast_down_findings(fitted, fitted, [], [], ("a known added inertia",), spread, None)}


def unlikely():
    """A rest that chance leaves seven times in ten thousand is another law; fifteen times is chance."""
    assert "nonlinear-friction" in said(7e-4)
    assert "nonlinear-friction" not in said(1.5e-3)


def heated():
    """Friction that changes by 80 or -40 % may be warmth; by 120 or -60 % an inertia is wrong."""
    for together, warm in ((80.0, True), (-40.0, True), (120.0, False), (-60.0, False)):
        assert ("temperature" in said(together=together)["scatter-beyond-noise"].action) is warm


def lead():
    """A law that leads by a log likelihood of 15 is named, one that leads by 7 is not, nor is it beaten by that."""
    def named(*ahead):
        left = iter(ahead)
        fitted = SimpleNamespace(deviance=0.0, misfit=0.0)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(laws, "_trial", lambda names, *_: laws._Trial(
                names, -next(left, 0.0), one_body(), SimpleNamespace(misfit=1.0)))
            patch.setattr(laws, "_angle_errors", lambda *_: np.random.default_rng(1).standard_normal(300))
            found = laws.further_law(one_body(), (), (), None, fitted)
        return found.laws if found else ()
    assert named(15.0) == (("drag",),)
    assert named(7.0) == ()
    assert named(0.0, 57.0, 50.0) == (("stribeck",), ("breakaway",))
    assert named(0.0, 65.0, 50.0) == (("stribeck",),)


CHECKS = {(stretches, "START_SPEED_SHARE"): coasting, (stretches, "MIN_SPEED_LOSS"): falls,
          (stretches, "MIN_MOTION_STEPS"): steps,
          (stretches, "MIN_COAST_DOWN_SAMPLES"): least, (stretches, "OFF_TORQUE_STDS"): noise,
          (stretches, "COUNTER_TOLERANCE"): register,
          (readings, "COUNTS_AROUND"): around, (readings, "MAX_QUANTISED_NOISE"): counted,
          (readings, "LOCKED_RANGE"): locked,
          (readings, "MIN_LOCKED_SAMPLES"): lasting, (report, "MAX_STD_TO_VALUE"): identified,
          (report, "MISFIT_SIGNIFICANCE"): unlikely, (report, "MAX_THERMAL_FACTOR"): heated,
          (laws, "MIN_LAW_LIKELIHOOD_LEAD"): lead}
NAMES = [name for _, name in CHECKS]


@pytest.mark.parametrize("check", CHECKS.values(), ids=NAMES)
def test_it_does_what_it_is_there_for(check):
    check()


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize(("where", "check"), CHECKS.items(), ids=NAMES)
def test_half_and_double_do_not(where, check, factor, monkeypatch):
    module, name = where
    value = getattr(module, name)
    monkeypatch.setattr(module, name, type(value)(factor * value))
    with pytest.raises((AssertionError, ValueError)):
        check()
