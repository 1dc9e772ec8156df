"""Which end of a drive has a law that both may have: reported where the record does not identify it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivetool.check.fit.model import fit_from_start
from drivetool.check.search.result import SelectedCauses
from drivetool.check.verdict.which_body import unidentified_body_findings
from drivetool.drive import two_mass
from drivetool.drive.chain import three_mass
from drivetool.identify.setup import Task, roles_of
from drivetool.logs.door import open_experiment
from tests.check.models import ended
from tests.hidden import make_case
from tests.identify.test_friction_split import MACHINE, TRUE
from tests.recover import reversing_record


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A record of a drive with drag at its motor, its true values, and the size of the drag."""
    folder = tmp_path_factory.mktemp("drag")
    case = make_case("quadratic-drag", 3, sensors=("motor_speed", "shaft_torque"), duration=6.0)
    logs, _ = case.write_records(folder)
    label = case.label(False)
    (name, value), = label["effects"][0]["truth"].items()
    return open_experiment(logs[0], None), label["plain"], name.partition(".")[0], value


@pytest.mark.slow
@pytest.mark.parametrize(("roles", "found"), [(("motor_speed",), True), (("motor_speed", "shaft_torque"), False)])
def test_the_motor_alone_does_not_identify_the_body_of_a_drag(diagnosed, roles, found):
    record, plain, owner, value = diagnosed
    record = replace(record, signals={r: record.signals[r] for r in ("motor_torque", *roles)})
    drive = two_mass().with_values({n: v for n, v in plain.items() if n in two_mass().quantities})
    task = Task(drive, tuple(n for n in drive.quantities if n in plain), roles_of([record], drive), (record,))
    name = f"{owner}.drag"
    free = tuple(n for n in drive.quantities if n in {*task.free, name})
    model = fit_from_start(replace(task, drive=drive.with_values({name: value}), free=free))
    found_law = SelectedCauses(("quadratic-drag",), added={"quadratic-drag": (name,)})
    search = ended(replace(model, code="quadratic-drag"), found=found_law)
    notes = unidentified_body_findings(search)
    assert [f.code for f in notes] == ["location-not-identifiable"] * found
    if found:
        other = next(n for n in notes[0].evidence if n.endswith(".drag"))
        assert other != name and notes[0].evidence[other] == pytest.approx(value, rel=0.1)
        assert "Log the shaft torque" in notes[0].action


@pytest.mark.slow
def test_of_a_chain_the_likeliest_other_body_is_named():
    """Drag of the middle body, which moves as the last one does behind a stiff shaft."""
    machine = replace(MACHINE, effects=replace(MACHINE.effects, quadratic=(0.0, 0.02, 0.0)))
    record, _ = reversing_record(machine, 5, 6.0)
    drive = three_mass().with_values({**TRUE, "gear.drag": 0.02})
    free = tuple(n for n in drive.quantities if n in {*TRUE, "gear.drag"})
    task = Task(drive, free, roles_of([record], drive), (record,))
    model = replace(fit_from_start(task), code="quadratic-drag")
    search = ended(model, found=SelectedCauses(("quadratic-drag",), added={"quadratic-drag": ("gear.drag",)}))
    (note,) = unidentified_body_findings(search)
    assert note.code == "location-not-identifiable" and "gear.drag" in note.text
    assert note.evidence["arm.drag"] == pytest.approx(0.02, rel=0.1)
