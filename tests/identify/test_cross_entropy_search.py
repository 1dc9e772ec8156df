"""Starts drawn from the prior of a drive: sums stay, bounds hold, and the prior mean is the centre."""

from __future__ import annotations

import numpy as np
import pytest

from drivetool.drive import two_mass
from drivetool.drive.chain import vehicle
from drivetool.identify.estimate.estimate import Covariance
from drivetool.identify.identifiability.low_inertia_ratio import load_inertia_ratio, with_uncertain_values_free
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from drivetool.identify.starts.cross_entropy_search import HALF_GAP_RANGE, MIN_DRAWN_SHARE, draw_transform
from tests.recover import experiment

VALUES = {"motor.inertia": 2.0, "load.inertia": 0.3, "shaft.stiffness": 400.0, "shaft.damping": 0.5,
          "shaft.half_gap": 0.01, "total.viscous": 0.06, "total.idle_torque": 1.5}
NAMES = tuple(n for n in VALUES if n != "shaft.half_gap")
STD = np.array([0.02, 0.03, 40.0, 0.1, 0.005, 0.01])


def known():
    """Load inertia and stiffness known together: correlation 0.9."""
    matrix = np.diag(STD**2)
    matrix[1, 2] = matrix[2, 1] = 0.9 * STD[1] * STD[2]
    return Covariance(NAMES, matrix)


def task(values=VALUES, free=("shaft.half_gap",)):
    rng = np.random.default_rng(0)
    record = experiment(rng.standard_normal(200), rng.standard_normal(200))
    drive = two_mass().with_values(values)
    return Task(drive, free, roles_of([record], drive), (record,))


def drawn(count=4000):
    """(guesses, the values they stand for, (count,) each)."""
    guess = draw_transform(with_uncertain_values_free(task(), Options(known=known())), known())
    values = [guess.values(z) for z in guess.drawn(np.random.default_rng(1), count)]
    return guess, {n: np.array([v[n] for v in values]) for n in values[0]}


def test_guesses_have_the_mean_and_the_covariance_of_what_is_known():
    _, found = drawn()
    found["total.viscous"] = found["motor.viscous"] + found["load.viscous"]
    names = [n for n in NAMES if n != "shaft.damping"]
    sample = np.array([found[n] for n in names])
    std = np.array([STD[NAMES.index(n)] for n in names])
    error = (sample.mean(axis=1) - [VALUES[n] for n in names]) / std
    assert np.all(np.abs(error) < 5.0 / np.sqrt(sample.shape[1]))
    assert np.allclose(sample.std(axis=1), std, rtol=0.05)
    assert np.corrcoef(sample)[1, 2] == pytest.approx(0.9, abs=0.02)


def test_the_parts_of_viscous_friction_are_shared_in_any_way():
    _, found = drawn()
    share = found["load.viscous"] / (found["motor.viscous"] + found["load.viscous"])
    assert share.min() < 0.1 and share.max() > 0.9 and abs(np.median(share) - 0.5) < 0.05


def test_guesses_of_half_gaps_reach_over_two_decades_of_the_twist():
    guess, found = drawn()
    share = found["shaft.half_gap"] / guess.gaps["shaft.half_gap"]
    assert HALF_GAP_RANGE[0] < share.min() < 1.2 * HALF_GAP_RANGE[0] and 0.8 * HALF_GAP_RANGE[
        1] < share.max() < HALF_GAP_RANGE[1]


def test_no_guess_falls_below_its_least_value():
    _, found = drawn()
    assert found["shaft.damping"].min() >= MIN_DRAWN_SHARE * VALUES["shaft.damping"] * (1.0 - 1e-12)


def test_loosened_frees_what_came_with_an_uncertainty():
    loose = with_uncertain_values_free(task(), Options(known=known()))
    assert set(loose.free) == {*NAMES, "shaft.half_gap", "motor.viscous", "load.viscous"} - {"total.viscous"}
    parts = loose.drive.values["motor.viscous"] + loose.drive.values["load.viscous"]
    assert parts == pytest.approx(VALUES["total.viscous"], rel=1e-12)


@pytest.mark.parametrize("options", [
    Options(), Options(known=known(), hold=("load.inertia",)), Options(known=known(), criterion="simulation"),
    Options(known=Covariance(("shaft.damping",), np.eye(1)))])
def test_nothing_is_loosened_without_uncertainty_of_inertias_and_stiffness(options):
    assert with_uncertain_values_free(task(), options) is None


def test_nothing_is_loosened_for_a_normal_load():
    assert with_uncertain_values_free(task(VALUES | {"load.inertia": 0.5}), Options(known=known())) is None


def test_a_requested_sum_of_friction_stays_one():
    loose = with_uncertain_values_free(task(), Options(known=known(), free=("total.viscous",)))
    assert "total.viscous" in loose.free and "load.viscous" not in loose.free


def test_parts_known_from_an_earlier_fit_are_free_again():
    names = (*(n for n in NAMES if n != "total.viscous"), "motor.viscous", "load.viscous")
    loose = with_uncertain_values_free(task(), Options(known=Covariance(names, np.eye(len(names)))))
    assert {"motor.viscous", "load.viscous"} <= set(loose.free) and "total.viscous" not in loose.free


def test_the_share_of_a_load_is_referred_to_the_motor():
    drive = vehicle().with_values({"motor.inertia": 0.1, "wheels.inertia": 2.0, "wheels.carried_mass": 1000.0,
                                   "wheels.radius": 0.3, "shaft.stiffness": 1e4, "shaft.ratio": 10.0})
    assert load_inertia_ratio(drive) == pytest.approx((2.0 + 1000.0 * 0.09) / 100.0 / 0.1, rel=1e-12)
