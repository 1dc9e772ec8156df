"""A gap or a third mass that a model of two masses lacks is found by likelihood ratio, and nothing else."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from drivetool.drive import two_mass
from drivetool.identify.fit.engine import by_innovations, looks_coloured, with_coloured_noise
from drivetool.identify.laws.missing_structure import (
    MIN_STRUCTURE_GAIN,
    find_missing_structure,
    missing_mass_finding,
    shaft_torque,
)
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from tests.recover import experiment
from tests.study.two_masses.record import arrange, observed, simulate

FREE = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque", "load.inertia", "shaft.stiffness",
        "shaft.damping")


@cache
def fitted(situation, size, number, seed, gap=1.0):
    """(fit, fit with white noise, the run's setup, what is in the shaft); gap: of that of the size."""
    setup, law = arrange(situation, size, number, seed, 2.0)
    values = {**setup.machine.values, "shaft.half_gap": gap * setup.machine.values["shaft.half_gap"]}
    setup = replace(setup, machine=replace(setup.machine, values=values))
    run = simulate(setup, law)
    shaft = observed(setup, law, run)[0]
    made = experiment(run.torque, run.measured)
    role = "motor_angle" if setup.is_angle else "motor_speed"
    made = replace(made, signals={"motor_torque": run.torque, role: run.measured})
    drive = two_mass().with_values({n: v for n, v in values.items() if n != "shaft.half_gap"})
    white = by_innovations(Task(drive, FREE, roles_of([made], drive), (made,)), [{}])
    return with_coloured_noise(white), white, setup, shaft


def test_a_gap_left_out_is_found_with_its_size_and_the_stiffness_that_it_hid():
    outcome, white, setup, _ = fitted("shaft.gap", "M", 1, 3001)
    truth = setup.machine.values
    assert outcome.drive.values["shaft.stiffness"] < 0.9 * truth["shaft.stiffness"]
    lack = find_missing_structure(outcome, white, outcome)
    assert lack.code == "gap-left-out" and lack.gain > 100.0 * MIN_STRUCTURE_GAIN
    assert lack.task.drive.values["shaft.half_gap"] == pytest.approx(truth["shaft.half_gap"], rel=0.1)
    assert lack.task.drive.values["shaft.stiffness"] == pytest.approx(truth["shaft.stiffness"], rel=0.05)


def test_the_gain_that_is_wanted_is_neither_half_nor_twice_as_large():
    """The gain of a gap goes with its square: 14 and 8.5 here."""
    outcome, white, *_ = fitted("shaft.gap", "S", 1, 3001, 0.013)
    lack = find_missing_structure(outcome, white, outcome)
    assert lack is not None and MIN_STRUCTURE_GAIN < lack.gain < 24.0
    outcome, white, *_ = fitted("shaft.gap", "S", 1, 3001, 0.01)
    assert find_missing_structure(outcome, white, outcome) is None


def test_a_gap_must_explain_more_than_all_laws():
    outcome, white, *_ = fitted("shaft.gap", "S", 1, 3001, 0.03)
    gain = find_missing_structure(outcome, white, outcome).gain
    for less, found in ((1.5 * MIN_STRUCTURE_GAIN, True), (0.5 * MIN_STRUCTURE_GAIN, False)):
        rival = replace(outcome, fit=replace(outcome.fit, value=outcome.fit.value - gain + less))
        assert (find_missing_structure(outcome, white, rival) is not None) == found


@pytest.mark.parametrize("situation", ["quiet", "white"])
def test_a_right_model_lacks_nothing(situation):
    outcome, white, *_ = fitted(situation, "", 0, 3000)
    assert find_missing_structure(outcome, white, outcome) is None


def test_a_gap_that_is_said_to_be_none_is_not_looked_for():
    outcome, white, *_ = fitted("shaft.gap", "S", 1, 3001, 0.03)
    assert find_missing_structure(outcome, white, outcome).code == "gap-left-out"
    none = replace(outcome, task=outcome.task.at({"shaft.half_gap": 0.0}))
    found = find_missing_structure(none, white, none)
    assert found is None or found.code != "gap-left-out"


@pytest.mark.slow
def test_a_third_mass_left_out_is_found_and_leaves_no_correlation():
    outcome, white, setup, _ = fitted("load.third-mass", "L", 6, 3104)
    lack = find_missing_structure(outcome, white, outcome)
    assert lack.code == "mass-left-out" and lack.gain > MIN_STRUCTURE_GAIN
    values = lack.task.drive.values
    share = values["tip.inertia"] / (values["tip.inertia"] + values["load.inertia"])
    assert share == pytest.approx(0.4, abs=0.1)
    truth = setup.machine.values["shaft.stiffness"]
    assert abs(values["shaft.stiffness"] - truth) < 0.3 * abs(outcome.drive.values["shaft.stiffness"] - truth)


@pytest.mark.slow
def test_the_stated_share_and_frequency_of_a_third_mass_are_those_of_the_machine():
    """Free of the motor, a mass of share s on the rest of the load swings 1 / sqrt(1 - s) faster than on a wall."""
    _, law = arrange("load.third-mass", "L", 6, 3104, 2.0)
    outcome, white, *_ = fitted("load.third-mass", "L", 6, 3104)
    evidence = missing_mass_finding(find_missing_structure(outcome, white, outcome)).evidence
    assert evidence["share"] == pytest.approx(law.law.strength, abs=0.1)
    frequency = law.law.constants["frequency"] / np.sqrt(1.0 - law.law.strength)
    assert evidence["frequency"] == pytest.approx(frequency, rel=0.1)


def test_the_shaft_torque_is_that_of_the_filtered_drive():
    outcome, _, _, shaft = fitted("quiet", "", 0, 3000)
    assert not looks_coloured(outcome.fit.passes)
    assert abs(shaft_torque(outcome)[200:] - shaft[200:]).max() < 0.2 * abs(shaft).max()
