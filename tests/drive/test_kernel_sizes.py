"""Passes compiled for a number of states and of smooth laws give the same as the general one."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive.assemble import Layout
from drivetool.drive.chain import one_body
from drivetool.drive.compile.machine_code import address
from drivetool.drive.simulation import simulate
from drivetool.drive.simulation.augment import plant_of as law_plant_of
from drivetool.drive.simulation.simulate import ObserverGains, Trace
from tests.drive.test_kernel import STEP, THREE, changed, drive_of, levels, plant_of
from tests.drive.test_kernel_filter import RIG

pytestmark = pytest.mark.slow  # machine code of every size has to be compiled first
N = 1500
CASES = {
    "two": (RIG, ("motor_speed",), {}),
    "two, two sensors": (RIG, ("motor_speed", "load_speed"), {}),
    "two, shaft torque": (RIG, ("motor_speed", "shaft_torque"), {}),
    "two, angle": (RIG, ("motor_angle",), {}),
    "two, angles": (RIG, ("motor_angle", "load_angle"), {}),
    "two, angle and memory": (RIG, ("motor_angle",), {"memory": 0.97}),
    "two, memory and shaft torque": (RIG, ("motor_speed", "shaft_torque"), {"memory": 0.97}),
    "two, dead time": (changed(RIG, dead_time=1.3 * STEP), ("motor_speed",), {}),
    "two, lag": (changed(RIG, converter_bandwidth=433.0, converter_damping=0.7), ("motor_speed",), {}),
    "three": (THREE, ("motor_speed",), {}),
    "three, shaft torque": (THREE, ("motor_speed", "shaft_torque"), {}),
    "three, angle": (THREE, ("motor_angle",), {}),
    "three, memory": (THREE, ("motor_speed", "load_speed"), {"memory": 0.97}),
    "three, angle and memory": (THREE, ("motor_angle",), {"memory": 0.97}),
    "three, dead time": (changed(THREE, dead_time=0.6 * STEP), ("motor_speed",), {})}


def passes(case, free):
    """A plant, a record with missing values, an observer that changes from sample to sample."""
    machine, outputs, more = CASES[case]
    drive = drive_of(machine)
    outputs = tuple(f"{drive.bodies[-1]}_speed" if o == "load_speed" else o for o in outputs)
    plant = plant_of(drive, outputs, free, **more)
    rng, ny, nx = np.random.default_rng(1), len(outputs), plant.system.nx
    y = rng.standard_normal((N, ny))
    y[rng.uniform(size=y.shape) < 0.1] = np.nan
    trace = Trace(levels(machine, N, 2)[:, None], y, STEP)
    # Gains of up to a tenth of each output.
    gain = rng.uniform(0.0, 0.1, (N, ny, nx)) * np.sign(plant.system.outputs[:, :, 0]) * [
        [1e-3 if "torque" in o else 1.0] for o in outputs]
    return plant, trace, rng.standard_normal(nx) * 1e-2, ObserverGains(gain, rng.uniform(0.5, 2.0, (N, ny)))


@pytest.fixture(params=["free run", "observer"])
def observed(request):
    return request.param == "observer"


def general(monkeypatch, plant):
    """The same plant, which from now on uses the pass for any number of states."""
    assert plant.nx in simulate.SIZED_STATE_COUNTS
    monkeypatch.setattr(simulate, "SIZED_STATE_COUNTS", ())
    return replace(plant)


def close(found, wanted):
    np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-8 * np.nanmax(np.abs(wanted)))


@pytest.mark.parametrize("case", CASES)
def test_simulation(case, observed, monkeypatch):
    plant, trace, start, gains = passes(case, ())
    gains = gains if observed else None
    fast, short = plant.simulate(trace, start, gains, keep=True), plant.outputs(trace, start, gains)
    slow = general(monkeypatch, plant).simulate(trace, start, gains, keep=True)
    assert fast[2] == slow[2] > 10
    close(fast[0], slow[0])
    close(fast[1], slow[1])
    np.testing.assert_array_equal(short, fast[0])


@pytest.mark.parametrize("case", CASES)
def test_sensitivities(case, observed, monkeypatch):
    free = ("motor.inertia", "shaft.stiffness", "shaft.damping", "shaft.half_gap", "motor.coulomb")
    plant, trace, start, gains = passes(case, free)
    gains = gains if observed else None
    out, jac = plant.jacobian(trace, start, gains)
    out_slow, jac_slow = general(monkeypatch, plant).jacobian(trace, start, gains)
    close(out, out_slow)
    for q in range(jac.shape[2]):
        close(jac[:, :, q], jac_slow[:, :, q])


@pytest.mark.parametrize("case", CASES)
def test_kalman_pass(case, monkeypatch):
    plant, trace, start, _ = passes(case, ())
    # Where bodies stick and are released by noise, a rounding error grows: to 1e-7 in 1500 samples.
    trace = replace(trace, inputs=trace.inputs[:1000], outputs=trace.outputs[:1000])
    sensor = np.where([name < 0 for name in plant.system.output_state], 100.0, 1e-2)
    arguments = trace, start, sensor, 4.0, np.full(plant.system.nx, 1e-9)
    fast, slow = plant.filter(*arguments), general(monkeypatch, plant).filter(*arguments)
    for name in ("innovations", "variance", "states"):
        close(getattr(fast, name), getattr(slow, name))
    close(fast.gains.gain, slow.gains.gain)


ONE = one_body().with_values({"motor.inertia": 0.8, "motor.viscous": 0.4, "motor.coulomb": 3.0})
DRAG = {"motor.drag": 0.02}
RIPPLE = {"motor.ripple_sine": 3.0, "motor.ripple_cosine": 1.0, "motor.ripple_order": 6.5}
BREAKAWAY = {"motor.stribeck": 3.0, "motor.stribeck_speed": 0.5}
HARDENING = {"shaft.hardening": 1.0, "shaft.hardening_twist": 0.02}
# drive, sensors, laws, AR(1) pole of the torque noise
LAWS = {
    "one body": (ONE, ("motor_speed",), DRAG, None),
    "one body, angle and memory": (ONE, ("motor_angle",), DRAG | RIPPLE | BREAKAWAY, 0.97),
    "two": (drive_of(RIG), ("motor_speed",), BREAKAWAY, None),
    "two, angle": (drive_of(RIG), ("motor_angle", "load_angle"), HARDENING | DRAG, None),
    "three, shaft torque": (drive_of(THREE), ("motor_speed", "shaft_torque"), HARDENING, None),
    "three, memory": (drive_of(THREE), ("motor_speed",), DRAG, 0.97)}


def with_general_laws(plant):
    """The same plant, whose laws from now on use the units for any number of states and laws."""
    units = {unit: address(f"law_{unit}") for unit in ("motion", "columns", "transition")}
    assert all(getattr(plant.laws, unit) != place for unit, place in units.items())
    any_size = {unit: address(unit) for unit in ("covariance_step", "premultiply")}
    return replace(plant, laws=plant.laws._replace(**any_size, **units))


@pytest.mark.parametrize("count", range(1, 10))
def test_any_number_of_free_parameters(count):
    """Columns are carried in blocks: none may reach into the next row."""
    drive = ONE.with_values(DRAG | RIPPLE | BREAKAWAY)
    free = ("motor.inertia", "motor.viscous", "motor.coulomb", *DRAG, *RIPPLE, *BREAKAWAY)[:count]
    layout = Layout(free, ("motor_torque",), ("motor_angle",), STEP, gradient=True)
    plant, trace = law_plant_of(drive, layout), Trace(levels(RIG, N, 2)[:, None], np.zeros((N, 1)), STEP)
    (_, jac), (_, wanted) = (each.jacobian(trace, np.zeros(plant.nx)) for each in (plant, with_general_laws(plant)))
    assert len(free) == count <= jac.shape[2]
    for q in range(jac.shape[2]):
        close(jac[:, :, q], wanted[:, :, q])


@pytest.mark.parametrize("case", LAWS)
def test_smooth_laws(case, observed):
    drive, outputs, values, memory = LAWS[case]
    free = ("motor.inertia", "motor.coulomb", *values)
    rng = np.random.default_rng(1)
    trace = Trace(levels(RIG, N, 2)[:, None], 0.1 * rng.standard_normal((N, len(outputs))), STEP)

    def plants(free):
        layout = Layout(free, ("motor_torque",), outputs, STEP, gradient=bool(free), memory=memory)
        fast = law_plant_of(drive.with_values(values), layout)
        return fast, with_general_laws(fast)

    fast, slow = plants(free)
    start = rng.standard_normal(fast.nx) * 1e-2
    shape = N, len(outputs), fast.system.nx
    gains = ObserverGains(rng.uniform(0.0, 0.1, shape) * np.sign(fast.system.outputs[:, :, 0]),
                  rng.uniform(0.5, 2.0, shape[:2])) if observed else None
    (out, jac), (wanted, wanted_jac) = (plant.jacobian(trace, start, gains) for plant in (fast, slow))
    close(out, wanted)
    for q in range(jac.shape[2]):
        close(jac[:, :, q], wanted_jac[:, :, q])
    assert np.abs(jac[:, :, :len(free)]).max(axis=(0, 1)).min() > 0.0
    if not observed:
        sensor = np.where([name < 0 for name in fast.system.output_state], 100.0, 1e-2)
        found, right = (plant.filter(trace, start, sensor, 4.0, np.full(plant.nx, 1e-9)) for plant in plants(()))
        for name in ("innovations", "variance", "states"):
            close(getattr(found, name), getattr(right, name))
