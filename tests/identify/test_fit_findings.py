"""What a fit says of its torque, of what was held, of its criterion and of its starts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drivetool.drive import one_body, two_mass
from drivetool.identify.backlash.estimator import ambiguous_gaps
from drivetool.identify.estimate.estimate import Covariance, Estimate, Parameter
from drivetool.identify.estimate.verdict import judged
from drivetool.identify.fit.engine import by_innovations
from drivetool.identify.greybox.estimator import both_criteria
from drivetool.identify.outcome.composition import compose, noise_parameters
from drivetool.identify.setup.options import Options
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from tests.recover import drive_like, linear_record, truth
from tests.simulator.machine import machine_by_seed

MACHINE = machine_by_seed(5)
SHAPE = ["motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping"]


@pytest.fixture(scope="module")
def outcome():
    """Two seconds of torque steps; the inertias are fitted, the shaft and the friction are held."""
    values = truth(MACHINE)
    drive = drive_like(MACHINE, SHAPE).with_values({n: values[n] for n in ("total.viscous", "total.idle_torque")})
    record = linear_record(MACHINE, 51, 2.0)
    task = Task(drive, ("motor.inertia", "load.inertia"), roles_of([record], drive), (record,))
    return by_innovations(task, [{}])


@pytest.mark.parametrize(("torque_is", "code"), [
    ("command", None), ("measurement", "torque-source"), ("unknown", "torque-source")])
def test_what_the_torque_is_taken_for(outcome, torque_is, code):
    records = tuple(replace(e, torque_is=torque_is) for e in outcome.task.experiments)
    _, findings = noise_parameters(replace(outcome, task=replace(outcome.task, experiments=records)))
    assert [f.code for f in findings] == ([code] if code else [])


@pytest.mark.parametrize(("relative", "said"), [(1e-6, False), (0.2, True)])
def test_held_values_of_large_uncertainty_make_the_intervals(outcome, relative, said):
    std = relative * outcome.drive.value("shaft.stiffness")
    known = Covariance(("shaft.stiffness",), np.array([[std**2]]))
    estimate = compose("greybox", outcome.drive, outcome, Options(known=known))
    found = [f for f in estimate.findings if f.code == "held-values-dominate"]
    assert bool(found) == said and all("--free shaft.stiffness" in f.action for f in found)


@pytest.mark.slow
@pytest.mark.parametrize(("bodies", "said"), [(2, False), (1, True)])
def test_a_drive_that_simulates_better_than_it_predicts_lacks_something(bodies, said):
    """A rigid body predicts one step of the elastic drive well, with a wrong inertia."""
    values = truth(MACHINE)
    record = linear_record(MACHINE, 51, 3.0)
    drive = drive_like(MACHINE, SHAPE).with_values({n: values[n] for n in ("total.viscous", "total.idle_torque")})
    if bodies == 1:
        drive = one_body().with_values({f"motor.{what}": sum(getattr(MACHINE, what))
                                        for what in ("inertia", "viscous", "idle_torque")})
    task = Task(drive, ("motor.inertia",), roles_of([record], drive), (record,))
    _, findings = both_criteria(by_innovations(task, [{}]), Options())
    assert [f.code for f in findings] == (["model-error"] if said else [])


@pytest.mark.parametrize(("other", "above", "said"), [(0.02, 0.5, True), (0.02, 5.0, False), (0.0101, 0.5, False)])
def test_another_half_gap_that_is_as_likely_leaves_none(other, above, said):
    """A rival counts where it is as likely and lies outside the interval."""
    drive = two_mass().with_values({"shaft.half_gap": 0.01})
    line = Parameter(name="shaft.half_gap", value=0.01, unit="rad", start=0.01, std=1e-4, ci95=(0.0098, 0.0102))
    starts = ({"minus_log_likelihood_above_best": 0.0, "reached": {"shaft.half_gap": 0.01}},
              {"minus_log_likelihood_above_best": above, "reached": {"shaft.half_gap": other}})
    outcome = SimpleNamespace(starts=starts)
    found = judged(Estimate("backlash", drive, (line,), "", {}), [
        lambda e: ambiguous_gaps(e, outcome, ["shaft.half_gap"])])
    assert [f.code for f in found.findings] == (["gap-ambiguous"] if said else [])
    assert (found.parameters[0].std is None) == said
