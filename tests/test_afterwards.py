"""Doubts about a cause that others were found after: asked again beside those."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.check import afterwards
from drivetool.check.afterwards import doubts_again
from drivetool.check.decide import Decision
from drivetool.check.diagnosis import CandidateResult, DiagnoseOptions, Round
from drivetool.check.found import Found
from drivetool.check.heldout import Score
from drivetool.check.model import Model


def searched(gains):
    """A search that found dry friction at the load, or at the motor, and then a gap; what it is worth beside that.

    gains  cause -> per block, where it is asked again
    """
    found = Found()
    found.take("coulomb-load", Decision(None, ("coulomb-load", "coulomb-motor"), 20.0), ["load.coulomb"], 47.0)
    found.take("backlash", Decision(None, ("backlash",), 240.0), ["shaft.half_gap"], 678.0)
    lines = [CandidateResult(c, "", "possible", 47.0, 44.0, sure=False) for c in ("coulomb-load", "coulomb-motor")]
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
        found=found, rounds=[Round("coulomb-load", tuple(lines)), Round("backlash", (later,))], model=model,
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
