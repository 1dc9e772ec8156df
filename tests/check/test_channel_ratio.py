"""Sign and scale of the load's channels, held against the motor's through the gear."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.check.faults.load_side_scale import load_scale
from drivetool.check.faults.record_faults import record_faults_of
from tests.drive.test_kernel import drive_of
from tests.recover import STEP, experiment
from tests.simulator.experiments import multisine
from tests.simulator.machine import machine_by_seed
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

WANTED = ("wrong-sign", "wrong-scale")
RATIO, SIZE = 3.0, 8000


def geared(seed):
    """A machine whose motor turns RATIO times for one turn of its load."""
    base = machine_by_seed(seed)
    return replace(base, ratio=(RATIO,), inertia=(base.inertia[0], RATIO**2 * base.inertia[1]),
                   stiffness=(RATIO**2 * base.stiffness[0],), damping=(RATIO**2 * base.damping[0],))


def recorded(seed, kinds, factor=1.0):
    """A record of a geared drive that goes back and forth, the load's channel times a factor."""
    base = machine = geared(seed)
    slow, fast = (multisine(np.linspace(*ends, 20), 1.0, SIZE * STEP, STEP, seed)
                  for ends in ((0.25, 2.75), (4.0, 60.0)))
    torque = 0.3 * base.rated_torque * (slow + fast)[:SIZE]
    run = simulate_linear(machine, torque, STEP, None, white_noise(SIZE, 0.003 * base.rated_torque, 1))
    signals = {}
    for body, name in enumerate(("motor", "load")):
        kind = kinds[body]
        y = (run.angles if kind == "angle" else run.speeds)[:, body]
        noise = 1e-4 if kind == "angle" else 2e-3
        signals[f"{name}_{kind}"] = (factor if body else 1.0) * (
            y + white_noise(SIZE, noise * np.abs(y).max(), 2 + body))
    return replace(experiment(torque, run.speeds[:, 0]), signals={"motor_torque": torque, **signals})


@pytest.mark.parametrize("kinds", [("speed", "speed"), ("angle", "speed"), ("speed", "angle")])
@pytest.mark.parametrize(("factor", "code"), [
    (1.0, None), (1.0015, None), (-1.0, "wrong-sign"), (1.03, "wrong-scale"), (0.5, "wrong-scale")])
@pytest.mark.parametrize("seed", [20, 23])
def test_the_load_goes_as_far_as_the_motor_through_the_gear(kinds, factor, code, seed):
    record = recorded(seed, kinds, factor)
    (mended,), faults = record_faults_of([record], WANTED, RATIO)
    assert [f.code for f in faults] == [code] * bool(code)
    role = f"load_{kinds[1]}"
    if code is None:
        np.testing.assert_array_equal(mended.signals[role], record.signals[role])
        return
    evidence = faults[0].finding.evidence
    assert abs(evidence["factor"] - factor) < max(3.0 * evidence["std"], 1e-3 * abs(factor))
    assert evidence["std"] < 0.006 * abs(factor)
    np.testing.assert_allclose(mended.signals[role] * evidence["factor"], record.signals[role], rtol=1e-12)


@pytest.mark.parametrize("upside_down", ["motor_speed", "motor_angle", "load_speed"])
def test_of_two_channels_of_opposite_signs_the_torque_identifies_the_wrong_one(upside_down):
    record = recorded(20, ("speed", "speed"))
    speed = record.signals["motor_speed"]
    if upside_down == "motor_angle":
        angle = STEP * (np.cumsum(speed) - 0.5 * speed)
        record = replace(record, signals={**record.signals, "motor_angle": angle})
    wrong = replace(record, signals={**record.signals, upside_down: -record.signals[upside_down]})
    (mended,), faults = record_faults_of([wrong], WANTED, RATIO)
    assert {f.code for f in faults} == {"wrong-sign"}
    said = " ".join(f"{f.finding.text} {f.finding.action}" for f in faults)
    assert ("angle has the wrong sign" in said) == (upside_down == "motor_angle")
    assert ("sign of the motor's" in said) == (upside_down == "motor_speed")
    for role in ("motor_speed", upside_down):
        np.testing.assert_allclose(mended.signals[role], record.signals[role], rtol=5e-3)


@pytest.mark.parametrize("seed", [21, 24])
def test_half_a_per_cent_is_identified_where_the_shaft_hardly_twists(seed):
    record = recorded(seed, ("angle", "angle"), 0.995)
    (fault,) = record_faults_of([record], WANTED, RATIO)[1]
    evidence = fault.finding.evidence
    assert abs(evidence["factor"] - 0.995) < 3.0 * evidence["std"] < 0.0025


def test_a_tail_without_values_is_no_way_and_makes_no_outliers():
    """Bridged with its last value a speed went on for a third of the record, and the noise came out at half."""
    record = recorded(20, ("speed", "speed"))
    signals = {r: np.where(np.arange(SIZE) < 0.55 * SIZE, v, np.nan) if r != "motor_torque" else v
               for r, v in record.signals.items()}
    assert record_faults_of([replace(record, signals=signals)], (*WANTED, "outliers"), RATIO)[1] == []


def test_missing_values_and_a_load_alone_are_no_fault():
    record = recorded(20, ("speed", "speed"), 1.03)
    holes = record.signals["load_speed"].copy()
    holes[1000:1100] = np.nan
    (_,), faults = record_faults_of([replace(record, signals={**record.signals, "load_speed": holes})], WANTED,
                                    RATIO)
    assert [f.code for f in faults] == ["wrong-scale"]
    alone = {r: v for r, v in record.signals.items() if r != "motor_speed"}
    assert record_faults_of([replace(record, signals=alone)], WANTED, RATIO)[1] == []


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "kinds", "factor"), [
    (20, ("speed", "speed"), 1.03), (23, ("speed", "angle"), -0.96)])
def test_the_scale_fitted_with_the_drive_is_far_more_accurate(seed, kinds, factor):
    """What half a per cent leaves of the load's motion is no law that is missing."""
    (mended,), faults = record_faults_of([recorded(seed, kinds, factor)], WANTED, RATIO)
    estimate = faults[0].finding.evidence
    wrong = {"motor.inertia": 1.1, "load.inertia": 0.9, "shaft.stiffness": 1.1, "shaft.damping": 0.9}
    drive = drive_of(geared(seed))
    drive = drive.with_values({n: v * drive.value(n) for n, v in wrong.items()})
    free = (*wrong, "motor.viscous", "load.viscous")
    (again,), (fault,) = load_scale((mended,), drive, free, faults, {})
    fine = fault.finding.evidence
    assert fine["std"] < 0.2 * estimate["std"]
    assert abs(fine["factor"] - factor) < 3.5 * fine["std"]
    role = f"load_{kinds[1]}"
    np.testing.assert_allclose(
        again.signals[role] * fine["factor"], mended.signals[role] * estimate["factor"], rtol=1e-9)
