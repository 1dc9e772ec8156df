"""Inverse dynamics of a chain: the motor is moved as measured, the rest follows; held against the simulator."""

import numpy as np
import pytest

from drivetool.check.validation import ValidateOptions, validate_torque
from drivetool.drive import two_mass
from drivetool.errors import NotEnoughData
from drivetool.identify.greybox.estimator import greybox
from drivetool.identify.motion.chain_torque import initial_transient, torque_of_chain
from drivetool.identify.motion.motion import motions_of
from drivetool.identify.setup.options import Options
from tests.recover import experiment, truth
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise

STEP = 1e-3
# Friction holds and drags the load, so that it soon forgets how it began: a damper, a clutch, a geared joint.
MACHINE = Machine((0.05, 0.02), (0.02, 0.01), (0.3, 2.0), (0.1, 0.4), (400.0,), (1.5,), (0.02,))
GEARED = Machine((0.05, 0.5), (0.02, 0.3), (0.3, 30.0), (0.1, 2.0), (9000.0,), (60.0,), (0.004,), ratio=(5.0,))
RATTLING = Machine((0.05, 0.2), (0.02, 0.03), (0.3, 1.0), (0.1, 0.4), (900.0,), (0.8,), (0.02,))
FREE = ("shaft.half_gap", "motor.coulomb", "load.coulomb")


def moved(machine, seed, noise=0.0, torque_noise=0.0, seconds=8.0, shaken=()):
    """(record, what happened): a stiff speed loop moves the motor to and fro, ever faster and slower.

    shaken  frequencies [Hz] at which it is shaken besides
    """
    n = round(seconds / STEP)
    time = np.arange(n) * STEP
    height = 4.0 + 3.0 * np.sin(0.4 * time + np.random.default_rng(seed).uniform(0.0, 6.0))
    reference = height * np.sin(2.0 * np.pi * time)
    reference += sum(0.5 * np.sin(2.0 * np.pi * f * time + f) for f in shaken)
    run = simulate_fast(machine, np.zeros(n), STEP, controller=PI(reference, 6.0, 60.0),
                        torque_noise=white_noise(n, torque_noise, seed + 1),
                        sensor_noise=white_noise(n, noise, seed + 2), finer=8)
    return experiment(run.command, run.measured, reference_speed=reference), run


def values_of(machine):
    values = {n: v for n, v in truth(machine).items() if not n.startswith("total.")}
    return values | {"shaft.ratio": machine.ratio[0]}


@pytest.mark.parametrize("machine", [MACHINE, GEARED], ids=["gap", "gear"])
def test_the_chain_requires_the_torque_that_the_simulator_has(machine):
    record, run = moved(machine, 3)
    drive = two_mass().with_values(values_of(machine))
    seen = motions_of([record], "motor_speed").each[0]
    found, settled = torque_of_chain(drive, (), record, seen, {}), ~initial_transient(drive, record, seen, {})
    mean = 0.5 * (run.shaft_torques[1:, 0] + run.shaft_torques[:-1, 0]) / machine.ratio[0]
    off = (found.value[:-1] - mean)[settled[:-1]]
    assert settled.mean() > 0.9
    assert np.sqrt(np.mean(off**2)) < 1e-3 * np.std(mean)


def test_derivatives_are_those_of_the_values():
    record, _ = moved(MACHINE, 3, seconds=4.0)
    drive = two_mass().with_values(values_of(MACHINE))
    seen = motions_of([record], "motor_speed").each[0]
    free = ("motor.inertia", "load.inertia", "load.viscous", "load.coulomb", "load.idle_torque", "shaft.stiffness",
            "shaft.damping", "shaft.half_gap", "shaft.ratio")
    slopes, settled = torque_of_chain(drive, free, record, seen, {}).slopes, ~initial_transient(drive, record, seen,
                                                                                             {})
    assert not slopes[:, 0].any()
    for j, name in enumerate(free[1:], 1):
        h = 1e-5 * drive.value(name)
        up, down = (torque_of_chain(drive.with_values({name: drive.value(name) + s * h}), free, record, seen,
                                    {}).value
                    for s in (1.0, -1.0))
        numeric = (up - down) / (2.0 * h)
        size = np.sqrt(np.mean(numeric[settled] ** 2))
        off = np.abs(slopes[settled, j] - numeric[settled])
        # At the instant of a contact the difference straddles an event.
        assert np.quantile(off, 0.98) < 1e-3 * size, name


