"""A start that breaks is passed over; a step ends only where all of them do."""

import numpy as np
import pytest

from drivetool.identify.fit import engine
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.starts import search
from drivetool.identify.starts.attempts import attempt_or_none, without_failed
from tests.identify.test_law_selection import drawn


def broken(*_, **__):
    raise np.linalg.LinAlgError("singular")


def test_what_breaks_is_none_and_what_is_wrong_is_raised():
    assert attempt_or_none(lambda: 3) == 3 and attempt_or_none(broken) is None
    with pytest.raises(ZeroDivisionError):
        attempt_or_none(lambda: 1 // 0)
    assert without_failed([None, 2]) == [2] and without_failed([]) == []
    with pytest.raises(np.linalg.LinAlgError, match="all 2 starts failed"):
        without_failed([None, None])


def test_a_broken_start_of_a_plain_fit_is_passed_over(monkeypatch):
    task, plain = drawn("white", "", 2, 52), engine.fit_innovations
    breaks = [True, False, True]  # the first of two starts, and then the only one

    def some_break(*words, **more):
        return broken() if breaks.pop(0) else plain(*words, **more)

    expected = by_innovations(task, [{}])
    monkeypatch.setattr(engine, "fit_innovations", some_break)
    found = by_innovations(task, [{}, {}])
    np.testing.assert_allclose(found.solution.point.values, expected.solution.point.values, rtol=1e-3)
    with pytest.raises(np.linalg.LinAlgError, match="starts failed"):
        by_innovations(task, [{}])


@pytest.mark.parametrize("breaks", [(0,), (0, 1, 3), tuple(range(10))])
def test_broken_descents_of_a_search_are_passed_over(monkeypatch, breaks):
    """Ten ways, of which those named break; the others all end at the same place."""
    monkeypatch.setattr(search, "ranked_starts", lambda task, starts, seed: [task] * 6)
    task, ways = drawn("white", "", 2,
                       52), {(w, h): i for i, (_, w, h) in reversed(list(enumerate(search.DESCENT_PLAN)))}
    made = []

    def descend(start, way, hot, lowest):
        made.append(way)
        if ways.get((way, hot), 0) in breaks or len(breaks) == 10:
            broken()
        return 1.0, "place", start

    def found():
        return search.multi_start_search(task, [{}], 1, descend, lambda one, other: 0.0)

    if len(breaks) == 10:
        with pytest.raises(np.linalg.LinAlgError, match="all 10"):
            found()
    else:
        assert [d.end for d in found()] == ["place", "place"]
