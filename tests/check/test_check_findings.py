"""Findings of a diagnosis: halves that need other values, a check that was not made, a second search."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.check import full_diagnosis as diagnose
from drivetool.check.faults.record_faults import Fault
from drivetool.check.fit.residual_tests import ResidualTests
from drivetool.check.outcome.diagnosis import CandidateResult, DiagnoseOptions, Round
from drivetool.check.search.result import SearchResult
from drivetool.check.verdict.diagnosis_report import change_findings
from drivetool.check.verdict.rules import MIN_UNEXPLAINED_GAIN
from tests.recover import drive_like, linear_record
from tests.simulator.machine import machine_by_seed

FREE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")


@pytest.mark.parametrize(("time", "said"),
                         [(0.9 * MIN_UNEXPLAINED_GAIN, False), (1.1 * MIN_UNEXPLAINED_GAIN, True)])
def test_halves_of_the_records_that_need_other_values(time, said):
    found = change_findings(SimpleNamespace(left=ResidualTests(0.0, 0.0, 0.0, time)))
    assert [f.code for f in found] == (["parameters-change"] if said else [])


@pytest.mark.parametrize("breaks", [False, True])
def test_a_failed_check_of_the_shaft_torque_is_reported(breaks, monkeypatch):
    """A diagnosis goes on without it: here to its search, which is looked at and not made."""
    def check(mended, drive, *_):
        if breaks:
            raise np.linalg.LinAlgError
        return mended, drive, []

    class Searched(Exception):
        pass

    def searched(request, *_):
        raise Searched(request.notes)

    monkeypatch.setattr(diagnose, "shaft_fault", check)
    monkeypatch.setattr(diagnose, "search_records", searched)
    machine = machine_by_seed(5)
    record, drive = linear_record(machine, 5, 2.0), drive_like(machine, list(FREE))
    with pytest.raises(Searched) as stopped:
        diagnose.diagnose([record], drive, FREE, DiagnoseOptions())
    assert [f.code for f in stopped.value.args[0]] == (["shaft-torque-unchecked"] if breaks else [])


def fault(code, **more):
    return Fault(code, None, **more)


@pytest.mark.parametrize(("causes", "scale_likelier", "faults", "trusts"), [
    (("friction-drift",), False, [fault("wrong-scale", factor=1.09, shaft=True)], True),
    (("friction-drift",), True, [fault("wrong-scale", factor=1.09, shaft=True)], False),
    ((), False, [fault("wrong-scale", factor=1.09, shaft=True)], False),  # no law explains anything
    (("friction-drift",), False, [fault("wrong-scale", factor=1.09)], False)])  # by two sensors of one motion
def test_a_shaft_torque_is_trusted_where_laws_explain_as_much(monkeypatch, causes, scale_likelier, faults, trusts):
    """Warming up, left out of the drive, was a sensor that reads 1.09 times the torque."""
    blamed, other = SimpleNamespace(faults=faults), SimpleNamespace(found=SimpleNamespace(causes=causes))
    monkeypatch.setattr(diagnose, "search_records", lambda *_: other)
    monkeypatch.setattr(diagnose, "scale_improves_likelihood", lambda again, without, factor: scale_likelier)
    assert (diagnose.with_trusted_sensor(None, blamed, ("as logged",), None) is other) == trusts


@pytest.mark.parametrize("rounds", [(), ("one",)])
def test_where_rounding_alone_is_left_no_sample_is_impossible(monkeypatch, rounds):
    """On a record without noise the innovations are its last digits. And the fault of the sensor is reported in
    no search that trusts it.
    """
    calls, fault_codes = [], []
    blamed = fault("wrong-scale", factor=1.09, shaft=True)
    ended = SimpleNamespace(rounds=rounds, left=SimpleNamespace(total=0.0), model=None, train=(), faults=[blamed],
                            found=SimpleNamespace(causes=("friction-drift",), between=()))

    def search(request, records, drive, faults):
        fault_codes.append([f.code for f in faults])
        return ended

    monkeypatch.setattr(diagnose, "shaft_fault", lambda mended, drive, *_: (mended, drive, [blamed]))
    monkeypatch.setattr(diagnose, "search_records", search)
    monkeypatch.setattr(diagnose, "with_shaft_scale", lambda request, search, *_: search)
    monkeypatch.setattr(diagnose, "scale_improves_likelihood", lambda *_: True)
    monkeypatch.setattr(diagnose, "rescaled", lambda records, factor: records)
    monkeypatch.setattr(diagnose, "without_model_outliers", lambda *_: calls.append(1) or ((), []))
    monkeypatch.setattr(diagnose, "diagnosis_of", lambda search, *_: search)
    machine = machine_by_seed(5)
    record, drive = linear_record(machine, 5, 2.0), drive_like(machine, list(FREE))
    assert diagnose.diagnose([record], drive, FREE, DiagnoseOptions()) is ended
    assert bool(calls) == bool(rounds) and fault_codes == [["wrong-scale"], []]


def test_once_a_dead_time_is_known_only_what_had_a_chance_is_looked_for_again(monkeypatch):
    """In less of the records; of the others stands what was said before, and faults are none of a search."""
    def lines(**states):
        return tuple(CandidateResult(code.replace("_", "-"), state, gain=gain)
                     for code, (state, gain) in states.items())

    def searched_with(*rounds):
        return SearchResult(*[None] * 11, tuple(rounds), None)

    before = searched_with(
        Round(1, "dead-time", candidates=lines(dead_time=("named", 90.0), converter_lag=("worse", None),
                                               backlash=("no-gain", None), imbalance=("not-shown", None))),
        Round(2, candidates=lines(quadratic_drag=("no-gain", -3.0), backlash=("no-gain", None))))
    after = searched_with(Round(1, "dead-time", candidates=lines(
        dead_time=("named", 95.0), converter_lag=("worse", 60.0), quadratic_drag=("no-gain", None))))
    calls = []

    def searched(own, records, *_):
        calls.append((own.wanted, records))
        return after

    monkeypatch.setattr(diagnose, "search_records", searched)
    wanted = ("dead-time", "converter-lag", "backlash", "imbalance", "quadratic-drag", "outliers")
    own = diagnose.Request(1, (None, ()), (), wanted, DiagnoseOptions(), {}, ())
    found = diagnose.repeated_search(own, before, ("less",), None, ())
    assert calls == [(("dead-time", "converter-lag", "quadratic-drag", "outliers"), ("less",))]
    (one,) = found.rounds
    assert {c.code: (c.state, c.gain) for c in one.candidates} == {
        "dead-time": ("named", 95.0), "converter-lag": ("worse", 60.0), "quadratic-drag": ("no-gain", None),
        "backlash": ("no-gain", None), "imbalance": ("not-shown", None)}
    assert replace(found, rounds=()) == replace(after, rounds=())
