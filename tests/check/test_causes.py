"""The contract of every cause, and that no file but its own knows it by name."""

from __future__ import annotations

import ast
from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.causes.catalogue import CAUSES, DECISIVE_EXPERIMENTS, FITTED, mistaken_for
from drivetool.check.fit.model import fit_from_start
from drivetool.check.fit.structure import transferred_point
from drivetool.check.search.absence import law_of, needs_of, why_absent
from drivetool.drive import two_mass
from drivetool.drive.effects import EFFECTS
from drivetool.identify.setup import Task, roles_of
from tests.places import ROOT
from tests.recover import reversing_record
from tests.simulator.machine import machine_by_seed

FOLDER = ROOT / "drivetool" / "check" / "causes"
# Files of faults of the record, and of what is said in the end, that still know a cause by its name.
KNOWING = {"full_diagnosis.py", "facts.py", "rules.py", "record_faults.py", "shaft.py", "spikes.py",
           "diagnosis_report.py"}

STARTLESS = {"torque-offset"}  # an idle torque of the base is the same
ACROSS_GAP = {"damping-in-gap"}


@pytest.fixture(scope="module")
def base():
    """A plain two-mass drive on a record that reverses, all of it free."""
    machine = machine_by_seed(23)
    record, _ = reversing_record(machine, 23)
    drive = two_mass().with_values({
        "motor.inertia": machine.inertia[0], "load.inertia": machine.inertia[1],
        "total.viscous": sum(machine.viscous), "total.idle_torque": 0.0,
        "shaft.stiffness": machine.stiffness[0], "shaft.damping": machine.damping[0]})
    free = tuple(n for n in drive.quantities if n in drive.values)
    return fit_from_start(Task(drive, free, roles_of([record], drive), (record,)), max_iterations=1)


def test_codes_are_words_of_their_own_and_files_are_short():
    files = sorted(FOLDER.glob("*.py"))
    assert len(CAUSES) == sum(path.read_text().count("Cause(\n") + path.read_text().count("Cause(\"")
                              for path in files if path.name != "cause.py")
    assert all(path.read_text().count("\n") <= 150 for path in files)
    assert all(code == cause.code and code.islower() and cause.name for code, cause in CAUSES.items())


@pytest.mark.parametrize("code", CAUSES)
def test_words_and_relations(code):
    cause = CAUSES[code]
    assert cause.text.endswith(".") and cause.look.endswith(".") and cause.sizes
    assert {*cause.special, *cause.alike, *cause.response} <= {*CAUSES} - {code}
    assert all(text.endswith(".") and DECISIVE_EXPERIMENTS[frozenset((code, other))] == text
               for other, text in cause.alike.items())
    assert {*cause.further, *filter(None, [cause.effect])} <= {e.code for e in EFFECTS}
    assert needs_of(cause) and (cause.of_record or law_of(cause))
    for other in cause.response:
        assert code in CAUSES[other].response, f"the file of {other} must have {code} in its response, too"
    assert all(other in mistaken_for([code]) for other in cause.alike)


def starts_on(code, base):
    """The base, of a drive with a gap where a cause needs one."""
    if code not in ACROSS_GAP:
        return base
    task = base.task.at({"shaft.half_gap": 0.002})
    return replace(base, task=task, problem=task.problem())


@pytest.mark.parametrize("code", [c.code for c in FITTED])
def test_a_cause_has_starts_or_says_why_not(code, base):
    """What is free in a start, and what a start adds, belongs to the drive; amplitudes are free and begin small."""
    base = starts_on(code, base)
    cause, base_drive = CAUSES[code], base.task.drive
    starts = cause.starts(base)
    if not starts:
        state, reason = why_absent(cause, base)
        assert code in STARTLESS and state == "in-the-model" and reason, "no start on this base: is that meant?"
        return
    assert code not in STARTLESS
    for start in starts:
        new = [n for n in start.task.free if n not in base.task.free]
        assert set(start.amplitudes) <= set(new) and set(start.task.free) <= set(start.task.drive.quantities)
        longer = start.task.drive.bodies != base_drive.bodies
        assert longer or any(cause.has(n) for n in start.task.drive.values if n not in base_drive.values)
        values = [start.task.drive.value(n) for n in new]
        assert np.isfinite(values).all()
        for name, (low, high) in (cause.bounds(base, start.task) if cause.bounds else {}).items():
            assert low <= start.task.drive.value(name) <= high
    if cause.trace is not None:
        assert not starts[0].amplitudes and set(cause.trace(base).task.free) > set(base.task.free)


@pytest.mark.parametrize("code", [c.code for c in FITTED if c.effect and c.code not in STARTLESS])
def test_what_acts_already_is_not_looked_for(code, base):
    """With a start of it as its base a cause has none of the same body left, or says that it is in the model."""
    base, cause = starts_on(code, base), CAUSES[code]
    before = cause.starts(base)
    problem = before[0].task.problem()
    there = replace(base, task=before[0].task, problem=problem,
                    point=transferred_point(base, before[0].task, problem))
    assert len(cause.starts(there)) < len(before)


def test_only_its_own_file_knows_a_cause_by_name():
    """Effects have codes of their own, which some causes share: those rooms are not searched."""
    found = set()
    for path in sorted((ROOT / "drivetool" / "check").rglob("*.py")):
        if FOLDER in path.parents:
            continue
        words = {node.value for node in ast.walk(ast.parse(path.read_text()))
                 if isinstance(node, ast.Constant) and isinstance(node.value, str)}
        found |= {path.name} if words & set(CAUSES) else set()
    assert found == KNOWING
