"""Validation on coast-downs without torque: the angle in counts, the speed over its range and over its mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from msgspec import UNSET

from drivetool.check.validation.coast_down_validation import (
    MAX_ERROR_TO_COUNTS,
    CoastDownModel,
    validate_coast_down,
)
from drivetool.check.validation.result import ValidateOptions
from drivetool.drive import one_body, two_mass
from drivetool.errors import BadOption, BadParameters, NotEnoughData
from drivetool.identify.estimate import Covariance
from drivetool.identify.setup import KnownStart, Options
from drivetool.identify.steady import steady
from tests.coasting import RPM, STEP, Motor, coast_down, counts, driven_then_off, motion, recording

PAPER, TOP = Motor(), 2240 * RPM  # no-load speed at 40 Hz
TRUTH = one_body().with_values(
    {"motor.inertia": PAPER.inertia, "motor.viscous": PAPER.viscous, "motor.coulomb": PAPER.coulomb})
WIDTH = 2.0 * np.pi / 1000 / np.sqrt(12.0)  # rmse of counts alone
# Drag of the air that brakes at the no-load speed by 1 % of all friction there.
DRAG = replace(PAPER, drag=0.01 * PAPER.friction(TOP) / TOP**2)


def at(hertz, motor=PAPER, seed=0):
    return coast_down(hertz + seed, motor, TOP * hertz / 40)


def validated(record, *models, **options):
    models = models or (CoastDownModel("truth.yaml", TRUTH),)
    return validate_coast_down([record], models, ValidateOptions(**options))


def codes(validation):
    return [f.code for f in validation.findings]


@pytest.fixture(scope="module")
def fitted():
    """Fitted to the coast-down from the no-load speed at 40 Hz: ratios alone."""
    ratios = {p.name: p.value for p in steady([at(40)], one_body(), Options(method="coast-down")).ratios}
    return CoastDownModel("coast.yaml", one_body().with_values({
        "motor.inertia": 1.0, "motor.viscous": ratios["viscous_over_inertia"],
        "motor.coulomb": ratios["coulomb_over_inertia"]}), ratios=True)


@pytest.mark.parametrize("hertz", [45, 50, 55])
def test_a_model_of_one_coast_down_leaves_of_others_the_quantisation(fitted, hertz):
    angle, speed = (found := validated(at(hertz), fitted)).checks
    assert angle.output == "motor_angle" and angle.rmse_counts <= MAX_ERROR_TO_COUNTS
    assert angle.rmse == pytest.approx(angle.rmse_counts * WIDTH, rel=1e-6)
    assert angle.sensor_rmse == pytest.approx(WIDTH, rel=1e-6)
    assert angle.measured_start_rmse < 2.0 * angle.rmse
    true = motion(PAPER, lambda t: 0.0, TOP * hertz / 40, 80 * RPM, 5.0)[1]
    assert speed.output == "motor_speed" and speed.rmse < 2.0 * speed.sensor_rmse < 0.06
    assert speed.rmse / speed.nrmse == pytest.approx(np.ptp(true), rel=0.03)
    assert speed.rmse / speed.nrmse_mean == pytest.approx(true.mean(), rel=0.03)
    assert speed.r2 > 0.999999
    assert codes(found) == ["ratios-only", "coast-down-assumed"]
    assert f"{angle.rmse_counts:.3f} count/sqrt(12)" in found.verdict and "rpm)" in found.verdict


def test_the_inertia_of_ratios_is_of_no_account(fitted):
    other = replace(fitted, drive=fitted.drive.with_values(
        {n: 1e-4 * fitted.drive.values[n] for n in ("motor.inertia", "motor.viscous", "motor.coulomb")}))
    one, another = (validated(at(50), m).checks for m in (fitted, other))
    assert [check.output for check in one] == ["motor_angle", "motor_speed"]
    for a, b in zip(one, another, strict=True):
        assert a.rmse == pytest.approx(b.rmse, rel=1e-6)


@pytest.mark.parametrize("hertz", [40, 55])
def test_a_drag_that_the_model_lacks_shows_with_its_size(hertz):
    """By the independent solver: how far both motions part from one start bounds what a fitted start leaves."""
    record = at(hertz, DRAG)
    found = validated(record)
    angle, speed = found.checks
    assert angle.rmse_counts > 5.0 and "coast-down-not-explained" in codes(found)
    assert f"the friction of coast-{hertz}.parquet differs" in found.verdict
    true, _ = motion(DRAG, lambda t: 0.0, TOP * hertz / 40, 80 * RPM, 5.0)[::-1]
    from_same = motion(PAPER, lambda t: 0.0, TOP * hertz / 40, 0.0, len(true) * STEP)[1][:len(true)]
    distance = float(np.sqrt(np.mean((from_same - true) ** 2)))
    # With its own start speed a free run errs by less, but not by an order.
    assert 0.1 * distance < speed.rmse < distance and speed.rmse > 5.0 * speed.sensor_rmse


def test_the_speed_by_counts_is_that_of_the_motion():
    """What the angle says of the speed's error is the error of the true speed, to what counts leave."""
    record = at(50, DRAG)
    by_counts = validated(record).checks[1]
    true, _ = motion(DRAG, lambda t: 0.0, TOP * 50 / 40, 80 * RPM, 5.0)[::-1]
    by_speed = validated(recording(1, motor_speed=true)).checks
    assert [c.output for c in by_speed] == ["motor_speed"] and by_speed[0].rmse_counts is UNSET
    assert by_counts.rmse == pytest.approx(by_speed[0].rmse, rel=0.1)


