"""The smallest visible size that a diagnosis states, against what the truth says of an effect of that size."""

from __future__ import annotations

import pytest

from tests.hidden import greybox_options, make_case, write_start
from tests.hidden.command import greybox_and_diagnose
from tests.hidden.visibility import visible

pytestmark = pytest.mark.slow

MACHINE = 70012
# Effect -> the tool's parameter, that of the label, and what the one is of the other.
SAME = {"backlash": ("shaft.half_gap", "shaft.half_gap", lambda v: v),
        "coulomb-load": ("load.coulomb", "load.coulomb", lambda v: v),
        "quadratic-drag": ("load.drag", "load.quadratic_drag", lambda v: v),
        "dead-time": ("converter.dead_time", "converter.dead_time", lambda v: v),
        "speed-filter": ("sensor.bandwidth", "sensor.filter_time", lambda v: 1.0 / v)}


def detected(code, smallest):
    """Visibility of an effect of the size that the diagnosis states; six noises are what it is about."""
    name, true, same = SAME[code]
    hidden = make_case(code, MACHINE, seed=MACHINE).hidden[0]
    size = hidden.size * same(smallest[code][name]["value"]) / hidden.truth[true]
    return visible(make_case(code, MACHINE, seed=MACHINE, size=size)).number


def stated(answer):
    """Code -> smallest sizes, of the first round."""
    return {c["code"]: c["smallest"] for c in sorted(answer.candidates, key=lambda c: -c["round"])}


def test_an_effect_of_the_smallest_visible_size_is_as_visible_as_it_says(tmp_path):
    """Six noises, after the base parameters have absorbed what they can; wanted within a factor 2."""
    case = make_case((), MACHINE, seed=MACHINE)
    logs, _ = case.write_records(tmp_path)
    words = ["--candidates", ",".join(SAME)]
    answer = greybox_and_diagnose(tmp_path, logs, write_start(case, tmp_path), greybox_options(case), words)
    assert answer.verdict == "nothing-found", answer.stderr
    for code in SAME:
        assert 3.0 < detected(code, stated(answer)) < 12.0, code


@pytest.mark.parametrize("code", ["coulomb-load", pytest.param("backlash", marks=pytest.mark.long)])
def test_nor_is_it_hidden_behind_what_is_found(tmp_path, code):
    """A hundred times as large, an effect that the base lacks passes there for noise of the torque."""
    case = make_case(code, MACHINE, seed=MACHINE)
    logs, _ = case.write_records(tmp_path)
    answer = greybox_and_diagnose(tmp_path, logs, write_start(case, tmp_path), greybox_options(case),
                                  ["--candidates", code])
    assert answer.verdict == "named" and answer.causes == (code,), answer.stderr
    assert 3.0 < detected(code, stated(answer)) < 12.0
