"""A finding about one parameter says which: it is one of the estimate, and gives way where more is known of it."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from drivetool.drive import two_mass
from drivetool.errors import Finding
from drivetool.identify.acceleration.estimator import in_the_drive, rigid_of
from drivetool.identify.estimate.estimate import Estimate, Parameter
from drivetool.identify.estimate.interval_and_status import parameters_of, without_untold
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.identifiability.joint_identifiability import without_sizes
from drivetool.identify.identifiability.shown import not_of_shaft
from drivetool.identify.identifiability.uncrossed import from_below
from drivetool.identify.outcome.composition import compose
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from tests.recover import drive_like, linear_record, truth
from tests.simulator.machine import machine_by_seed

MACHINE = machine_by_seed(5)
SHAPE = ["motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping"]
FRICTIONS = ("motor.viscous", "load.viscous", "motor.idle_torque", "load.idle_torque")


def untold(name, begins=None):
    """What a fit says of a parameter, or of others by the same word."""
    return Finding("warning", "not-identifiable", f"{begins or name} cannot be told.", parameter=name)


def about(estimate):
    """Parameters that the findings are about; each is one of the estimate, and named in the text."""
    said = {f.parameter: f for f in estimate.findings if f.parameter is not None}
    assert set(said) <= {p.name for p in estimate.parameters}
    assert all(name in f.text for name, f in said.items())
    return set(said)


@pytest.fixture(scope="module")
def outcome():
    """Two seconds of torque steps in one direction, which tell sums of frictions and none of their parts."""
    values = truth(MACHINE)
    drive = drive_like(MACHINE, SHAPE).with_values(dict.fromkeys(FRICTIONS[:2], values["total.viscous"] / 2.0) | (
        dict.fromkeys(FRICTIONS[2:], values["total.idle_torque"] / 2.0)))
    drive = replace(drive, values={n: v for n, v in drive.values.items() if not n.startswith("total.")})
    record = linear_record(MACHINE, 51, 2.0)
    return by_innovations(Task(drive, ("motor.inertia", *FRICTIONS), roles_of([record], drive), (record,)), [{}])


def test_what_a_fit_cannot_tell_is_a_parameter_of_its_estimate(outcome):
    estimate = compose("greybox", outcome.task.drive, outcome)
    lines = {p.name for p in estimate.parameters if p.status == "not-identifiable"}
    assert about(estimate) == lines and lines >= set(FRICTIONS[2:])


def test_the_factor_of_a_law_is_no_parameter_of_the_drive(outcome):
    """It is fitted, and told of like one."""
    drive = outcome.task.drive
    names = tuple("motor.law1" if n == "motor.idle_torque" else n for n in outcome.problem.names)
    known = replace(drive, known_torques=("motor.law1",))
    found = replace(outcome, task=replace(outcome.task, drive=known),
                    problem=replace(outcome.problem, names=names))
    _, _, findings = parameters_of(found.problem, found.solution, known, known)
    assert [f.parameter for f in findings if f.text.startswith("motor.law1 ")] == [None]
    assert "load.idle_torque" in {f.parameter for f in findings}


def test_of_sizes_told_over_each_other_none_is_meant_alone(outcome):
    lines = [Parameter(n, 1.0, "") for n in outcome.task.free]
    one = SimpleNamespace(task=SimpleNamespace(free=("motor.inertia", "motor.clamped")), drive=outcome.drive)
    several, alone = without_sizes(lines, outcome)[1], without_sizes(lines, one)[1]
    assert several.parameter is None and alone.parameter == "motor.inertia"


def test_only_what_is_said_of_that_parameter_gives_way():
    near = untold("shaft2.half_gap")
    together = untold(None, "shaft.half_gap, load.inertia")
    other = Finding("warning", "half-gap-ambiguous", "shaft.half_gap is one of two.", parameter="shaft.half_gap")
    told = [near, untold("shaft.half_gap"), together, other]
    assert without_untold(told, {"shaft.half_gap"}) == [near, together, other]


def test_a_gap_that_is_known_from_below_is_told_once():
    drive = two_mass().with_values({"shaft.half_gap": 0.01})
    before = Estimate("greybox", drive, (Parameter("shaft.half_gap", 0.01, "rad"),), "", {},
                      findings=(untold("shaft.half_gap"),))
    found = from_below(before, "shaft.half_gap", 0.008)
    assert [f.code for f in found.findings] == ["half-gap-unbounded"] and about(found) == {"shaft.half_gap"}


def test_a_shaft_that_does_not_show_takes_what_was_said_of_its_parameters():
    drive = two_mass()
    lines = tuple(Parameter(n, 1.0, "") for n in (*SHAPE, "motor.coulomb"))
    before = Estimate("greybox", drive, lines, "", {}, findings=tuple(untold(p.name) for p in lines))
    assert about(not_of_shaft(before, "shaft", "it does not show")) == {"motor.coulomb"}


def test_of_one_body_for_a_drive_the_parameter_is_that_of_the_drive():
    drive = two_mass().with_values({"motor.inertia": 0.01, "load.inertia": 0.02})
    rigid = rigid_of(drive, Options())
    lines = tuple(Parameter(n, 1.0, "") for n in rigid.names)
    one = Estimate("greybox", drive, lines, "", {}, findings=(untold("motor.viscous"), untold(None, "All")))
    assert about(in_the_drive(one, drive, rigid)) == {"total.viscous"}