def test_a_noisy_angle_and_a_noisy_speed_leave_their_noise():
    angle, speed = motion(PAPER, lambda t: 0.0, TOP, 80 * RPM, 5.0)
    noise = np.random.default_rng(1).normal(0.0, 1.0, len(angle))
    first, second = validated(recording(1, motor_angle=angle + 1e-3 * noise)).checks
    assert first.rmse == pytest.approx(1e-3, rel=0.02) and first.rmse_counts is UNSET
    assert second.rmse < 3.0 * second.sensor_rmse < 0.05
    (only,) = validated(recording(2, motor_speed=speed + 0.2 * noise)).checks
    assert only.rmse == pytest.approx(0.2, rel=0.02) and only.sensor_rmse == pytest.approx(0.2, rel=0.05)


def test_backwards_to_standstill_and_two_in_one_record():
    angle, _ = motion(replace(PAPER, breakaway_speed=1e-3), lambda t: 0.0, 2000 * RPM, 1e-4, 5.0)
    angle = np.concatenate([angle, np.full(8000, angle[-1])])
    (back, _) = validated(recording(1, motor_angle=counts(-angle, 5), motor_torque=np.zeros(len(angle)))).checks
    assert back.rmse_counts == pytest.approx(1.0, abs=0.05)
    driven = driven_then_off(3)
    both = {n: np.concatenate([v, (v if n == "motor_torque" else v + v[-1])]) for n, v in driven.signals.items()}
    found = validated(recording(3, **both))
    assert found.checks[0].rmse_counts == pytest.approx(1.0, abs=0.05)
    assert "coast-down-assumed" not in codes(found)


def test_of_two_bodies_the_whole_runs_down():
    drive = two_mass().with_values({
        "motor.inertia": 5e-5, "load.inertia": PAPER.inertia - 5e-5, "motor.viscous": PAPER.viscous,
        "motor.coulomb": PAPER.coulomb, "shaft.stiffness": 200.0, "shaft.damping": 0.01})
    angle, _ = validated(at(50), CoastDownModel("two.yaml", drive)).checks
    assert angle.rmse_counts == pytest.approx(1.0, abs=0.05)


def test_an_encoder_that_errs_as_the_fit_has_found_is_no_other_friction():
    angle, _ = motion(PAPER, lambda t: 0.0, TOP, 80 * RPM, 5.0)
    width = 2.0 * np.pi / 1000
    edges = np.arange(int(angle[-1] / width) + 2) * width
    edges = edges + np.random.default_rng(1).normal(0.0, 0.2 * width, len(edges))
    record = recording(1, motor_angle=(np.searchsorted(edges, angle, "right") - 1.0) * width)
    known = validated(record, CoastDownModel("m.yaml", TRUTH, encoder=0.2 * width))
    assert "coast-down-not-explained" not in codes(known)
    assert "coast-down-not-explained" in codes(validated(record))


