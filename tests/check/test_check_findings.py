"""What a diagnosis says of halves that ask for other values, of a check that was not made, of a second search."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.check import diagnose
from drivetool.check.diagnosis import CandidateResult, DiagnoseOptions, Round
from drivetool.check.fit.remainder import Remainder
from drivetool.check.report.rules import UNEXPLAINED
from drivetool.check.report.story import changing
from drivetool.check.search.result import Searched
from tests.recover import drive_like, linear_record
from tests.simulator.machine import machine_by_seed

FREE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")


@pytest.mark.parametrize(("time", "said"), [(0.9 * UNEXPLAINED, False), (1.1 * UNEXPLAINED, True)])
def test_halves_of_the_records_that_ask_for_other_values(time, said):
    found = changing(SimpleNamespace(left=Remainder(0.0, 0.0, 0.0, time)))
    assert [f.code for f in found] == (["parameters-change"] if said else [])


@pytest.mark.parametrize("breaks", [False, True])
def test_a_check_of_the_shaft_torque_that_breaks_down_is_said(breaks, monkeypatch):
    """A diagnosis goes on without it: here to its search, which is looked at and not made."""
    def check(mended, drive, *_):
        if breaks:
            raise np.linalg.LinAlgError
        return mended, drive, []

    class Searched(Exception):
        pass

    def searched(asked, *_):
        raise Searched(asked.notes)

    monkeypatch.setattr(diagnose, "shaft_fault", check)
    monkeypatch.setattr(diagnose, "searched", searched)
    machine = machine_by_seed(5)
    record, drive = linear_record(machine, 5, 2.0), drive_like(machine, list(FREE))
    with pytest.raises(Searched) as stopped:
        diagnose.diagnose([record], drive, FREE, DiagnoseOptions())
    assert [f.code for f in stopped.value.args[0]] == (["shaft-torque-unchecked"] if breaks else [])


def test_once_a_dead_time_is_known_only_what_had_a_chance_is_looked_for_again(monkeypatch):
    """In less of the records; of the others stands what was said before, and faults are none of a search."""
    def lines(**states):
        return tuple(CandidateResult(code.replace("_", "-"), "", *said) for code, said in states.items())

    def searched_with(*rounds):
        return Searched(*[None] * 11, tuple(rounds), None)

    before = searched_with(
        Round("dead-time", lines(dead_time=("named", 90.0), converter_lag=("worse", None),
                                 backlash=("no-gain", None), imbalance=("not-shown", None))),
        Round(None, lines(quadratic_drag=("no-gain", -3.0), backlash=("no-gain", None))))
    after = searched_with(Round("dead-time", lines(dead_time=("named", 95.0), converter_lag=("worse", 60.0),
                                                   quadratic_drag=("no-gain", None))))
    asked = []

    def searched(own, records, *_):
        asked.append((own.wanted, records))
        return after

    monkeypatch.setattr(diagnose, "searched", searched)
    wanted = ("dead-time", "converter-lag", "backlash", "imbalance", "quadratic-drag", "outliers")
    own = diagnose.Asked(1, (None, ()), (), wanted, DiagnoseOptions(), {}, ())
    found = diagnose.looked_again(own, before, ("less",), None, ())
    assert asked == [(("dead-time", "converter-lag", "quadratic-drag", "outliers"), ("less",))]
    (one,) = found.rounds
    assert {c.code: (c.state, c.gain) for c in one.candidates} == {
        "dead-time": ("named", 95.0), "converter-lag": ("worse", 60.0), "quadratic-drag": ("no-gain", None),
        "backlash": ("no-gain", None), "imbalance": ("not-shown", None)}
    assert replace(found, rounds=()) == replace(after, rounds=())
