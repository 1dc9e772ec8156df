"""From what a search found and left to a verdict: when a name is certain, part of an answer, or none."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from drivetool.check.diagnosis import UNLISTED, CandidateResult, Gain, Round
from drivetool.check.fit.remainder import Remainder
from drivetool.check.report import judgement
from drivetool.check.report.judgement import OF_SPEED, SCATTER, SEVERAL, judged
from drivetool.check.search.result import Found

REPEATS = SimpleNamespace(findings=(SimpleNamespace(code="innovations-correlated"),))
CLEAN = SimpleNamespace(findings=())


def search_with(code, gain=300.0, gain_std=60.0, left=0.0, time=0.0, rivals=(), sure=True, free=(), told=()):
    """A search that found one cause in one round, and what it leaves; told: causes that blocks tell later."""
    found = Found((code,), {code: rivals}, {code: 50.0}, {code: ("x",)}, gain, frozenset(told))
    line = CandidateResult(code, "", "named", gain, gain_std, 50.0, sure=sure)
    return SimpleNamespace(
        unasked="", faults=[], found=found, left=Remainder(left, 0.0, 0.0, time), rounds=[Round(code, (line,))],
        trained=(), folds=(), confident=left <= 0.15 * gain, model=SimpleNamespace(task=SimpleNamespace(free=free)))


def gain(before, after, left=0.0, std=0.05):
    return Gain("rad/s", 1.5, before, after, 90.0, 95.0, std, std, 0.3, left)


def test_what_explains_all_is_named():
    found = judged(search_with("asymmetric-friction"), CLEAN, gain(1.0, 0.3), 0.001)
    assert (found.verdict, found.causes, found.between) == ("named", ("asymmetric-friction",), ())


@pytest.mark.parametrize("search", [
    search_with("asymmetric-friction", left=900.0),
    search_with("asymmetric-friction", time=60.0)])
@pytest.mark.parametrize(("after", "left", "std", "verdict"), [
    (0.56, 87.0, 0.15, "undetermined"),  # free runs say that it is there
    (0.95, 53.0, 0.15, "undetermined"),  # single steps do
    (0.90, 87.0, 0.15, "unexplained"),
    (0.65, 87.0, 0.25, "unexplained"),  # as blocks scatter, that is no gain
    (1.60, 53.0, 0.15, "unexplained")])  # it spoils free runs
def test_part_of_an_answer_is_neither_a_name_nor_nothing(search, after, left, std, verdict):
    found = judged(search, REPEATS, gain(1.0, after, left, std), 0.001)
    assert found.verdict == verdict
    if verdict == "undetermined":
        assert found.between == ("asymmetric-friction", UNLISTED) and f"{left:.0f} %" in found.doubt


def test_rivals_of_a_part_stay_rivals():
    search = search_with("quadratic-drag", left=900.0, rivals=("load-step",))
    found = judged(search, REPEATS, gain(1.0, 0.5, 80.0), 0.001)
    assert found.between == ("quadratic-drag", "load-step", UNLISTED) and found.causes == ()


@pytest.mark.parametrize(("share", "after", "more"), [
    (2.4, 1.9, (UNLISTED,)),  # a gap five times the twist, of which a motor encoder alone shows the knocks
    (2.4, 0.31, ()),  # little more than the sensor's noise is left
    (0.001, 1.9, ())])
def test_rivals_beside_a_torque_noise_that_is_none_may_be_neither(share, after, more):
    found = judged(search_with("speed-filter", rivals=("converter-lag",)), CLEAN, gain(2.0, after), share)
    assert (found.verdict, found.between) == ("undetermined", ("speed-filter", "converter-lag", *more))


@pytest.mark.parametrize(("share", "left", "made", "verdict"), [
    (0.04, 0.0, 1.5, "named"),  # a ripple at creeping speed, where every knock decides which way the drive goes
    (0.04, 0.0, 0.9, "undetermined"),  # noise alone does not go so far astray
    (0.04, 3.0, 1.5, "undetermined"),  # single steps are not white
    (0.08, 0.0, 1.5, "undetermined")])  # more than a torque has
def test_a_run_that_noise_leads_astray_is_no_doubt(monkeypatch, share, left, made, verdict):
    monkeypatch.setattr(judgement, "error_by_noise", lambda *_: made)
    found = judged(search_with("torque-ripple", left=left), CLEAN, gain(3.0, 1.9), share)
    assert found.verdict == verdict


@pytest.mark.parametrize(("code", "worth", "sure", "verdict"), [
    ("torque-ripple", 17.9, False, "undetermined"), ("torque-ripple", 17.9, True, "named"),
    ("torque-ripple", 90.0, False, "undetermined"), ("load-step", 90.0, False, "named"),
    ("load-step", 35.8, False, "undetermined"), ("load-step", 35.8, True, "named")])
def test_a_name_takes_blocks_that_agree_except_on_a_plain_event(code, worth, sure, verdict):
    """Breakaway friction, left out of the catalogue, was named a load step of 35.8 +- 24.3 at a reversal."""
    found = judged(search_with(code, gain=worth, gain_std=0.7 * worth, sure=sure), CLEAN, gain(1.0, 0.9), 0.001)
    assert found.verdict == verdict
    assert found.between == ((code, UNLISTED) if verdict == "undetermined" else ())
    assert found.doubt == (SCATTER if verdict == "undetermined" else "")


def test_a_name_that_blocks_are_sure_of_beside_a_later_cause_is_one():
    search = search_with("coulomb-load", gain=46.9, gain_std=43.8, sure=False, told=["coulomb-load"])
    assert judged(search, CLEAN, gain(1.0, 0.3), 0.001).verdict == "named"


@pytest.mark.parametrize(("steps", "left", "by_speed", "doubt"), [
    (("load.step_torque", "load.step2_torque"), 14.0, 0.3, SEVERAL),
    (("load.step_torque", "load.step2_torque"), 0.0, 0.95, OF_SPEED),
    (("load.step_torque", "load.step2_torque"), 0.0, 0.8, ""),
    (("load.step_torque",), 14.0, 0.95, "")])
def test_a_load_that_changes_several_times_must_leave_nothing_and_not_go_with_the_speed(
        steps, left, by_speed, doubt, monkeypatch):
    """Friction by direction, left out of the catalogue, is a load that comes and goes at the reversals."""
    monkeypatch.setattr(judgement, "share_by_speed", lambda _: by_speed)
    verdict = "undetermined" if doubt else "named"
    found = judged(search_with("load-step", left=left, free=steps), CLEAN, gain(1.0, 0.7), 0.001)
    assert (found.verdict, found.doubt) == (verdict, doubt)
    assert found.between == (("load-step", UNLISTED) if verdict == "undetermined" else ())
