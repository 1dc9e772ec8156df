"""A gap before a load of low inertia, whose likelihood has many local optima: the fit ends at the true values."""

import pytest

from drivetool.check.fit.model import all_samples, fit_from_start
from drivetool.check.starts.backlash_multistart import backlash_fits
from drivetool.identify.setup import Task, roles_of
from tests.hidden import greybox_options, make_case, write_start
from tests.hidden.command import grade, greybox_and_diagnose
from tests.recover import drive_like, experiment, tried

FREE = ["motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "total.viscous", "total.idle_torque"]


def base_of(case):
    """The base of a diagnosis, started 10 % off the true values."""
    signals, machine = case.records[0].logged, case.rig.machine
    record = experiment(signals["motor_torque"], signals["motor_speed"])
    drive = drive_like(machine, FREE, off=0.1, seed=3)
    return fit_from_start(Task(drive, tuple(FREE), roles_of([record], drive), (record,)))


@pytest.mark.slow
def test_a_gap_before_a_load_of_low_inertia_is_found_where_it_is():
    """Load of 18 % of the motor; from a few half gaps alone the fit ended 750 of log likelihood higher."""
    case = make_case("backlash", 361031, seed=361031)
    base = base_of(case)
    model = tried("backlash", base).model
    values, label = model.fitted.drive.values, case.label(visibility=False)
    assert model.value < base.value - 1000.0
    assert values["shaft.half_gap"] == pytest.approx(label["effects"][0]["truth"]["shaft.half_gap"], rel=0.02)
    for name in ("load.inertia", "shaft.stiffness"):
        assert values[name] == pytest.approx(label["plain"][name], rel=0.03), name


@pytest.mark.slow
def test_a_load_of_high_inertia_takes_no_such_search_and_a_linear_shaft_is_given_up_soon():
    high_inertia = base_of(make_case("none", 351001, seed=351001))
    assert backlash_fits(high_inertia, all_samples(high_inertia.problem)) == []
    low_inertia = base_of(make_case("none", 361031, seed=361031))
    ends = backlash_fits(low_inertia, all_samples(low_inertia.problem))
    assert ends and ends[0].value > low_inertia.value - 10.0  # no gap, no gain


@pytest.mark.slow
def test_a_gap_that_no_second_optimum_confirms_has_no_interval(tmp_path):
    """The best local optimum found is 8 % off, and others are close behind it."""
    case = make_case("backlash", 361028, seed=361028)
    logs, _ = case.write_records(tmp_path)
    answer = greybox_and_diagnose(tmp_path, logs, write_start(case, tmp_path), greybox_options(case),
                 ["--candidates", "backlash,hardening-stiffness"])
    assert grade(case.label(False)["causes"], answer) == "right", answer.stderr
    gap = answer.parameters["shaft.half_gap"]
    assert gap["std"] is None and gap["ci95"] is None and "warning not-converged" in answer.stderr


@pytest.mark.long
def test_a_gap_in_the_shaft_torque_is_no_wrong_scale_of_its_sensor(tmp_path):
    """Without the gap the base took that sensor for exact, and every gap fit ended in a wrong optimum."""
    case = make_case("backlash", 371024, seed=371024, sensors=("motor_speed", "shaft_torque"))
    logs, _ = case.write_records(tmp_path)
    answer = greybox_and_diagnose(tmp_path, logs, write_start(case, tmp_path), greybox_options(case),
                 ["--candidates", "backlash,hardening-stiffness,wrong-scale"])
    label = case.label(visibility=False)
    assert grade(label["causes"], answer) == "right", answer.stderr
    low, high = answer.parameters["shaft.half_gap"]["ci95"]
    assert low < label["effects"][0]["truth"]["shaft.half_gap"] < high
