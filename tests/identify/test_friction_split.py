"""Friction of each body of a chain, where a sensor makes it identifiable."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive.chain import three_mass
from drivetool.errors import BadOption
from drivetool.identify.fit.friction_split import tasks_with_parts
from drivetool.identify.fit.friction_totals import with_totals
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from tests.recover import STEP, experiment
from tests.simulator.experiments import multisine
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

# A motor with as much friction and idle torque as all that it drives.
MACHINE = Machine(inertia=(1.3, 0.5, 0.45), viscous=(1.2, 0.5, 0.7), idle_torque=(2.0, 0.0, 1.5),
                  stiffness=(6500.0, 19000.0), damping=(2.6, 7.4), rated_torque=60.0)
TRUE = {"motor.inertia": 1.3, "gear.inertia": 0.5, "arm.inertia": 0.45, "shaft.stiffness": 6500.0,
        "shaft.damping": 2.6, "shaft2.stiffness": 19000.0, "shaft2.damping": 7.4, "total.viscous": 2.4,
        "total.idle_torque": 3.5}


def recorded(size=4000, machine=MACHINE, loud=1.0):
    lines = np.concatenate([[0.5, 1.25, 2.5], np.linspace(6.0, 55.0, 25)])
    torque = 3.5 + 4.0 * multisine(lines, 3.0, size * STEP, STEP, 1)[:size]
    run = simulate_linear(machine, torque, STEP, None, loud * white_noise(size, 0.05, 2))
    return experiment(torque, run.speeds[:, 0] + loud * white_noise(size, 5e-3, 3),
                      shaft_torque=run.shaft_torques[:, 0] + loud * white_noise(size, 0.05, 4))


@pytest.mark.slow
def test_a_shaft_torque_separates_the_motor_from_its_load_and_no_more():
    record, start = recorded(), three_mass().with_values({n: 1.02 * v for n, v in TRUE.items()})
    found = {p.name: p for p in greybox([record], start, Options()).parameters}
    motor, behind = found["motor.idle_torque"], found["arm.idle_torque"]
    assert motor.ci95[0] <= 2.0 <= motor.ci95[1] and abs(behind.value - 1.5) < 0.1
    assert motor.std < 0.1
    # On which body behind the shaft a constant torque acts is not identifiable: it is put on the last body, and the
    # interval is that of their sum.
    assert found["gear.idle_torque"].value == 0.0 and found["gear.idle_torque"].std is None
    assert behind.std is None and "the friction of gear" in behind.reason and "contained in the value of arm" in (
        found["gear.idle_torque"].reason)
    # So much viscous friction damps the inner mode: each is identifiable.
    for body, viscous in zip(("motor", "gear", "arm"), MACHINE.viscous, strict=True):
        assert found[f"{body}.viscous"].value == pytest.approx(viscous, abs=3.0 * found[f"{body}.viscous"].std)


@pytest.mark.slow
def test_an_interval_allows_for_friction_between_that_is_counted_with_the_last_body():
    """It damps the shafts as their own damping does: without that allowance one is 8.1 standard errors off."""
    machine = replace(MACHINE, viscous=(0.1, 0.3, 0.0))
    start = three_mass().with_values({n: 1.02 * v for n, v in TRUE.items()} | {"total.viscous": 0.4})
    found = {p.name: p for p in greybox([recorded(machine=machine, loud=10.0)], start, Options()).parameters}
    assert "contained in the value of arm" in found["gear.viscous"].reason
    together = float(found["arm.viscous"].reason.rpartition(" ")[2])
    assert abs(found["arm.viscous"].value - 0.3) < 3.0 * together and together < 0.02
    for name in ("shaft.damping", "shaft2.damping", "shaft.stiffness", "shaft2.stiffness", "arm.inertia"):
        assert abs(found[name].value - TRUE[name]) < 3.0 * found[name].std, name


@pytest.mark.slow
def test_the_sum_stays_one_where_only_the_motor_is_measured():
    record, start = recorded(), three_mass().with_values({n: 1.02 * v for n, v in TRUE.items()})
    alone = experiment(record.signals["motor_torque"], record.signals["motor_speed"])
    found = {p.name: p for p in greybox([alone], start, Options()).parameters}
    total = found["total.idle_torque"]
    assert total.ci95[0] <= 3.5 <= total.ci95[1] and "motor.idle_torque" not in found


@pytest.mark.parametrize("ratio", [1.0, 4.0])
def test_however_a_sum_is_split_its_value_at_the_motor_is_the_same(ratio):
    drive = three_mass().with_values({**TRUE, "shaft2.ratio": ratio})
    record = recorded(100)
    for total, whole in (("total.viscous", 2.4), ("total.idle_torque", 3.5)):
        tasks = tasks_with_parts(Task(drive, (total,), roles_of([record], drive), (record,)), total)
        assert [len(parts) for _, parts in tasks] == [3, 2]  # of all bodies, of the first and the last
        for task, _ in tasks:
            assert task.drive.referred_to_motor(total.partition(".")[2]) == pytest.approx(whole, rel=1e-12)


@pytest.mark.slow
def test_idle_torques_that_cancel_are_identified_from_a_shaft_torque():
    """Their sum is zero. Split by rule each would be zero too, as if there were no idle torque."""
    machine = replace(MACHINE, idle_torque=(2.0, 0.0, -2.0))
    lines = np.concatenate([[0.5, 1.25, 2.5], np.linspace(6.0, 55.0, 25)])
    torque = 4.0 * multisine(lines, 3.0, 4000 * STEP, STEP, 1)[:4000]
    run = simulate_linear(machine, torque, STEP, None, white_noise(4000, 0.05, 2))
    record = experiment(torque, run.speeds[:, 0] + white_noise(4000, 5e-3, 3),
                        shaft_torque=run.shaft_torques[:, 0] + white_noise(4000, 0.05, 4))
    values = {**TRUE, "total.idle_torque": 0.0}
    found = {p.name: p for p in greybox([record], three_mass().with_values(values), Options()).parameters}
    motor, behind = found["motor.idle_torque"], found["arm.idle_torque"]
    assert motor.ci95[0] <= 2.0 <= motor.ci95[1] and abs(behind.value + 2.0) < 0.1


def test_the_parts_of_a_known_sum_that_are_to_be_free_take_its_place():
    known = three_mass().with_values(TRUE)
    split = with_totals(known, ("gear.viscous",))
    assert "total.viscous" not in split.values and split.value("total.idle_torque") == TRUE["total.idle_torque"]
    assert split.referred_to_motor("viscous") == pytest.approx(TRUE["total.viscous"], rel=1e-12)
    assert with_totals(known, ("gear.inertia",), ("gear.viscous",)) == known
    with pytest.raises(BadOption, match=r"either total\.viscous or its parts after --free; found"):
        with_totals(known, ("total.viscous", "arm.viscous"))
