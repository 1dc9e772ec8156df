"""A coast-down fitted window by window: its bias is stated, and is the one that the published windows have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.cli.options import windows_of
from drivetool.drive import one_body, two_mass
from drivetool.errors import BadOption, NotEnoughData
from drivetool.identify.setup.options import Options
from drivetool.identify.steady.estimator import steady
from tests.coasting import RPM, Motor, coast_down, counts, driven_then_off, motion, recording

PAPER = Motor()
PRINTED = tuple((a * RPM, b * RPM) for a, b in ((1600, 750), (750, 300), (300, 80)))
STAGED = Options(method="coast-down", stages=PRINTED[:2])
NAMES = ("viscous_over_inertia", "coulomb_over_inertia")


def ratios(estimate):
    return {p.name: p for p in estimate.ratios}


def staged_fit_finding(estimate):
    (finding,) = (f for f in estimate.findings if f.code == "staged-fit")
    return finding


def effective(high, low, coulomb=0.0):
    """B/J that brings a drive from one speed to another in the time that the true one takes, in closed form."""
    def time(b, c):
        return np.log((b * high + c) / (b * low + c)) / b

    true = time(PAPER.viscous / PAPER.inertia, PAPER.coulomb / PAPER.inertia)
    return np.log(high / low) / true


def test_without_coulomb_friction_in_the_first_window_viscous_friction_is_twice_what_it_is():
    joint, staged = (steady([coast_down(1)], one_body(), how) for how in (replace(STAGED, stages=()), STAGED))
    old, new = ratios(joint), ratios(staged)
    truth = PAPER.viscous / PAPER.inertia
    assert new[NAMES[0]].value == pytest.approx(effective(*PRINTED[0]), rel=0.05)
    assert new[NAMES[0]].value == pytest.approx(2.0 * truth, rel=0.02)
    assert new[NAMES[1]].value < 0.6 * PAPER.coulomb / PAPER.inertia
    assert all(p.std is None and "staged" in p.reason for p in new.values())
    finding = staged_fit_finding(staged)
    assert finding.severity == "warning" and "left out" in finding.text and "0.72 to 1.53" in finding.text
    for name in NAMES:
        away = (new[name].value - old[name].value) / old[name].std
        assert finding.evidence[name] == pytest.approx(away) and abs(away) > 1e4
        assert staged.details["joint_fit"][name]["std"] == old[name].std
    assert [s["fitted"] for s in staged.details["stages"]] == [["motor.viscous"], ["motor.coulomb"]]
    assert "staged-fit" not in {f.code for f in joint.findings} and "stages" not in joint.details
    assert staged.fit["rmse"] > 100.0 * joint.fit["rmse"]


@pytest.mark.parametrize("share", [1.0, 0.9])
def test_a_known_coulomb_friction_takes_its_own_error_into_the_viscous_one(share):
    drive = one_body().with_values({"motor.inertia": PAPER.inertia, "motor.coulomb": share * PAPER.coulomb})
    staged = steady([coast_down(1)], drive, replace(STAGED, hold=("motor.inertia",)))
    values = {p.name: p for p in staged.parameters}
    off = values["motor.viscous"].value / PAPER.viscous - 1.0
    # What Coulomb friction lacks is in the viscous one, about as much as it is of it in the middle of the window.
    assert off == pytest.approx((1.0 - share) * 1.0, abs=0.01)
    assert values["motor.inertia"].status == "held" and values["motor.viscous"].std is None
    assert staged.covariance is None and (share == 1.0 or staged_fit_finding(staged).severity == "warning")
    assert f"at {share * PAPER.coulomb:.4g} Nm" in staged_fit_finding(staged).text


def test_a_stretch_under_torque_gives_the_inertia_of_the_first_window():
    staged = steady([driven_then_off(1)], one_body(), STAGED)
    assert staged.details["stages"][0]["fitted"] == ["motor.inertia", "motor.viscous"]
    finding = staged_fit_finding(staged)
    assert set(finding.evidence) == {"motor.inertia", "motor.viscous", "motor.coulomb", *NAMES}
    assert staged.details["scale"] == ["a stretch under torque"]


@pytest.mark.slow
def test_three_windows_of_a_coast_down_with_breakaway():
    motor = replace(PAPER, surplus=0.5 * PAPER.coulomb, breakaway_speed=5.0)
    angle, _ = motion(motor, lambda t: 0.0, 2240 * RPM, 1e-3, 5.0)
    free = ("motor.breakaway", "motor.breakaway_speed")
    known = {"motor.inertia": PAPER.inertia, "motor.coulomb": PAPER.coulomb, "motor.breakaway": motor.surplus}
    windows = tuple((a * RPM, b * RPM) for a, b in ((1600, 750), (750, 100), (100, 5)))
    staged = steady([recording(1, motor_angle=counts(angle, 1))], one_body().with_values(known),
                    replace(STAGED, free=free, stages=windows, hold=("motor.inertia",)))
    assert [s["fitted"] for s in staged.details["stages"]] == [
        ["motor.viscous"], ["motor.coulomb", "motor.breakaway"], ["motor.breakaway_speed"]]
    values = {p.name: p.value for p in staged.parameters}
    assert values["motor.viscous"] == pytest.approx(PAPER.viscous, rel=1e-3)
    assert values["motor.breakaway_speed"] == pytest.approx(5.0, rel=0.02)


@pytest.mark.slow
def test_a_window_that_ends_on_a_bound_says_so():
    """At 20 rad/s breakaway acts in the second window, which holds it at its start value."""
    motor = replace(PAPER, surplus=0.5 * PAPER.coulomb, breakaway_speed=20.0)
    angle, _ = motion(motor, lambda t: 0.0, 2240 * RPM, 1e-3, 5.0)
    known = {"motor.inertia": PAPER.inertia, "motor.coulomb": PAPER.coulomb, "motor.breakaway": motor.surplus}
    windows = tuple((a * RPM, b * RPM) for a, b in ((1600, 750), (750, 100), (100, 5)))
    staged = steady([recording(1, motor_angle=counts(angle, 1))], one_body().with_values(known), replace(
        STAGED, free=("motor.breakaway", "motor.breakaway_speed"), stages=windows, hold=("motor.inertia",)))
    (line,) = (p for p in staged.parameters if p.name == "motor.breakaway_speed")
    assert line.status == "at-bound" and line.std is None
    assert np.isfinite(staged.fit["rmse"])


@pytest.mark.slow
def test_the_printed_windows_identify_no_breakaway():
    free = ("motor.breakaway", "motor.breakaway_speed")
    staged = steady([coast_down(1)], one_body(), replace(STAGED, free=free, stages=PRINTED))
    (line,) = (p for p in staged.parameters if p.name == "motor.breakaway_speed")
    assert line.status == "not-identifiable" and set(ratios(staged)) == set(NAMES)


@pytest.mark.parametrize(("drive", "change", "error", "says"), [
    (one_body(), {"stages": PRINTED}, BadOption, "window 3"),
    (one_body(), {"stages": ((900.0, 800.0), (78.0, 31.0))}, NotEnoughData, "from 900 to 800 rad/s"),
    (two_mass(), {}, BadOption, "several bodies"),
    (one_body(), {"method": "speeds"}, BadOption, "with --stages")])
def test_what_cannot_be_staged_is_refused(drive, change, error, says):
    with pytest.raises(error, match=says):
        steady([coast_down(1)], drive, replace(STAGED, **change))


def test_windows_in_words():
    assert windows_of("1600:750,750:300", "rad") == PRINTED[:2]
    assert windows_of(" 1600:750 , 750:300, 300:80 rpm ", "rad") == PRINTED
    assert windows_of("170:80,80:30.5 rad/s", "rad") == ((170.0, 80.0), (80.0, 30.5))
    assert windows_of("2:1,0.9:.1", "m") == ((2.0, 1.0), (0.9, 0.1)) and windows_of("", "rad") == ()


@pytest.mark.parametrize("words", [
    "1600:750", "750:1600,1600:80", "1600:750,800:300", "1600,750", "a:b,c:d", "1:1,1:0", "3:2,2:1 Nm", "2:1:0,1:0",
    "5:4,4:3,3:2,2:1", ",", "1600:750,750:300 rpm rpm"])
def test_words_that_are_no_windows_are_refused(words):
    with pytest.raises(BadOption, match="--stages"):
        windows_of(words, "rad")