def test_limits_and_what_is_refused():
    found = validated(at(50), min_fit=99.9999)
    assert not any(c.passed for c in found.checks) and "Not passed: 2 of 2" in found.verdict
    for change in ({"segment": 0.1}, {"start": KnownStart(rest=True)}):
        with pytest.raises(BadOption):
            validated(at(50), **change)
    with pytest.raises(BadParameters, match=r"motor\.inertia"):
        validated(at(50), CoastDownModel("none.yaml", one_body()))
    with pytest.raises(NotEnoughData):
        validated(recording(1, motor_angle=np.zeros(8000)))


@pytest.mark.slow
@pytest.mark.parametrize("speed", [1e-3, 0.02, 1.0])
def test_friction_far_too_steep_for_a_record_to_standstill_is_still_tested(speed):
    """Breakaway at 0.02 rad/s, as printed: its derivatives run away where the drive stands."""
    angle, _ = motion(replace(PAPER, breakaway_speed=1e-3), lambda t: 0.0, 2000 * RPM, 1e-4, 5.0)
    angle = np.concatenate([angle, np.full(8000, angle[-1])])
    drive = TRUTH.with_values({"motor.breakaway": 0.1 * PAPER.coulomb, "motor.breakaway_speed": speed})
    check, _ = validated(recording(1, motor_angle=counts(angle, 5)), CoastDownModel("steep.yaml", drive)).checks
    assert check.rmse_counts == pytest.approx(1.0, abs=0.05)


def short_run(speeds, seed):
    """Fitted to a short piece of a coast-down with a noisy speed: ratios that are known to some per cent."""
    _, speed = motion(PAPER, lambda t: 0.0, speeds[0] * RPM, speeds[1] * RPM, 5.0)
    e = recording(seed, motor_speed=speed + np.random.default_rng(seed).normal(0.0, 1.0, len(speed)))
    return steady([e], one_body(), Options(method="coast-down"))


@pytest.mark.slow
def test_what_the_fit_leaves_open_is_no_other_friction():
    """Twenty models that are known badly: in another coast-down each errs by what its covariance says."""
    times, named = [], 0
    for seed in range(20):
        estimate = short_run((1200, 700), seed)
        ratios = {p.name: p.value for p in estimate.ratios}
        names = ("motor.viscous", "motor.coulomb")
        model = CoastDownModel("m.yaml", one_body().with_values({"motor.inertia": 1.0} | dict(
            zip(names, (ratios[n] for n in estimate.details["ratio_covariance"]["names"]), strict=True))),
            spread=Covariance(names, np.array(estimate.details["ratio_covariance"]["matrix"])))
        found = validated(at(50), model)
        angle = found.checks[0]
        assert angle.parameters_rmse > 5.0 * WIDTH
        times.append(angle.rmse / angle.parameters_rmse)
        named += "coast-down-not-explained" in codes(found)
    assert 0.5 < np.sqrt(np.mean(np.square(times))) < 2.0  # as large as stated
    assert named <= 2


def test_a_common_factor_that_is_unsure_leaves_nothing_open():
    """Inertia and friction known to 5 %, all by one friction: a coast-down depends on their ratios only."""
    names = ("motor.inertia", "motor.viscous", "motor.coulomb")
    values = np.array([TRUTH.values[n] for n in names])
    spread = Covariance(names, 0.05**2 * np.outer(values, values))
    check, _ = validated(at(50), CoastDownModel("m.yaml", TRUTH, spread=spread)).checks
    assert check.parameters_rmse < 0.1 * WIDTH
    alone = Covariance(names[1:2], spread.matrix[1:2, 1:2])
    assert validated(at(50), CoastDownModel("m.yaml", TRUTH, spread=alone)).checks[0].parameters_rmse > 50.0 * WIDTH
