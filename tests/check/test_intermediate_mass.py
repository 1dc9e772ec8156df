"""Friction of a body in the middle of a chain, as the load is once a third mass has been split off behind it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from drivetool.check.causes.catalogue import CAUSES
from drivetool.check.fit.model import Model, fit_from_start
from drivetool.drive.chain import three_mass
from drivetool.identify.setup import Task, roles_of
from tests.identify.test_friction_split import MACHINE, TRUE
from tests.recover import reversing_record, tried

SOFT = {"shaft2.stiffness": 3000.0, "shaft2.damping": 1.2}  # a second shaft: bodies move separately


@cache
def fitted(coulomb: tuple[float, ...]) -> Model:
    """A chain of three bodies, fitted without the dry friction that one of them has."""
    machine = replace(MACHINE, coulomb=coulomb, stiffness=(6500.0, SOFT["shaft2.stiffness"]),
                      damping=(2.6, SOFT["shaft2.damping"]))
    record, _ = reversing_record(machine, 5, 6.0)
    drive = three_mass().with_values({**TRUE, **SOFT, "motor.coulomb": 0.0})
    return fit_from_start(Task(drive, tuple(TRUE), roles_of([record], drive), (record,)))


@pytest.mark.parametrize(("code", "amplitudes"), [
    ("coulomb-motor", {"motor.coulomb"}),
    ("coulomb-load", {"gear.coulomb", "arm.coulomb"}),
    ("stribeck-load", {"gear.stribeck", "gear.coulomb", "arm.stribeck", "arm.coulomb"}),
    ("quadratic-drag", {"motor.drag", "gear.drag", "arm.drag"})])
def test_friction_behind_the_motor_is_looked_for_on_every_body(code, amplitudes):
    starts = CAUSES[code].starts(fitted((0.0, 1.5, 0.0)))
    assert {name for start in starts for name in start.amplitudes} == amplitudes


@pytest.mark.slow
@pytest.mark.parametrize(("coulomb", "body"), [((0.0, 1.5, 0.0), "gear"), ((0.0, 0.0, 1.5), "arm")])
def test_dry_friction_behind_the_motor_is_found_on_its_body(coulomb, body):
    base = fitted(coulomb)
    best = tried("coulomb-load", base).model
    assert f"{body}.coulomb" in best.task.free and base.value - best.value > 500.0
    assert best.fitted.drive.value(f"{body}.coulomb") == pytest.approx(1.5, rel=0.01)
