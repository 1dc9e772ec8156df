"""A finding about one parameter names it: one of the estimate's, replaced where a finding says more of it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.drive import TOTALS, two_mass
from drivetool.finding import Finding
from drivetool.identify.acceleration.estimator import as_drive_parameters, rigid_of
from drivetool.identify.estimate.estimate import Covariance, Estimate, Parameter
from drivetool.identify.estimate.interval_and_status import experiment_for, parameters_of
from drivetool.identify.estimate.verdict import Verdict, judged, masked
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.identifiability import joint_identifiability
from drivetool.identify.identifiability.joint_identifiability import ratios_of_torques
from drivetool.identify.identifiability.one_sided_backlash import without_upper_limit
from drivetool.identify.identifiability.shaft_likelihood_ratio import insignificant_shafts
from drivetool.identify.outcome.composition import compose
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from drivetool.quantity import name_of, quantity_of
from tests.recover import drive_like, linear_record, truth
from tests.simulator.machine import machine_by_seed

MACHINE = machine_by_seed(5)
SHAPE = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping")
FRICTIONS = ("motor.viscous", "load.viscous", "motor.idle_torque", "load.idle_torque")


def not_identifiable(name, begins=None):
    """A finding on a parameter, or on others with the same code."""
    return Finding("warning", "not-identifiable", f"{begins or name} is not identifiable.", parameter=name)


def parameters_of_findings(estimate):
    """Parameters that the findings are about; each is one of the estimate, and named in the text."""
    said = {f.parameter: f for f in estimate.findings if f.parameter is not None}
    assert set(said) <= {p.name for p in estimate.parameters}
    assert all(name in f.text for name, f in said.items())
    return set(said)


@pytest.fixture(scope="module")
def outcome():
    """Two seconds of torque steps in one direction, which identify sums of frictions and none of their parts."""
    values = truth(MACHINE)
    drive = drive_like(MACHINE, SHAPE).with_values(dict.fromkeys(FRICTIONS[:2], values["total.viscous"] / 2.0) | (
        dict.fromkeys(FRICTIONS[2:], values["total.idle_torque"] / 2.0)))
    drive = replace(drive, values={n: v for n, v in drive.values.items() if not n.startswith("total.")})
    record = linear_record(MACHINE, 51, 2.0)
    return by_innovations(Task(drive, ("motor.inertia", *FRICTIONS), roles_of([record], drive), (record,)), [{}])


def test_an_unidentified_parameter_is_one_of_the_estimate(outcome):
    estimate = compose("greybox", outcome.task.drive, outcome, Options())
    lines = {p.name for p in estimate.parameters if p.status == "not-identifiable"}
    assert parameters_of_findings(estimate) == lines and lines >= set(FRICTIONS[2:])


def test_the_factor_of_a_law_is_no_parameter_of_the_drive(outcome):
    """It is fitted, and reported like one."""
    drive = outcome.task.drive
    names = tuple("motor.law1" if n == "motor.idle_torque" else n for n in outcome.problem.names)
    known = replace(drive, known_torques=("motor.law1",))
    found = replace(outcome, task=replace(outcome.task, drive=known),
                    problem=replace(outcome.problem, names=names))
    _, _, findings = parameters_of(found.problem, found.solution, known, known)
    assert [f.parameter for f in findings if f.text.startswith("motor.law1 ")] == [None]
    assert "load.idle_torque" in {f.parameter for f in findings}


def test_a_finding_on_ratios_is_about_no_single_parameter(outcome, monkeypatch):
    monkeypatch.setattr(joint_identifiability, "only_ratios", lambda outcome: True)
    lines = tuple(Parameter(name=n, value=1.0, unit="") for n in outcome.task.free)
    estimate = Estimate("greybox", outcome.drive, lines, "", {})
    one = SimpleNamespace(task=SimpleNamespace(free=("motor.inertia", "motor.clamped")), drive=outcome.drive)
    several, alone = (ratios_of_torques(estimate, o).findings[0] for o in (outcome, one))
    assert several.parameter is None and alone.parameter == "motor.inertia"


def test_only_the_findings_of_that_parameter_are_replaced():
    near = not_identifiable("shaft2.half_gap")
    together = not_identifiable(None, "shaft.half_gap, load.inertia")
    other = Finding("warning", "gap-ambiguous", "shaft.half_gap is one of two.", parameter="shaft.half_gap")
    line = Parameter(name="shaft.half_gap", value=0.01, unit="rad")
    before = Estimate("backlash", two_mass(), (line,), "", {},
                      findings=(near, not_identifiable("shaft.half_gap"), together, other))
    assert judged(before, [lambda e: Verdict(lines=e.parameters)]).findings == (near, together, other)


def test_a_parameter_without_an_interval_has_no_covariance():
    """A later step takes what has a covariance for known."""
    lines = tuple(Parameter(name=n, value=1.0, unit="", std=0.1) for n in SHAPE)
    before = Estimate("greybox", two_mass(), lines, "", {}, Covariance(SHAPE, np.eye(len(SHAPE))))
    found = judged(before, [lambda e: Verdict(lines=masked(e, "a reason", names=SHAPE[:1]))])
    assert found.covariance.names == SHAPE[1:] and found.line(SHAPE[0]).status == "not-identifiable"
    assert judged(found, [lambda e: Verdict(lines=masked(e, "a reason"))]).covariance is None


def test_each_check_sees_what_those_before_it_left():
    line = Parameter(name="shaft.half_gap", value=0.01, unit="rad", std=0.001)
    seen = []

    def check(estimate):
        seen.append(estimate.parameters[0].std)
        return Verdict(lines=masked(estimate, "a reason"))

    judged(Estimate("backlash", two_mass(), (line,), "", {}), [check, check])
    assert seen == [0.001, None]


def test_a_gap_with_a_lower_bound_is_reported_once():
    drive = two_mass().with_values({"shaft.half_gap": 0.01})
    before = Estimate("greybox", drive, (Parameter(name="shaft.half_gap", value=0.01, unit="rad"),), "", {},
                      findings=(not_identifiable("shaft.half_gap"),))
    found = judged(before, [lambda e: without_upper_limit(e, "shaft.half_gap", 0.008)])
    assert [f.code for f in found.findings] == ["gap-unbounded"] and parameters_of_findings(found) == {
        "shaft.half_gap"}


def test_an_insignificant_shaft_replaces_the_findings_of_its_parameters():
    drive = two_mass()
    lines = tuple(Parameter(name=n, value=1.0, unit="") for n in (*SHAPE, "motor.coulomb"))
    before = Estimate("greybox", drive, lines, "", {}, findings=tuple(not_identifiable(p.name) for p in lines))
    found = judged(before, [lambda e: insignificant_shafts(e, {"shaft": 1.0})])
    assert parameters_of_findings(found) == {"motor.coulomb"}
    assert [f.code for f in found.findings] == ["not-identifiable", "shaft-not-identifiable"]
    assert {p.name for p in found.parameters if p.status == "not-identifiable"} == set(SHAPE)


def test_of_one_body_for_a_drive_the_parameter_is_that_of_the_drive():
    drive = two_mass().with_values({"motor.inertia": 0.01, "load.inertia": 0.02})
    rigid = rigid_of(drive, Options())
    lines = tuple(Parameter(name=n, value=1.0, unit="") for n in rigid.names)
    one = Estimate("greybox", drive, lines, "", {},
                   findings=(not_identifiable("motor.viscous"), not_identifiable(None, "All")))
    assert parameters_of_findings(as_drive_parameters(one, drive, rigid)) == {"total.viscous"}


def test_the_experiment_is_that_of_the_effect_that_has_the_parameter():
    drive = two_mass()
    for effect, owner, _ in drive.effects():
        for name in (name_of(owner, quantity) for quantity in effect.quantities):
            if quantity_of(name) not in TOTALS.values():
                assert effect.needs in experiment_for(name, drive)
    assert "both directions" in experiment_for("load.coulomb", drive)
    assert experiment_for("total.viscous", drive) != experiment_for("load.viscous", drive)
