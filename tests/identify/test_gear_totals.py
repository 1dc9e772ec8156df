"""Sums of friction are referred to the motor, with any gear between the bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive import Assembly, Layout, two_mass
from drivetool.drive.chain import three_mass, vehicle
from drivetool.errors import BadOption
from drivetool.identify.blackbox.estimator import blackbox
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.setup.options import Options
from drivetool.identify.steady.estimator import steady
from tests.recover import STEP, experiment
from tests.simulator.experiments import multisine
from tests.simulator.machine import Machine, running
from tests.simulator.records import white_noise
from tests.simulator.simulate import simulate_linear

GEAR = 5.0
# Referred to the motor: inertias 0.5 and 1.6, shaft 900 Nm/rad, friction 0.3 + 0.96, idle torque 4.
GEARED = Machine((0.5, 40.0), (0.3, 24.0), idle_torque=(0.0, 20.0), stiffness=(900.0 * GEAR**2,),
                 damping=(1.5 * GEAR**2,), ratio=(GEAR,))
VISCOUS, IDLE = 0.3 + 24.0 / GEAR**2, 20.0 / GEAR


def own_parts(drive, suffix):
    """The bodies' own values as the kernel gets them."""
    plain = Assembly(drive, Layout((), ("motor_torque",), (), STEP, gradient=False))
    return np.array([plain.of_body(k, suffix).v for k in range(plain.n)])


@pytest.mark.parametrize(("drive", "masses", "turns"), [
    (two_mass().with_values({"motor.inertia": 0.5, "load.inertia": 40.0, "shaft.stiffness": 1.0,
                             "shaft.ratio": 5.0}), (0.5, 40.0), (1.0, 5.0)),
    (three_mass().with_values({"motor.inertia": 1.0, "gear.inertia": 6.0, "arm.inertia": 9.0, "shaft.ratio": 4.0,
                               "shaft2.ratio": 0.5, "shaft.stiffness": 1.0, "shaft2.stiffness": 1.0}),
     (1.0, 6.0, 9.0), (1.0, 4.0, 2.0)),
    (vehicle().with_values({"motor.inertia": 4.5, "wheels.inertia": 22.0, "wheels.carried_mass": 12e3,
                            "wheels.radius": 0.45, "shaft.stiffness": 1.0, "shaft.ratio": 8.79}),
     (4.5, 22.0 + 12e3 * 0.45**2), (1.0, 8.79))])
def test_the_parts_decay_alike_and_add_up_at_the_motor(drive, masses, turns):
    masses, turns = np.array(masses), np.array(turns)
    viscous = own_parts(drive.with_values({"total.viscous": 0.7}), "viscous")
    assert viscous / masses == pytest.approx(np.full(len(masses), viscous[0] / masses[0]))
    assert (viscous / turns**2).sum() == pytest.approx(0.7)
    idle = own_parts(drive.with_values({"total.idle_torque": 3.0}), "idle_torque")
    assert (idle / turns).sum() == pytest.approx(3.0) and not idle[:-1].any()
    split_drive = drive.with_values(drive.parts("total.viscous", 0.7) | drive.parts("total.idle_torque", 3.0))
    assert own_parts(split_drive, "viscous") == pytest.approx(viscous)
    assert (split_drive.referred_to_motor("viscous"),
            split_drive.referred_to_motor("idle_torque")) == pytest.approx((0.7, 3.0))


def test_the_share_has_the_gradient_of_differences():
    drive = three_mass().with_values({"motor.inertia": 1.0, "gear.inertia": 6.0, "arm.inertia": 9.0,
                                      "shaft.ratio": 4.0, "shaft2.ratio": 0.5, "shaft.stiffness": 1.0,
                                      "shaft2.stiffness": 1.0, "total.viscous": 0.7, "arm.carried_mass": 2.0})
    free = tuple(n for n in drive.values if not n.endswith("stiffness"))
    plain = Assembly(drive, Layout(free, ("motor_torque",), (), STEP))
    assert {"shaft.ratio", "shaft2.ratio", "total.viscous", "arm.carried_mass"} < set(free)
    for k in range(3):
        for j, name in enumerate(free):
            d = 1e-6 * drive.values[name]
            up, down = (own_parts(drive.with_values({name: drive.values[name] + x}), "viscous")[k] for x in (d, -d))
            assert plain.of_body(k, "viscous").d[j] == pytest.approx((up - down) / (2 * d), rel=1e-6, abs=1e-8)


def record(machine, seed=1, size=12_000):
    """Slow steps of torque and a multisine about the resonance, from 40 rad/s."""
    start = running(machine, 40.0)
    levels = np.repeat(np.random.default_rng(seed).choice([-4.0, 0.0, 4.0], size // 1500), 1500)
    torque = start.torque + levels + multisine(np.arange(1.0, 12.0), 1.0, size * STEP, STEP, seed)
    run = simulate_linear(machine, torque, STEP, start, white_noise(size, 0.05, 2 * seed))
    return experiment(torque, run.speeds[:, 0] + white_noise(size, 0.01, 2 * seed + 1))


def lines(estimate):
    return {p.name: p for p in estimate.parameters}


@pytest.mark.slow
def test_a_sum_across_a_gear_is_found_with_its_interval():
    """Black box, then grey box with the sum free and with its parts shared unlike the rule."""
    for machine in (GEARED, replace(GEARED, viscous=(0.0, VISCOUS * GEAR**2))):
        data = [record(machine, seed) for seed in (1, 2)]
        first = blackbox(data, two_mass().with_values({"shaft.ratio": GEAR}), Options())
        second = greybox(data, first.drive, Options(free=("total.viscous",)))
        (total,) = second.ratios  # it turns one way: of the idle torque and the Coulomb friction
        for p, value in ((lines(first)["total.viscous"], VISCOUS), (lines(first)["total.idle_torque"], IDLE),
                         (lines(second)["total.viscous"], VISCOUS), (total, IDLE)):
            assert abs(p.value - value) < 3.0 * p.std and p.std < 0.1 * value, p.name
        assert abs(lines(second)["load.inertia"].value - 40.0) < 3.0 * lines(second)["load.inertia"].std


def test_steady_running_across_a_gear():
    """T = (c_m + c_l / n^2) w + T0 / n."""
    torque, speed = [], []
    for level in (20.0, 40.0, 60.0, 30.0):
        torque.append(np.full(3000, VISCOUS * level + IDLE))
        speed.append(np.full(3000, level))
    torque, speed = np.concatenate(torque), np.concatenate(speed)
    data = experiment(torque + white_noise(len(torque), 0.1, 3), speed + white_noise(len(torque), 0.01, 4))
    drive = two_mass().with_values({"shaft.ratio": GEAR})
    found = lines(steady([data], drive, Options()))
    for name, value in (("total.viscous", VISCOUS), ("total.idle_torque", IDLE)):
        assert abs(found[name].value - value) < 3.0 * found[name].std, name
    held = drive.with_values({"load.viscous": 24.0})
    assert lines(steady([data], held, Options(hold=("load.viscous",))))["motor.viscous"].value == pytest.approx(
        0.3, abs=4.0 * found["total.viscous"].std)
    with pytest.raises(BadOption, match="gear"):
        steady([data], drive.with_values({"motor.viscous": 0.3}), Options(hold=("motor.viscous",)))
