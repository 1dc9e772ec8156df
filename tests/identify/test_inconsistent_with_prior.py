"""A step that lands far from what the file says of a value, by its own interval, says so."""

import numpy as np
import pytest

from drivetool.drive import one_body, two_mass
from drivetool.identify.estimate.estimate import Covariance
from drivetool.identify.greybox import greybox
from drivetool.identify.outcome.composition import inconsistent_with_prior
from drivetool.identify.setup import Options
from tests.identify.swing import TRUTH, record, swing

BEFORE = two_mass().with_values({
    "motor.inertia": 1.0, "load.inertia": 2.0, "total.viscous": 0.5, "shaft.ratio": 2.0})
GIVEN = Covariance(("motor.inertia", "total.viscous"), np.diag([0.01**2, 0.03**2]))


def inconsistent_evidence(after, names, stds):
    now = Covariance(tuple(names), np.diag(np.square(stds)))
    return [f.evidence
            for f in inconsistent_with_prior(GIVEN, BEFORE, after, now) if f.code == "inconsistent-with-prior"]


@pytest.mark.parametrize(("value", "far"), [(1.05, False), (1.4, True)])
def test_by_the_intervals_of_both(value, far):
    """0.4 is eighteen of the two standard deviations together, 0.05 two of them."""
    found = inconsistent_evidence(BEFORE.with_values({"motor.inertia": value}), ["motor.inertia"], [0.02])
    assert found == ([{"motor.inertia": pytest.approx(0.4 / np.hypot(0.01, 0.02))}] if far else [])


@pytest.mark.parametrize(("load", "far"), [(1.2, False), (4.0, True)])
def test_a_sum_is_held_against_its_parts_behind_their_gear(load, far):
    """Behind a ratio of two a quarter of the load's friction counts: 0.2 + 0.3 is the sum, 0.2 + 1 not."""
    after = BEFORE.with_values({"motor.viscous": 0.2, "load.viscous": load})
    found = inconsistent_evidence(after, ["motor.viscous", "load.viscous"], [0.02, 0.08])
    assert found == ([{"total.viscous": pytest.approx(0.7 / np.sqrt(0.03**2 + 0.02**2 + 0.02**2))}] if far else [])


def test_what_was_held_or_not_identified_is_not_compared():
    after = BEFORE.with_values({"motor.inertia": 3.0})
    assert inconsistent_evidence(after, ["load.inertia"], [0.1]) == []
    assert inconsistent_with_prior(None, BEFORE, after, GIVEN) == []


def test_the_value_stated_is_that_of_the_table_and_the_advice_one_the_drive_has():
    """Drag of 0.02 Nm s^2/rad^2: a law of the default fit, beside which the drive has more friction."""
    motion = swing(3000)
    rng = np.random.default_rng(5)
    made = record(motion, more=0.02 * motion.mean_speed * np.abs(motion.mean_speed),
                  noise=2e-3 * rng.standard_normal(3000))
    known = Covariance(("motor.viscous",), np.array([[0.001**2]]))
    before = one_body().with_values({**TRUTH, "motor.viscous": 0.9})
    found = greybox([made], before, Options(known=known))
    assert found.laws  # so that the fit and the drive without its laws differ
    said, = (f for f in found.findings if f.code == "inconsistent-with-prior")
    assert f"motor.viscous is {found.line('motor.viscous').value:.4g}, and was 0.9 " in said.text
    assert "load" not in said.action.replace("Friction and load may change", "") and "diagnose" in said.action
