"""LuGre friction against the independent simulator, its sensitivities, and its limits."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive.chain import one_body
from drivetool.drive.effects.lugre import start
from drivetool.errors import BadParameters
from tests.drive.from_rest import outputs_of, sensitivity_errors
from tests.drive.test_kernel import STEP, drive_of, levels, rms
from tests.simulator.effects import Effects
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine

ROTOR = Machine((0.02,), (0.02,), (1.0,), rated_torque=3.0)
TWO = Machine((0.6, 5.2), (0.8, 0.3), (5.0, 4.0), (0.0, 0.0), (3300.0,), (3.1,), rated_torque=200.0)
# machine, stiffness and damping of the bristles, Stribeck torque and speed: each of every body, zero where none is
CASES = {
    "soft": (ROTOR, (100.0,), (0.3,), (0.5,), (0.5,)),
    "usual": (ROTOR, (1e3,), (1.0,), (0.5,), (0.5,)),
    "stiff": (ROTOR, (1e4,), (2.0,), (0.3,), (0.2,)),
    "without Stribeck": (ROTOR, (2e3,), (0.5,), (0.0,), (1.0,)),
    "motor": (TWO, (4e3, 0.0), (8.0, 0.0), (2.0, 0.0), (0.5, 1.0)),
    "load": (TWO, (0.0, 6e3), (0.0, 20.0), (0.0, 2.0), (1.0, 0.3)),
    "both": (replace(TWO, half_gap=(0.01,)), (4e3, 6e3), (8.0, 20.0), (2.0, 0.0), (0.5, 1.0)),
}
EACH_CASE = pytest.mark.parametrize("name", CASES)


def drive_with(machine, stiffness, damping, surplus, speed):
    more = {}
    for body, s0, s1, ts, ws in zip(("motor", "load"), stiffness, damping, surplus, speed, strict=False):
        if s0:
            more |= {f"{body}.bristle_stiffness": s0, f"{body}.bristle_damping": s1}
        if ts:
            more |= {f"{body}.stribeck": ts, f"{body}.stribeck_speed": ws}
    drive = drive_of(machine) if len(machine.inertia) > 1 else one_body().with_values({
        "motor.inertia": machine.inertia[0], "motor.viscous": machine.viscous[0],
        "motor.coulomb": machine.coulomb[0]})
    return replace(drive, values={**drive.values, **more})


def case_of(name, size=2000):
    """(machine with its effects, the drive, torque)."""
    machine, stiffness, damping, surplus, speed = CASES[name]
    effects = Effects(stribeck=surplus, stribeck_speed=speed, lugre_stiffness=stiffness, lugre_damping=damping)
    torque = levels(machine, size, 3, share=0.7 if machine is ROTOR else 0.4)
    return replace(machine, effects=effects), drive_with(*CASES[name]), torque


@EACH_CASE
def test_against_the_independent_simulator(name):
    machine, drive, torque = case_of(name)
    there = simulate_fast(machine, torque, STEP).speeds
    out = outputs_of(drive, torque)
    for body in range(out.shape[1]):
        assert rms(out[:, body] - there[:, body]) < 1e-7 * np.abs(there[:, body]).max(), body
    assert (np.diff(np.sign(there[:, 0])) != 0.0).sum() > 5


@EACH_CASE
def test_sensitivities_are_the_derivatives(name):
    """Against central differences; at a reversal the differences themselves are of lower order."""
    _, drive, torque = case_of(name)
    free = [n for n in drive.values if n.rpartition(".")[2] in (
        "bristle_stiffness", "bristle_damping", "coulomb", "stribeck", "stribeck_speed", "inertia")]
    for parameter, error in sensitivity_errors(drive, torque, free, 0, 3e-5).items():
        assert (np.quantile(error, [0.5, 0.99]) < [1e-5, 1e-4]).all(), parameter


def test_stiff_bristles_are_coulomb_and_stribeck_friction():
    """The difference falls as the time in which a reversal passes the deflection: as the root of the stiffness."""
    _, drive, torque = case_of("usual")
    sticking = replace(drive, values={n: v for n, v in drive.values.items() if "bristle" not in n})
    there = outputs_of(sticking, torque)[:, 0]
    errors = [rms(outputs_of(replace(drive, values=drive.values | {
        "motor.bristle_stiffness": s0, "motor.bristle_damping": 0.02 * s0**0.5}), torque)[:, 0] - there)
        for s0 in (1e4, 1e6)]
    assert errors[0] / errors[1] == pytest.approx(10.0, rel=0.15) and errors[1] < 0.01 * np.abs(there).max()


@pytest.mark.parametrize("name", ["motor.breakaway", "motor.drift_coulomb", "friction.drift_coulomb"])
def test_a_second_law_of_dry_friction_is_refused_by_name(name):
    _, drive, torque = case_of("usual")
    with pytest.raises(BadParameters, match=f"{name} beside its bristle_stiffness"):
        outputs_of(drive.with_values({name: 0.1}), torque)


@pytest.mark.parametrize(("speed", "factor", "share"), [(2.0, 1.0, 1.0), (-2.0, 1.0, -1.0), (0.0, 1.0, 0.0),
                                                         (2.0, 0.5, 0.5)])
def test_the_bristles_start_as_in_steady_sliding(speed, factor, share):
    """Of a measured speed, which is a number of NumPy; by the friction that the recording has."""
    drive = drive_with(*CASES["without Stribeck"]).with_values({"friction.factor": factor})
    assert start(drive, 0, np.array([speed]), {}) == pytest.approx((share * 1.0 / 2e3,))


def test_bristles_that_carry_no_friction_are_refused_by_name():
    drive = drive_with(*CASES["usual"]).with_values({"motor.coulomb": 0.0})
    with pytest.raises(BadParameters, match=r"motor\.coulomb above zero.* delete motor\.bristle_stiffness"):
        start(drive, 0, np.ones(1), {})
