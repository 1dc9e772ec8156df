"""What a black-box fit says of its record: band, sampling, reversals, damping and the coefficient it leaves out."""


import numpy as np
import pytest

from drivetool.drive import two_mass
from drivetool.drive.simulation import Trace
from drivetool.identify.blackbox.blackbox_findings import blackbox_findings
from drivetool.identify.estimate.estimate import Parameter
from drivetool.identify.setup.setup import roles_of
from drivetool.identify.setup.task import Task
from drivetool.logs import Experiment

STEP = 1e-3
DRIVE = two_mass().with_values({"motor.inertia": 1.0, "load.inertia": 4.0, "shaft.stiffness": 3000.0,
                                "shaft.half_gap": 0.0})
TORQUE = np.random.default_rng(1).standard_normal(4000)
SPEED = 20.0 + np.cumsum(TORQUE) * STEP


def codes(details=None, speed=SPEED, lines=(), noise=1e-3, step=STEP):
    """Code -> severity of the findings on a record whose model simulates all but white noise."""
    measured = speed + noise * np.random.default_rng(2).standard_normal(4000)
    signals = {"motor_torque": TORQUE, "motor_speed": measured}
    record = Experiment("made", "0" * 64, step, 0.0, signals, ((0, 4000),))
    task = Task(DRIVE, (), roles_of([record], DRIVE), (record,))
    trace = Trace(TORQUE[:, None], measured[:, None], step)
    return {f.code: f.severity
            for f in blackbox_findings(task, lines, (), details or {}, [trace], [speed[:, None]])}


def resonance(hz):
    return {"resonance": {"hz": {"value": hz}}}


def test_a_record_that_is_fit_for_it_gets_no_finding():
    assert codes(resonance(20.0)) == {}


@pytest.mark.parametrize(("hz", "step", "near"), [(20.0, STEP, False), (20.0, 0.02, True)])
def test_a_resonance_above_a_third_of_the_sampling_rate(hz, step, near):
    assert ("resonance-out-of-range" in codes(resonance(hz), step=step)) == near


@pytest.mark.parametrize(("noise", "outside"), [(1e-3, False), (1.0, True)])
def test_a_resonance_where_noise_is_larger_than_the_response(noise, outside):
    assert ("resonance-out-of-range" in codes(resonance(100.0), noise=noise)) == outside


def test_a_record_that_reverses():
    swing = 5.0 * np.sin(np.arange(4000) * STEP * 4.0)
    assert codes(speed=SPEED - 20.0 + swing) == {"direction-changes": "warning"}


@pytest.mark.parametrize(("upper", "severity"), [(0.4, "note"), (-0.1, "warning")])
def test_a_damping_that_came_out_negative(upper, severity):
    """Surely below zero only where its whole interval is."""
    line = Parameter(name="shaft.damping", value=0.0, unit="Nm s/rad", ci95=(-1.0, upper), status="at-bound",
                     reason="is -1")
    assert codes(lines=[line]) == {"negative-estimate": severity}
    assert codes(lines=[line.replace(status="fitted")]) == {}


@pytest.mark.parametrize(("b1", "in_std", "said"), [(2.0, 9.0, True), (1.05, 9.0, False), (2.0, 2.0, False)])
def test_a_coefficient_that_contradicts_the_conversion(b1, in_std, said):
    """By a tenth and by four standard deviations, not by one of them alone."""
    left = {"left_over": {"b1": b1, "b1_from_parameters": 1.0, "in_std": in_std}}
    assert codes(left) == ({"residual-conversion-error": "warning"} if said else {})
