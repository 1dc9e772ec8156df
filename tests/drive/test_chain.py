"""Sums over the bodies of a chain, referred to the motor."""

import numpy as np
import pytest

from drivetool.drive.chain import one_body, three_mass, vehicle
from drivetool.drive.linearise import state_space

# Drive, what its bodies' torques accelerate, and the total referred to the motor: J1 + J2/n1^2 + J3/(n1 n2)^2.
CASES = {
    "one body": (one_body().with_values({"motor.inertia": 2.0, "motor.carried_mass": 3.0, "motor.radius": 0.5}),
                 (2.75,), 2.75),
    "two gears": (three_mass().with_values({
        "motor.inertia": 1.0, "gear.inertia": 6.0, "gear.carried_mass": 40.0, "gear.radius": 0.5,
        "arm.inertia": 9.0, "arm.carried_mass": 7.0, "shaft.ratio": 4.0, "shaft2.ratio": 0.5,
        "shaft.stiffness": 1e3, "shaft2.stiffness": 2e3}), (1.0, 16.0, 16.0), 6.0),
    "bus": (vehicle().with_values({
        "motor.inertia": 4.5, "wheels.inertia": 22.1, "wheels.carried_mass": 12350.0, "wheels.radius": 0.45,
        "shaft.ratio": 8.79, "shaft.stiffness": 1.52e6}), (4.5, 2522.975), 4.5 + 2522.975 / 8.79**2),
}


@pytest.mark.parametrize(("drive", "each", "total"), CASES.values(), ids=CASES)
def test_inertia_referred_to_the_motor(drive, each, total):
    assert drive.inertias() == pytest.approx(each, rel=1e-12)
    assert drive.referred_inertia == pytest.approx(total, rel=1e-12)
    # Newton: without friction a lasting torque ends in the acceleration torque / inertia of all bodies.
    a, b, c, _ = state_space(drive, ("motor_torque",), ("motor_speed",))
    w = 1e-3j
    response = (c @ np.linalg.solve(w * np.eye(len(a)) - a, b)).item()
    assert 1.0 / (w * response) == pytest.approx(total, rel=1e-4)
