"""Extreme input: many random machines and extreme values, and no run hangs or crashes."""

import numpy as np
import pytest

from drivetool.drive.arrays import system
from drivetool.drive.simulation.simulate import Trace
from tests.drive.test_kernel import STEP, compared, drive_of, kernel, levels, plant_of, rms, start_of
from tests.simulator.machine import Machine, State


def random_machine(rng):
    """One to four bodies, anything on or off, and a start."""
    n = int(rng.integers(1, 5))
    inertia = 10.0 ** rng.uniform(-1.0, 1.0, n)
    reduced = 1.0 / (1.0 / inertia[:-1] + 1.0 / inertia[1:])
    stiffness = reduced * (2.0 * np.pi * 10.0 ** rng.uniform(0.3, 2.0, n - 1)) ** 2
    rated = inertia.sum() * rng.uniform(5.0, 80.0)
    twist = rated / stiffness

    def some(scale, size):
        return tuple(scale * rng.uniform(0.0, 1.0, size) * (rng.uniform(size=size) < 0.6))

    machine = Machine(
        tuple(inertia), some(0.02 * rated, n), some(0.15 * rated, n), some(0.1 * rated, n), tuple(stiffness),
        some(0.1 * np.sqrt(stiffness * reduced), n - 1), some(0.3 * twist, n - 1),
        tuple(10.0 ** rng.uniform(-0.3, 0.3, n - 1)), ("inside", "always")[rng.integers(2)],
        (None, 200.0, 2000.0)[rng.integers(3)], 0.7, (0.0, 0.3, 1.7)[rng.integers(3)] * STEP, float(rated))
    speeds = rng.uniform(-1.0, 1.0, n) * (rng.uniform(size=n) < 0.6)
    twists = rng.uniform(-1.0, 1.0, n - 1) * twist * (rng.uniform(size=n - 1) < 0.7)
    return machine, State(tuple(speeds), tuple(twists))


def torque_of(machine, rng, n):
    """Held levels, pulses and zeros."""
    torque = levels(machine, n, int(rng.integers(1 << 30)), hold=int(rng.integers(1, 12)), share=0.5)
    return torque * (rng.uniform(size=n) < 0.8)


@pytest.mark.slow
def test_five_hundred_machines_do_not_care_about_sampling():
    """Four times finer sampling: the same motion, and fewer than all samples have events."""
    rng, errors, located = np.random.default_rng(2024), [], 0
    for _ in range(500):
        machine, start = random_machine(rng)
        torque = torque_of(machine, rng, 60)
        start = State(start.speeds, start.twists, 0.0, torque[0])
        coarse, _, angles, count = kernel(machine, torque, STEP, start)
        fine, _, _, _ = kernel(machine, np.repeat(torque, 4), STEP / 4, start)
        assert np.all(np.isfinite(coarse)) and np.all(np.isfinite(angles))
        errors.append(rms(coarse - fine[::4]) / max(1.0, np.abs(fine).max()))
        located += count
    # A few machines amplify rounding errors by many impacts.
    assert np.quantile(errors, 0.99) < 1e-9 and max(errors) < 1e-6
    assert 500 < located < 0.5 * 500 * 60


@pytest.mark.slow
def test_a_part_of_them_against_the_simulator():
    rng, errors = np.random.default_rng(77), []
    for _ in range(60):
        machine, start = random_machine(rng)
        errors.append(compared(machine, torque_of(machine, rng, 40), STEP, start)[0])
    assert np.quantile(errors, 0.9) < 1e-9 and max(errors) < 1e-7


EXTREME = {
    "motor.inertia": (1e-12, 1e12), "load.inertia": (1e-12, 1e12), "shaft.stiffness": (1e-9, 1e15),
    "shaft.damping": (0.0, 1e12), "motor.viscous": (0.0, 1e12), "motor.coulomb": (0.0, 1e12),
    "shaft.half_gap": (0.0, 1e3), "converter.bandwidth": (1e-3, 1e9), "shaft.ratio": (1e-6, 1e6),
    "converter.dead_time": (0.0, 1.0), "load.idle_torque": (-1e12, 1e12),
}


