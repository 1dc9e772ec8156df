"""Doubts about a cause that others were found after: asked again beside those."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.check import afterwards
from drivetool.check.afterwards import doubts_again, look_alikes_again
from drivetool.check.causes import CAUSES
from drivetool.check.decide import Decision
from drivetool.check.diagnosis import CandidateResult, DiagnoseOptions, Round
from drivetool.check.found import Found
from drivetool.check.heldout import Score
from drivetool.check.model import Model


def friction_first():
    """Dry friction at the load, or at the motor, and then a gap: (found, first lines)."""
    found = Found()
    found.take("coulomb-load", Decision(None, ("coulomb-load", "coulomb-motor"), 20.0), ["load.coulomb"], 47.0)
    found.take("backlash", Decision(None, ("backlash",), 240.0), ["shaft.half_gap"], 678.0)
    return found, [CandidateResult(c, "", "possible", 47.0, 44.0, sure=False)
                   for c in ("coulomb-load", "coulomb-motor")]


def searched(gains, found_so=friction_first, left=0.0):
    """A search that found one cause and then another; what the first is worth beside the second.

    gains  cause -> per block, where it is asked again
    """
    found, lines = found_so()
    later = CandidateResult("backlash", "", "named", 678.0, 165.0)
    task = SimpleNamespace(free=("motor.inertia", "load.coulomb", "shaft.half_gap"), drive=None)
    model = Model("backlash", task, None, None, None, -1000.0)
    asked = []

    def judged(tried):
        return [Score(SimpleNamespace(code=c, task=task), np.array(gains[c]), (sum(gains[c]) - 5.0,) * 2,
                      (0.0, 0.0), (model, model), sum(gains[c])) for c in tried]

    def attempts(among):
        asked.append([c.code for c in among])
        return asked[-1]

    search = SimpleNamespace(
        found=found, rounds=[Round(found.causes[0], tuple(lines)), Round("backlash", (later,))], model=model,
        left=SimpleNamespace(total=left), asked=set(CAUSES), trained=(), gain_between=lambda *trained: trained,
        bases=(), folds=(), ends={}, masks=(), first=SimpleNamespace(task=task), options=DiagnoseOptions(),
        stand_on=lambda _: None, attempts=attempts, judged=judged, with_doubles=lambda _tried, scores, _: scores)
    return search, asked


@pytest.mark.parametrize(("rival", "states", "rivals"), [
    ([8.0, 3.0, 5.0, 4.0], ["named", "worse"], ()),
    ([78.0, 66.0, 75.0, 76.0], ["possible", "possible"], ("coulomb-motor",))])
def test_what_tied_is_asked_again_beside_what_was_found_later(monkeypatch, rival, states, rivals):
    monkeypatch.setattr(afterwards, "without_them", lambda model, *_: model)
    search, asked = searched({"coulomb-load": [75.0, 70.0, 80.0, 72.0], "coulomb-motor": rival})
    doubts_again(search)
    assert asked == [["coulomb-motor", "coulomb-load"]]
    assert search.found.rivals["coulomb-load"] == rivals and search.found.sure == {"coulomb-load"}
    assert [c.state for c in search.rounds[0].candidates] == states
    assert search.ends == {} and search.model.code == "backlash"


def test_a_doubt_stands_where_it_is_not_answered(monkeypatch):
    def lost(*_):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(afterwards, "without_them", lost)
    search, _ = searched({})
    doubts_again(search)
    assert search.found.rivals["coulomb-load"] == ("coulomb-motor",) and not search.found.sure
    assert [c.state for c in search.rounds[0].candidates] == ["possible", "possible"]


def hardening_first(gap=396.0):
    """A shaft that stiffens, a gap hardly or far behind it, and then something else: (found, first lines)."""
    found = Found()
    found.take("hardening-stiffness", Decision(None, ("hardening-stiffness",), 170.0), ["shaft.hardening"], 399.0)
    found.take("coulomb-load", Decision(None, ("coulomb-load",), 100.0), ["load.coulomb"], 200.0)
    return found, [CandidateResult("hardening-stiffness", "", "named", 399.0, 51.0),
                   CandidateResult("backlash", "", "worse", gap, 180.0),
                   CandidateResult("imbalance", "", "no-gain")]


@pytest.fixture
def resting(monkeypatch):
    """Models that are fitted need no fit, and leave nothing."""
    monkeypatch.setattr(afterwards, "without_them", lambda model, *_: model)
    monkeypatch.setattr(afterwards, "at_rest", lambda model, _: model)
    monkeypatch.setattr(afterwards, "remainder", lambda _: SimpleNamespace(total=0.0))
    monkeypatch.setattr(afterwards, "results_of", lambda tried, *_: tuple(
        CandidateResult(c, "", "named" if c == "backlash" else "worse") for c in tried))


@pytest.mark.usefixtures("resting")
def test_a_look_alike_that_does_better_beside_the_others_takes_its_place():
    search, asked = searched({"hardening-stiffness": [140.0, 150.0, 130.0, 145.0],
                              "backlash": [310.0, 300.0, 320.0, 330.0]}, hardening_first, left=30.0)
    look_alikes_again(search)
    assert asked == [["backlash", "hardening-stiffness"]]
    assert search.found.causes == ["backlash", "coulomb-load"] and search.found.between == ()
    assert search.found.evidence["backlash"] > 100.0 and "hardening-stiffness" not in search.found.evidence
    assert search.left.total == 0.0
    assert search.rounds[0].cause == "backlash"
    assert {c.code: c.state for c in search.rounds[0].candidates} == {
        "backlash": "named", "hardening-stiffness": "worse", "imbalance": "no-gain"}


@pytest.mark.usefixtures("resting")
@pytest.mark.parametrize(("gap", "left", "worth", "wanted"), [
    (396.0, 30.0, 135.0, CAUSES), (90.0, 30.0, 310.0, CAUSES), (396.0, 0.0, 310.0, CAUSES),
    (396.0, 30.0, 310.0, {"hardening-stiffness"})],
    ids=["no better", "far behind at first", "nothing left to explain", "not asked for"])
def test_a_cause_stays_where_nothing_does_better(gap, left, worth, wanted):
    search, _ = searched({"hardening-stiffness": [140.0, 150.0, 130.0, 145.0], "backlash": [worth] * 4},
                         lambda: hardening_first(gap), left)
    search.asked = wanted
    look_alikes_again(search)
    assert search.found.causes == ["hardening-stiffness", "coulomb-load"]
    assert search.rounds[0].cause == "hardening-stiffness" and search.left.total == left
