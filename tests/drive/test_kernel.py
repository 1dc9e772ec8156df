"""The kernel against exact steps of linear chains, and helpers shared by the other kernel tests."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from drivetool.drive.assemble import Layout
from drivetool.drive.chain import Drive, two_mass
from drivetool.drive.linearise import state_space
from drivetool.drive.simulation import augment
from drivetool.drive.simulation.simulate import Trace
from drivetool.errors import BadParameters
from tests.simulator.machine import Machine, State, at_rest, machine_by_seed
from tests.simulator.simulate import simulate, simulate_linear

STEP = 1e-3
CHAIN = Machine((0.4, 0.7, 3.0), (0.1, 0.2, 0.3), (), (1.0, 0.5, 2.0), (900.0, 400.0), (0.5, 0.8), (),
                (2.0, 0.5), "inside", 433.0, 0.69, 0.0023)
THREE = Machine((0.6, 1.0, 5.2), (0.8, 0.0, 0.1), (5.0, 2.0, 1.0), (0.0, 0.0, 8.0), (9300.0, 3300.0),
                (3.1, 3.0), (0.01, 0.003), (2.0, 0.7), rated_torque=300.0)
NAMES = {1: ("motor",), 2: ("motor", "load"), 3: ("motor", "gear", "arm")}


def drive_of(machine):
    """The same machine for drivetool."""
    n = machine.bodies
    bodies = NAMES.get(n) or tuple(f"body{k}" for k in range(n))
    shafts = ("shaft", *(f"shaft{k}" for k in range(2, n)))[:n - 1]
    values = {"converter.dead_time": machine.dead_time}
    for owners, suffixes in ((bodies, ("inertia", "viscous", "coulomb", "idle_torque")),
                             (shafts, ("stiffness", "damping", "half_gap", "ratio"))):
        for suffix in suffixes:
            values |= {f"{o}.{suffix}": v for o, v in zip(owners, getattr(machine, suffix), strict=True)}
    if machine.converter_bandwidth is not None:
        values |= {"converter.bandwidth": machine.converter_bandwidth, **(
            {"converter.order": 1.0} if np.isinf(machine.converter_damping)
            else {"converter.damping": machine.converter_damping})}
    return Drive("test", bodies, shafts, values, damping_law=machine.law)


def plant_of(drive, outputs, free=(), step=STEP, load=False, more_inputs=(), **more):
    """A drive ready to run."""
    inputs = ("motor_torque", "load_torque") if load else ("motor_torque",)
    layout = Layout(tuple(free), (*inputs, *more_inputs), tuple(outputs), step, gradient=bool(free), **more)
    return augment.plant_of(drive, layout)


def start_of(machine, plant, start=None):
    """(nx,) start state; the command before the record must be `start.torque`."""
    start = start or at_rest(machine)
    x = np.zeros(plant.system.nx)
    n = machine.bodies
    x[:2 * n - 1] = [*start.speeds, *start.twists]
    lag = (2 - np.isinf(machine.converter_damping)) * (machine.converter_bandwidth is not None)
    angle = plant.system.nx - 2 * n + 1 - lag
    if angle:
        x[2 * n - 1] = start.angle
    x[2 * n - 1 + angle:][:lag] = (start.torque, start.torque_rate)[:lag]
    return x


def kernel(machine, torque, step=STEP, start=None, load=None):
    """(speeds (n, bodies), shaft torque (n, 0 or 1), angles (n, bodies), samples with events)."""
    bodies, shaft = drive_of(machine).bodies, ["shaft_torque"] * (machine.bodies > 1)
    outputs = [f"{b}_speed" for b in bodies] + shaft + [f"{b}_angle" for b in bodies]
    plant = plant_of(drive_of(machine), outputs, step=step, load=load is not None)
    u = np.asarray(torque, float)[:, None] if load is None else np.column_stack([torque, load])
    trace = Trace(u, np.full((len(u), len(outputs)), np.nan), step)
    out, _, located = plant.simulate(trace, start_of(machine, plant, start))
    n = machine.bodies
    return out[:, :n], out[:, n:n + len(shaft)], out[:, n + len(shaft):], located


def levels(machine, n, seed, hold=40, share=0.25):
    """(n,) random torque levels, held for `hold` samples."""
    drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, -(-n // hold))
    return share * machine.rated_torque * np.repeat(drawn, hold)[:n]


def compared(machine, torque, step=STEP, start=None, load=None):
    """(rms difference of speeds, events of the simulator, samples with events in the kernel).

    Shaft torque and angles must agree as far as the speeds do.
    """
    start = dataclasses.replace(start or at_rest(machine), torque=float(torque[0]))
    truth = simulate(machine, torque, step, start, load_torque=load)
    speeds, shaft, angles, located = kernel(machine, torque, step, start, load)
    error = rms(speeds - truth.speeds)
    assert rms(angles - truth.angles) < 1e-9 + error * max(1.0, len(torque) * step)
    if machine.bodies > 1:
        size = machine.stiffness[0] * step + machine.damping[0]
        assert rms(shaft[:, 0] - truth.shaft_torques[:, 0]) < 1e-7 + 1e3 * error * size
    return error, truth.events, located


def rms(values):
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def changed(machine, **fields):
    """The machine with some fields replaced."""
    return dataclasses.replace(machine, **fields)


# Linear chains


def late_by(samples):
    """The three-mass chain with a converter and a dead time."""
    return changed(CHAIN, dead_time=samples * STEP)


LINEAR = {
    "one body": Machine((2.0,), (0.3,), (), (1.7,)),
    "two bodies": machine_by_seed(2),
    "two bodies, soft": machine_by_seed(2, stiffness=(0.5,), damping=(0.0,)),
    "two bodies, stiff": machine_by_seed(3, stiffness=(1e6,)),
    "heavy damping": machine_by_seed(4, viscous=(300.0, 20.0), damping=(1e3,)),
    "three bodies, ratios, converter, dead time": CHAIN,
    "a converter of first order": changed(CHAIN, converter_damping=np.inf),
    "less than a sample late": late_by(0.3),
    "whole samples late": late_by(3.0),
    "a rounding error short of whole samples": late_by(np.nextafter(3.0, 0.0)),
    "five bodies": Machine(
        (1.0, 0.2, 3.0, 0.1, 2.0), (0.1, 0.0, 0.2, 0.0, 0.3), (), (0.0, 0.5, 0.0, 0.0, 1.0),
        (900.0, 4000.0, 500.0, 800.0), (0.5, 0.8, 0.1, 0.0), (), (2.0, 0.5, 1.5, 0.8)),
}


@pytest.mark.parametrize("name", LINEAR)
def test_linear_chain_is_exact(name):
    machine = LINEAR[name]
    rng, n = np.random.default_rng(1), machine.bodies
    torque, load = np.repeat(rng.uniform(-20.0, 20.0, (2, 60)), 20, axis=1)
    speeds, twists = rng.uniform(-2.0, 2.0, n), rng.uniform(-0.01, 0.01, n - 1)
    start = State(tuple(speeds), tuple(twists), 0.4, torque[0], 3.0)
    speeds, shaft, angles, located = kernel(machine, torque, STEP, start, load)
    exact = simulate_linear(machine, torque, STEP, start, load_torque=load)
    assert np.abs(speeds - exact.speeds).max() < 1e-9
    assert np.abs(angles - exact.angles).max() < 1e-9
    assert located == 0
    if n > 1:
        passed = exact.shaft_torques[:, 0]
        np.testing.assert_allclose(shaft[:, 0], passed, atol=1e-9 * np.ptp(passed))


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_a_lag_of_the_torque_and_a_filter_on_the_speed_commute(order):
    """On a linear drive, where they are indistinguishable."""
    machine, lag = machine_by_seed(1, idle_torque=(0.0, 0.0)), {"bandwidth": 250.0, "order": order}
    trace = Trace(np.repeat([0.0, 20.0, -5.0], 200)[:, None], np.full((600, 1), np.nan), STEP)
    runs = []
    for owner in ("converter", "sensor"):
        plant = plant_of(drive_of(machine).with_values({f"{owner}.{k}": v for k, v in lag.items()}),
                         ["motor_speed"])
        runs.append(plant.outputs(trace, np.zeros(plant.nx)))
    np.testing.assert_allclose(*runs, atol=1e-9 * np.abs(runs[0]).max())
    plain = plant_of(drive_of(machine), ["motor_speed"])
    assert np.abs(plain.outputs(trace, np.zeros(3)) - runs[0]).max() > 0.01 * np.abs(runs[0]).max()


@pytest.mark.parametrize("values", [{"converter.order": 1.5}, {"sensor.order": 0.0}])
def test_a_lag_of_no_such_order_is_refused(values):
    given = {"converter.bandwidth": 250.0, "sensor.bandwidth": 250.0, **values}
    with pytest.raises(BadParameters, match="order"):
        plant_of(drive_of(machine_by_seed(1)).with_values(given), ["motor_speed"])


def test_an_order_cannot_be_fitted():
    drive = drive_of(machine_by_seed(1)).with_values({"converter.bandwidth": 250.0})
    with pytest.raises(BadParameters, match="order"):
        plant_of(drive, ["motor_speed"], free=("converter.order",))


def test_a_total_is_shared_out():
    parts = drive_of(machine_by_seed(1, viscous=(0.0, 0.0), idle_torque=(0.0, 5.0)))
    ratio = np.array([parts.values["motor.inertia"], parts.values["load.inertia"]])
    shared = dict(zip(("motor.viscous", "load.viscous"), 3.0 * ratio / ratio.sum(), strict=True))
    trace = Trace(np.full((300, 1), 20.0), np.zeros((300, 1)), STEP)
    runs = [plant_of(drive, ["motor_speed"]).outputs(trace, np.zeros(3)) for drive in (
        parts.with_values(shared), parts.with_values({"total.viscous": 3.0, "total.idle_torque": 5.0}))]
    np.testing.assert_allclose(*runs, atol=1e-12)


def test_an_interpolated_torque_is_a_first_order_hold():
    """Against SciPy's exact first-order hold: the mean over a sample leaves a thousandth; a held torque 3 %."""
    drive = two_mass().with_values({"motor.inertia": 0.6, "load.inertia": 5.2, "shaft.stiffness": 3300.0,
                                    "shaft.damping": 3.1, "motor.viscous": 0.8})
    step, n = 1e-3, 2000
    instants = np.arange(n) * step
    u = 50.0 * np.sin(2.0 * np.pi * 10.0 * instants) * np.exp(-instants)
    layout = Layout((), ("motor_torque",), ("motor_speed",), step, gradient=False)
    trace = Trace(u[:, None], np.full((n, 1), np.nan), step)
    linear = cont2discrete(state_space(drive, layout.inputs, layout.outputs), step, "foh")
    exact = dlsim(linear, u, t=instants)[1][:, 0]

    def error(share):
        plant = augment.plant_of(drive.with_values({"converter.interpolation": share}), layout)
        return np.std(plant.outputs(trace, np.zeros(3))[:, 0] - exact) / np.std(exact)
    assert error(1.0) < 1e-3 < 0.02 < error(0.0)