@pytest.mark.parametrize("name", EXTREME)
@pytest.mark.parametrize("law", ["inside", "always"])
def test_values_at_the_bounds_of_what_a_fit_may_try_end_soon(name, law):
    """Trial values of a fit: any result is accepted, but the run must end, also with sensitivities."""
    machine = Machine((0.6, 5.2), (0.8, 0.3), (5.0, 4.0), (0.0, 8.0), (3300.0,), (3.1,), (0.01,), law=law,
                      rated_torque=100.0)
    for value in EXTREME[name]:
        drive = drive_of(machine).with_values({name: value})
        plant = plant_of(drive, ["motor_speed"], tuple(EXTREME)[:3])
        trace = Trace(levels(machine, 200, 1)[:, None], np.zeros((200, 1)), STEP)
        out, _ = plant.jacobian(trace, np.zeros(plant.system.nx))
        assert out.shape == (200, 1)


@pytest.mark.parametrize("stiffness", [1e5, 1e7, 1e9, 1e12])
def test_a_machine_too_stiff_for_the_record_is_a_rigid_one(stiffness):
    """Above a certain stiffness events are not located: the motion must stay that of one body."""
    machine = Machine((0.6, 5.2), (0.8, 0.3), (5.0, 4.0), (0.0, 8.0), (stiffness,), (1e-3 * stiffness,),
                      (1e-9,), rated_torque=100.0)
    torque = np.concatenate([np.full(300, 60.0), np.full(600, -60.0)])
    speeds = kernel(machine, torque)[0]
    rigid = kernel(Machine((5.8,), (1.1,), (9.0,), (8.0,)), torque)[0]
    assert rms(speeds - rigid) < 2e-2 * np.abs(rigid).max()


@pytest.mark.parametrize("dead_time", [0.0, 0.4 * STEP])
def test_more_modes_than_are_kept(monkeypatch, dead_time):
    """A cache that is emptied repeatedly changes nothing."""
    n = 3
    machine = Machine((1.0,) * n, (0.3,) * n, (1.0,) * n, (), (2000.0,) * (n - 1), (1.0,) * (n - 1),
                      (2e-4,) * (n - 1), dead_time=dead_time, rated_torque=80.0)
    free, trace = ("motor.inertia", "converter.dead_time"), Trace(
        levels(machine, 1500, 3, hold=15)[:, None], np.zeros((1500, 1)), STEP)
    runs = []
    for capacity in (system.MAX_CACHED_MODES, 3):
        monkeypatch.setattr(system, "MAX_CACHED_MODES", capacity)
        plant = plant_of(drive_of(machine), ["motor_speed"], free)
        runs.append(plant.jacobian(trace, start_of(machine, plant))[1])
    assert plant.cache.rate.size == 4
    np.testing.assert_array_equal(*runs)


def test_numbers_that_are_not_finite_end_too():
    machine = Machine((0.6, 5.2), coulomb=(5.0, 4.0), stiffness=(3300.0,), half_gap=(0.01,),
                      rated_torque=100.0)
    plant = plant_of(drive_of(machine), ["motor_speed"])
    for poison in (np.nan, np.inf, 1e300):
        torque = levels(machine, 100, 1)[:, None]
        torque[50] = poison
        out = plant.outputs(Trace(torque, np.zeros((100, 1)), STEP), start_of(machine, plant))
        assert len(out) == 100 and np.all(np.isfinite(out[:50]))


def test_how_arrays_lie_in_memory_does_not_matter():
    """Columns first, every second row, whole numbers: the kernel reads contiguous rows of floats."""
    machine = Machine((0.6, 5.2), (0.8, 0.3), (0.0, 0.0), (0.0, 0.0), (3300.0,), (3.1,), rated_torque=200.0)
    plant = plant_of(drive_of(machine), ["motor_speed", "load_speed"])
    torque = np.round(levels(machine, 400, 1))[:, None]
    measured = plant.outputs(Trace(torque, np.zeros((400, 2)), STEP), np.zeros(3))
    runs = [plant.filter(Trace(u, y, STEP), np.zeros(3), np.ones(2), 1.0, np.zeros(3), p).innovations
            for u, y, p in ((torque, measured, np.eye(3)),
                            (torque.astype(int), np.asfortranarray(measured), np.asfortranarray(np.eye(3))),
                            (np.repeat(torque, 2, 0)[::2], np.repeat(measured, 2, 0)[::2], np.eye(3, dtype=int)))]
    assert np.abs(runs[0]).max() < 1e-9
    for other in runs[1:]:
        np.testing.assert_array_equal(other, runs[0])
