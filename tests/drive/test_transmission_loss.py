"""Loss of a transmission against the independent simulator, its sensitivities, and its limits."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive.assemble import Layout
from drivetool.drive.simulation.augment import plant_of
from drivetool.errors import BadParameters
from tests.drive.from_rest import outputs_of, sensitivity_errors
from tests.drive.test_kernel import STEP, drive_of, levels, rms
from tests.simulator.effects import Effects
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine

ROTOR = Machine((0.02,), (0.02,), (0.4,), rated_torque=3.0)
TWO = Machine((0.6, 5.2), (0.8, 0.3), (5.0, 4.0), (0.0, 0.0), (3300.0,), (3.1,), rated_torque=200.0)
GEAR = replace(TWO, inertia=(0.6, 52.0), ratio=(4.0,))
RIPPLED = Effects(ripple=(0.3, 6.0, 0.0))
# machine, losses where the motor drives and where it is driven, inertia of the rotor, further effects
CASES = {
    "one body": (ROTOR, 0.1, 0.12, 0.0, Effects()),
    "one body, half of it rotor": (ROTOR, 0.1, 0.3, 0.01, Effects()),
    "one body, mostly loss": (ROTOR, 0.6, 0.9, 0.015, Effects()),
    "one body with ripple": (ROTOR, 0.2, 0.1, 0.012, RIPPLED),
    "one body without Coulomb friction": (replace(ROTOR, coulomb=(0.0,)), 0.2, 0.3, 0.005, Effects()),
    "one body with Stribeck": (ROTOR, 0.2, 0.3, 0.01, Effects(stribeck=(0.3,), stribeck_speed=(2.0,))),
    "one body behind a converter": (replace(ROTOR, converter_bandwidth=400.0, dead_time=0.0013), 0.2, 0.1, 0.01,
                                    Effects()),
    "one body with an idle torque": (replace(ROTOR, idle_torque=(0.3,)), 0.4, 0.6, 0.01, Effects()),
    "two masses": (TWO, 0.1, 0.1, 0.0, Effects()),
    "two masses, mostly loss": (TWO, 0.5, 0.8, 0.0, Effects()),
    "two masses, a gear": (GEAR, 0.1, 0.2, 0.0, Effects()),
    "two masses with a gap": (replace(TWO, half_gap=(0.01,)), 0.1, 0.2, 0.0, Effects()),
    "two masses with a gap damped always": (replace(TWO, half_gap=(0.01,), law="always"), 0.1, 0.2, 0.0, Effects()),
    "two masses with a relaxing gap": (replace(TWO, half_gap=(0.01,), law="contact"), 0.1, 0.2, 0.0, Effects()),
    "two masses, hardening": (TWO, 0.1, 0.2, 0.0, Effects(hardening_twist=(0.05,))),
    "two masses, an idle load": (replace(TWO, idle_torque=(0.0, 15.0)), 0.3, 0.6, 0.0, Effects()),
}
# case, what is added to it, the message
REFUSED = {
    "a rotor on a later body": ("two masses", {"load.rotor_inertia": 0.1}, r"only; found load\.rotor_inertia"),
    "a rotor as large as its body": ("one body", {"motor.rotor_inertia": 0.02}, r"motor\.rotor_inertia below"),
    "a loss beside bristles": ("one body", {"motor.bristle_stiffness": 2e3}, r"motor\.loss_driving beside"),
}
EACH_CASE = pytest.mark.parametrize("name", CASES)


def case_of(name, size=2000):
    """(machine with its effects, the drive, torque)."""
    machine, driving, driven, rotor, effects = CASES[name]
    effects = replace(effects, loss_driving=(driving,), loss_driven=(driven,), rotor_inertia=rotor)
    drive = drive_of(machine)
    body = drive.bodies[-1]
    more = {f"{body}.loss_driving": driving, f"{body}.loss_driven": driven}
    if rotor:
        more[f"{body}.rotor_inertia"] = rotor
    if effects.ripple[0]:
        more |= {f"{body}.ripple_sine": effects.ripple[0], f"{body}.ripple_order": effects.ripple[1]}
    if effects.stribeck:
        more |= {f"{body}.stribeck": effects.stribeck[0], f"{body}.stribeck_speed": effects.stribeck_speed[0]}
    if effects.hardening_twist:
        more |= {"shaft.hardening": 1.0, "shaft.hardening_twist": effects.hardening_twist[0]}
    torque = levels(machine, size, 3, share=0.7 if len(machine.inertia) == 1 else 0.4)
    torque[:2] = 0.0  # before the record there is none
    return replace(machine, effects=effects), replace(drive, values={**drive.values, **more}), torque


@EACH_CASE
def test_against_the_independent_simulator(name):
    machine, drive, torque = case_of(name)
    there = simulate_fast(machine, torque, STEP).speeds
    out = outputs_of(drive, torque)
    # Where a smooth law acts besides, its torque is a parabola over a part of a sample.
    smooth = plant_of(drive, Layout((), ("motor_torque",), ("motor_speed",), STEP)).laws is not None
    limit = 1e-6 if smooth else 1e-9
    for body in range(out.shape[1]):
        assert rms(out[:, body] - there[:, body]) < limit, body
    assert (np.diff(np.sign(there[:, -1])) != 0.0).sum() > 5


@EACH_CASE
def test_sensitivities_are_the_derivatives(name):
    """Against central differences; at a reversal the differences themselves are of lower order."""
    _, drive, torque = case_of(name)
    free = [n for n, v in drive.values.items() if v and not n.startswith("shaft.hardening")]
    for parameter, error in sensitivity_errors(drive, torque, free, -1, 3e-5).items():
        # A reversal at which the differences are of lower order takes a few samples.
        assert (np.quantile(error, [0.5, 0.9]) < [1e-5, 1e-4]).all(), parameter


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_transmission_is_refused_by_name(case):
    name, values, message = REFUSED[case]
    _, drive, torque = case_of(name)
    with pytest.raises(BadParameters, match=message):
        outputs_of(drive.with_values(values), torque)


@pytest.mark.parametrize("name", ["motor.loss_driving", "motor.loss_driven"])
def test_bristles_are_refused_beside_each_loss_alone(name):
    _, drive, torque = case_of("one body")
    alone = {n: v for n, v in drive.values.items() if "loss" not in n}
    with pytest.raises(BadParameters, match=f"{name} beside its bristle_stiffness"):
        outputs_of(replace(drive, values=alone).with_values({name: 0.1, "motor.bristle_stiffness": 2e3}), torque)


@pytest.mark.parametrize("value", [np.nan, -0.01, 0.91])
@pytest.mark.parametrize("name", ["motor.loss_driving", "motor.loss_driven"])
def test_a_loss_is_a_share_of_at_most_nine_tenths(name, value):
    with pytest.raises(BadParameters, match=f"{name} between 0 and 0.9"):
        drive_of(ROTOR).with_values({name: value})
