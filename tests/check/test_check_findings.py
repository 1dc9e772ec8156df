"""Findings of a diagnosis: halves that need other values, a check that was not made, a second search."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check import full_diagnosis as diagnose
from drivetool.check.faults.record_faults import Fault
from drivetool.check.outcome.diagnosis import CandidateResult, DiagnoseOptions, Round
from drivetool.check.verdict.diagnosis_report import change_findings
from drivetool.check.verdict.rules import MIN_UNEXPLAINED_GAIN
from drivetool.drive.simulation import Trace
from drivetool.identify.setup import Roles
from tests.check.models import ended, model_of, model_over, task_of, true_model
from tests.recover import drive_like, linear_record
from tests.simulator.machine import machine_by_seed

FREE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")
SHAFT_LOGGED = model_over(Trace(np.zeros((2, 1)), np.zeros((2, 2)), 1e-3), task=task_of(
    FREE[:1], roles=Roles(("motor_torque",), ("motor_speed", "shaft_torque"))))


@pytest.mark.parametrize(("time", "said"),
                         [(0.9 * MIN_UNEXPLAINED_GAIN, False), (1.1 * MIN_UNEXPLAINED_GAIN, True)])
def test_halves_of_the_records_that_need_other_values(time, said):
    found = change_findings(ended(time=time))
    assert [f.code for f in found] == (["parameters-change"] if said else [])


class Stages:
    """The check of the shaft torque and the searches of a diagnosis, whose results are given.

    faults  of the shaft torque, None where the check breaks; ends: of the searches, one after the other
    asked   what each search was given
    """

    def __init__(self, monkeypatch):
        self.faults, self.ends, self.asked = [], [], []
        monkeypatch.setattr(diagnose, "shaft_fault", self.checked)
        monkeypatch.setattr(diagnose, "search_records", self.searched)

    def checked(self, corrected, drive, *_):
        if self.faults is None:
            raise np.linalg.LinAlgError
        return corrected, drive, self.faults

    def searched(self, *given):
        self.asked.append(given)
        if not self.ends:
            raise Stopped
        return self.ends.pop(0)


class Stopped(Exception):
    """There is no end of another search."""


@pytest.fixture
def stages(monkeypatch):
    return Stages(monkeypatch)


@pytest.mark.parametrize("breaks", [False, True])
def test_a_failed_check_of_the_shaft_torque_is_reported(breaks, stages):
    """A diagnosis goes on without it: here to its search, which is looked at and not made."""
    stages.faults = None if breaks else []
    machine = machine_by_seed(5)
    record, drive = linear_record(machine, 5, 2.0), drive_like(machine, list(FREE))
    with pytest.raises(Stopped):
        diagnose.diagnose([record], drive, FREE, DiagnoseOptions())
    ((request, *_),) = stages.asked
    assert [f.code for f in request.notes] == (["shaft-torque-unchecked"] if breaks else [])


def fault(code, **more):
    return Fault(code, None, **more)


@pytest.mark.parametrize(("causes", "scale_likelier", "faults", "trusts"), [
    (("friction-drift",), False, [fault("wrong-scale", factor=1.09, shaft=True)], True),
    (("friction-drift",), True, [fault("wrong-scale", factor=1.09, shaft=True)], False),
    ((), False, [fault("wrong-scale", factor=1.09, shaft=True)], False),  # no law explains anything
    (("friction-drift",), False, [fault("wrong-scale", factor=1.09)], False)])  # by two sensors of one motion
def test_a_shaft_torque_is_trusted_where_laws_explain_as_much(stages, causes, scale_likelier, faults, trusts):
    """Warming up, left out of the drive, was a sensor that reads 1.09 times the torque."""
    blamed = ended(model_of(value=-9.0 if scale_likelier else 0.0), faults=faults)
    stages.ends = [other] = [ended(SHAFT_LOGGED, causes)]
    assert (diagnose.with_trusted_sensor(None, blamed, ("as logged",), None) is other) == trusts


@pytest.mark.parametrize("rounds", [(), (Round(1),)])
def test_where_rounding_alone_is_left_no_sample_is_impossible(monkeypatch, stages, rounds):
    """On a record without noise the innovations are its last digits. And the fault of the sensor is reported in
    no search that trusts it.
    """
    calls = []
    stages.faults = [fault("wrong-scale", factor=1.09, shaft=True)]
    blamed = ended(true_model(), ("friction-drift",), faults=stages.faults, rounds=rounds)
    stages.ends = [blamed, ended(replace(SHAFT_LOGGED, value=99.0), ("friction-drift",))]
    monkeypatch.setattr(diagnose, "without_model_outliers", lambda *_: calls.append(1) or ((), []))
    monkeypatch.setattr(diagnose, "diagnosis_of", lambda search, *_: search)
    machine = machine_by_seed(5)
    record, drive = linear_record(machine, 5, 2.0), drive_like(machine, list(FREE))
    record = replace(record, signals={**record.signals, "shaft_torque": 0.9 * record.signals["motor_torque"]})
    assert diagnose.diagnose([record], drive, FREE, DiagnoseOptions()) is blamed
    assert bool(calls) == bool(rounds)
    assert [[f.code for f in faults] for *_, faults in stages.asked] == [["wrong-scale"], []]


def test_once_a_dead_time_is_known_only_what_had_a_chance_is_looked_for_again(stages):
    """In less of the records; of the others stands what was said before, and faults are none of a search."""
    def lines(**states):
        return tuple(CandidateResult(code.replace("_", "-"), state, gain=gain)
                     for code, (state, gain) in states.items())

    before = ended(rounds=(
        Round(1, "dead-time", candidates=lines(dead_time=("named", 90.0), converter_lag=("worse", None),
                                               backlash=("no-gain", None), imbalance=("not-shown", None))),
        Round(2, candidates=lines(quadratic_drag=("no-gain", -3.0), backlash=("no-gain", None)))))
    after = ended(rounds=(Round(1, "dead-time", candidates=lines(
        dead_time=("named", 95.0), converter_lag=("worse", 60.0), quadratic_drag=("no-gain", None))),))
    stages.ends = [after]
    wanted = ("dead-time", "converter-lag", "backlash", "imbalance", "quadratic-drag", "outliers")
    own = diagnose.Request(1, (None, ()), (), wanted, DiagnoseOptions(), {}, ())
    found = diagnose.repeated_search(own, before, ("less",), None, ())
    ((asked, records, *_),) = stages.asked
    assert (asked.wanted, records) == (("dead-time", "converter-lag", "quadratic-drag", "outliers"), ("less",))
    (one,) = found.rounds
    assert {c.code: (c.state, c.gain) for c in one.candidates} == {
        "dead-time": ("named", 95.0), "converter-lag": ("worse", 60.0), "quadratic-drag": ("no-gain", None),
        "backlash": ("no-gain", None), "imbalance": ("not-shown", None)}
    assert replace(found, rounds=()) == replace(after, rounds=())