@pytest.mark.slow
@pytest.mark.parametrize("machine", [MACHINE, GEARED], ids=["gap", "gear"])
def test_a_chain_with_a_gap_is_recovered(machine):
    records = [moved(machine, seed, 2e-3, 0.02)[0] for seed in (5, 55)]
    true = values_of(machine)
    start = {n: v * f for (n, v), f in zip(true.items(), np.resize([1.2, 0.85], len(true)), strict=True)}
    drive = two_mass().with_values({**start, "shaft.ratio": machine.ratio[0]})
    e = greybox(records, drive, Options(criterion="inverse", free=FREE))
    for p in e.parameters:
        if p.status == "fitted":
            assert abs(p.value - true[p.name]) < 4.0 * p.std, p.name
            parts = (p.std_noise, p.std_structure, p.std_between or 0.0)
            assert p.std == pytest.approx(np.linalg.norm(parts), rel=1e-6), p.name
    found = {p.name: p.value for p in e.parameters}
    for name, within in (("motor.inertia", 0.02), ("load.inertia", 0.03), ("shaft.half_gap", 0.05),
                         ("load.coulomb", 0.05), ("shaft.stiffness", 0.1)):
        assert found[name] == pytest.approx(true[name], rel=within), name


def test_a_load_that_rattles_is_refused():
    record, _ = moved(RATTLING, 3)
    drive = two_mass().with_values(values_of(RATTLING))
    with pytest.raises(NotEnoughData, match="initial transient decays"):
        greybox([record], drive, Options(criterion="inverse"))


def test_sums_of_friction_are_shared_out_before_the_motor_is_moved():
    record, _ = moved(MACHINE, 3)
    parts = two_mass().with_values({**values_of(MACHINE), "motor.viscous": 0.1, "load.viscous": 0.04})
    sums = two_mass().with_values({**values_of(MACHINE), "total.viscous": 0.14})
    assert sums.parts("total.viscous", 0.14) == pytest.approx({"motor.viscous": 0.1, "load.viscous": 0.04})
    fits = [validate_torque([record], [("m", d)], ValidateOptions()).checks[0].rmse for d in (parts, sums)]
    assert fits[0] == pytest.approx(fits[1], rel=1e-9)


@pytest.mark.slow
def test_intervals_of_a_chain_hold():
    """Instruments do not cure what noise of the motion makes of a gap: std_structure covers it."""
    true, held, count = values_of(MACHINE), 0, 0
    for seed in range(300, 324):
        record, _ = moved(MACHINE, seed, 2e-3, 0.02)
        start = {n: v * f for (n, v), f in zip(true.items(), np.resize([1.1, 0.9], len(true)), strict=True)}
        drive = two_mass().with_values({**start, "shaft.ratio": 1.0})
        for p in greybox([record], drive, Options(criterion="inverse", free=FREE)).parameters:
            if p.status == "fitted":
                held, count = held + (abs(p.value - true[p.name]) < 1.96 * p.std), count + 1
    assert count > 230 and held / count >= 0.92


@pytest.mark.slow
def test_a_chain_without_dry_friction_and_gap_is_no_straight_line_over_its_parameters():
    """Its torque is in proportion to all of them together, which one linear step must not be taken for."""
    machine = Machine((0.05, 0.02), (0.02, 0.05), (0.0, 0.0), (0.1, 0.0), (40.0,), (0.5,))
    record, _ = moved(machine, 3, noise=1e-3, shaken=(3.1, 5.3, 7.7, 11.9))
    drive = two_mass().with_values({"motor.inertia": 0.04, "motor.viscous": 0.02, "load.inertia": 0.04,
                                    "load.viscous": 0.03, "shaft.stiffness": 80.0, "shaft.damping": 0.8})
    found = greybox([record], drive, Options(criterion="inverse", hold=("motor.coulomb",)))
    assert found.fit["torque_rmse_over_sd"] < 0.02
    assert "load.idle_torque" not in {p.name for p in found.parameters if p.status == "fitted"}
    for p in found.parameters:
        if p.name in ("load.inertia", "shaft.stiffness"):
            assert p.value == pytest.approx(truth(machine)[p.name], rel=0.1)
