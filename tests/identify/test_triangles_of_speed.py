"""A servo in a stiff loop follows triangles of speed: over a second its motion is a straight line.

Free runs of a second have a constant torque of their own, which explains that by itself. They choose no inertia.
"""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import one_body
from drivetool.identify.greybox import greybox
from drivetool.identify.setup import Options
from tests.coverage_of import interval
from tests.recover import STEP, experiment
from tests.simulator.controllers import PositionPD
from tests.simulator.machine import Machine, at_rest
from tests.simulator.simulate import Sensor, simulate

INERTIA, VISCOUS, COULOMB = 1.95e-4, 3.3e-4, 0.03
ACCELERATION, TOP, MEMORY, COUNT = 30.0, 60.0, 0.15, 6.3e-4  # rad/s2, rad/s, s, rad
RATED = INERTIA * ACCELERATION + VISCOUS * TOP + COULOMB
TRUTH = {"motor.inertia": INERTIA, "motor.viscous": VISCOUS, "motor.coulomb": COULOMB}


def servo(share, seed):
    """Ten seconds of torque and counted angle; share: std of the disturbance over the torque, with a memory."""
    rng, n = np.random.default_rng([69, seed]), 10_000
    turned = (STEP * np.arange(n) * ACCELERATION) % (4.0 * TOP)
    speed = np.where(turned < TOP, turned, np.where(turned < 3.0 * TOP, 2.0 * TOP - turned, turned - 4.0 * TOP))
    kept, disturbance = np.exp(-STEP / MEMORY), np.zeros(n)
    for i, kick in enumerate(rng.normal(size=n) * np.sqrt(1.0 - kept**2) * share * RATED):
        disturbance[i] = kept * disturbance[i - 1] + kick
    stiff = 2.0 * np.pi * rng.uniform(15.0, 25.0)
    loop = PositionPD(STEP * np.cumsum(speed), INERTIA * stiff**2, 1.4 * INERTIA * stiff, STEP, 6.0 * stiff,
                      limit=10.0 * RATED)
    machine = Machine((INERTIA,), (VISCOUS,), (COULOMB,))
    run = simulate(machine, np.zeros(n), STEP, at_rest(machine), loop, disturbance,
                   sensor=Sensor("angle", None, COUNT))
    made = experiment(run.command, run.measured, f"servo-{seed}")
    return replace(made, signals={"motor_torque": run.command, "motor_angle": run.measured})


def counts(share, seeds):
    """How often each interval holds the truth; the torque explains the motion in every record."""
    held = dict.fromkeys(TRUTH, 0)
    for seed in seeds:
        found = greybox([servo(share, seed)], one_body().with_values({"motor.inertia": 3e-4}), Options())
        assert "explains-nothing" not in {f.code for f in found.findings}
        for name, value in TRUTH.items():
            line = found.line(name)
            held[name] += line.ci95 is not None and line.ci95[0] <= value <= line.ci95[1]
    print(share, held)
    return held


def test_the_inertia_of_a_servo_is_found():
    assert counts(0.012, [0])["motor.inertia"] == 1


@pytest.mark.slow
def test_the_intervals_of_four_hold():
    assert min(counts(0.025, range(4)).values()) >= 3


@pytest.mark.study
def test_the_intervals_of_twenty_hold():
    for share in (0.0, 0.012, 0.025, 0.05):
        held = counts(share, range(20))
        assert all(interval(k, 20, 0.99 + 0.01 * 11 / 12).high >= 0.92 for k in held.values()), (share, held)
