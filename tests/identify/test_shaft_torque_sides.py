"""Friction of the two sides of a measured shaft: each by itself, by the record or by the file."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import two_mass
from drivetool.identify.estimate.estimate import Covariance
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.outcome.composition import inconsistent_with_prior
from drivetool.identify.setup.options import Options
from drivetool.identify.steady.estimator import steady
from tests.light_rigs import TABLE, idle_at_motor, steady_record, steps_record
from tests.study.study_shaft_torque import opened, truth_of

TRUE = truth_of(TABLE)
FRICTION = ("motor.viscous", "load.viscous", "motor.idle_torque", "load.idle_torque")
START = two_mass().with_values({
    "motor.inertia": 6.2, "load.inertia": 0.52, "shaft.stiffness": 4500.0, "shaft.damping": 0.25})


@pytest.fixture(scope="module")
def steady_estimate():
    """The estimate of steady on a day on which the motor's idle torque was higher."""
    return steady([opened(steady_record(idle_at_motor(TABLE, 27.9), 11), "steady")], START, Options())


def known_line(estimate, name):
    """The line of a parameter; of an idle torque that of its sum with Coulomb friction: the drive turns one way."""
    return next(r for r in (*estimate.ratios, *estimate.parameters)
                if name in r.name.split() and (r.std is not None or " " in r.name))


def fitted(steady_estimate, duration, **words):
    record = opened(steps_record(TABLE, 12, duration=duration), "steps")
    options = (Options(known=steady_estimate.covariance, **words) if steady_estimate is not None
               else Options(**words))
    return greybox([record], START if steady_estimate is None else steady_estimate.drive, options)


@pytest.mark.slow
def test_identified_friction_is_that_of_the_record_and_differences_to_the_file_are_reported(steady_estimate):
    estimate = fitted(steady_estimate, 8.0)
    lines = {p.name: p for p in estimate.parameters}
    assert not [n for n in lines if n.startswith("total.")]
    for name, value in TRUE.items():
        line = known_line(estimate, name)
        assert abs(line.value - value) < 3.0 * line.std, name
    (found,) = [f for f in estimate.findings if f.code == "inconsistent-with-prior"]
    assert list(found.evidence) == ["motor.idle_torque"] and found.severity == "warning"
    assert "27.9" in found.text and "24." in found.text
    assert not {"model-error", "not-converged"} & {f.code for f in estimate.findings}


@pytest.mark.slow
def test_without_a_file_the_sides_are_never_summed():
    estimate = fitted(None, 8.0)
    assert not [p.name for p in estimate.parameters if p.name.startswith("total.")]
    for name in FRICTION:
        low, high = known_line(estimate, name).ci95
        assert low <= TRUE[name] <= high, name


@pytest.mark.slow
def test_a_requested_sum_is_fitted():
    estimate = fitted(None, 2.0, hold=("total.viscous",))
    assert {p.name: p.status for p in estimate.parameters}["total.viscous"] == "held"


@pytest.mark.slow
def test_friction_unidentified_in_a_short_record_stands_as_in_the_file_with_its_covariance(steady_estimate):
    estimate = fitted(steady_estimate, 0.9)
    lines = {p.name: p for p in estimate.parameters}
    (note,) = [f for f in estimate.findings if f.code == "friction-from-prior"]
    assert "load.idle_torque" in note.evidence and "held-values-dominate" not in {f.code for f in estimate.findings}
    known = dict(zip(steady_estimate.covariance.names, np.sqrt(np.diag(steady_estimate.covariance.matrix)),
                     strict=True))
    covariance = estimate.covariance
    for name in note.evidence:
        line = lines[name]
        assert line.status == "held" and line.value == steady_estimate.drive.values[name]
        assert line.std == pytest.approx(known[name]) and "as in the file" in line.reason
        assert line.ci95[1] - line.value == pytest.approx(1.96 * known[name], rel=1e-3)
        assert covariance.matrix[(i := covariance.names.index(name)), i] == pytest.approx(known[name] ** 2)
    # Where the load's idle torque is higher by something, its viscous friction is lower by that over the speed.
    i, j = (covariance.names.index(n) for n in ("load.viscous", "load.idle_torque"))
    slope = covariance.matrix[i, j] / covariance.matrix[j, j]
    assert slope == pytest.approx(-1.0 / 110.0, rel=0.05)
    assert np.linalg.eigvalsh(covariance.matrix).min() > 0.0


def test_what_is_requested_to_be_free_is_fitted_however_uncertain(steady_estimate):
    estimate = fitted(steady_estimate, 0.9, free=("load.idle_torque",))
    assert "load.idle_torque + load.coulomb" in {p.name for p in estimate.ratios}  # the drive turns one way


@pytest.mark.parametrize(("off", "own_sides", "far"), [
    (2.5, True, False), (3.5, True, True), (7.0, False, False), (9.0, False, True)])
def test_friction_of_a_side_is_held_against_the_file_at_three_standard_deviations(off, own_sides, far):
    before = two_mass().with_values({"motor.viscous": 1.0})
    known = Covariance(("motor.viscous",), np.array([[0.06**2]]))
    after = replace(before, values={"motor.viscous": 1.0 + 0.1 * off})
    found = inconsistent_with_prior(known, before, after, Covariance(("motor.viscous",), np.array([[0.08**2]])),
                                    own_sides)
    assert bool(found) == far
