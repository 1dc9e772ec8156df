"""The two-axis model of an induction motor: poles, equivalent circuit, and run-ups against a general solver."""

from dataclasses import replace

import numpy as np
import pytest

from drivetool.drive.assemble import Layout
from drivetool.drive.chain import one_body
from drivetool.drive.effects.induction import FLUXES, VOLTAGES, flux_dynamics, steady_torque
from drivetool.drive.simulation.augment import plant_of
from drivetool.drive.simulation.simulate import Trace
from tests.coasting import STEP
from tests.induction import ELECTRICAL, Machine, run_up

MECHANICAL = {"motor.inertia": 8.7499e-5, "motor.viscous": 1.0791e-4, "motor.coulomb": 0.012998,
              "motor.idle_torque": 0.0}
PHASE_PEAK = 220.0 * np.sqrt(2.0 / 3.0)
FREE = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.rotor_resistance", "motor.leakage_inductance",
        "motor.magnetizing_inductance", "motor.stator_resistance")


def drive_of(frequency=50.0, **more):
    """The reference's motor in a frame of that frequency."""
    return one_body().with_values({**MECHANICAL, **ELECTRICAL, "motor.supply_frequency": frequency, **more})


def simulated(drive, samples, voltage=PHASE_PEAK, free=(), step=STEP, start=None):
    """(outputs, sensitivities or None) of the speed from switching on at rest without flux."""
    plant = plant_of(drive, Layout(tuple(free), ("motor_torque", *VOLTAGES), ("motor_speed",), step,
                                   gradient=bool(free)))
    vector = np.broadcast_to(voltage, samples)
    inputs = np.column_stack([np.zeros(samples), np.real(vector), np.imag(vector)])
    trace = Trace(inputs, np.zeros((samples, 1)), step)
    begin = np.zeros(plant.nx) if start is None else start
    if not free:
        return plant.outputs(trace, begin)[:, 0], None
    out, slopes = plant.jacobian(trace, begin)
    return out[:, 0], slopes[:, 0, :len(free)]


@pytest.mark.parametrize(("speed", "pole"), [(0.0, -13.08), (150.0, -54.54), (303.7, -67.63)])
@pytest.mark.parametrize("frequency", [0.0, 40.0, 50.0])
def test_the_fluxes_fade_as_the_reference_has_it_whatever_the_frequency(speed, pole, frequency):
    assert np.linalg.eigvals(flux_dynamics(drive_of(frequency), speed)).real.max() == pytest.approx(pole, abs=5e-3)


def circuit_torque(machine, slip):
    """Torque of the equivalent circuit: stator branch, magnetizing branch beside leakage and Rr/s."""
    we, leak = 2.0 * np.pi * machine.frequency, 0.5j * 2.0 * np.pi * machine.frequency * machine.leakage
    rotor, magnetizing = machine.rotor / slip + leak, 1j * we * machine.magnetizing
    whole = machine.stator + leak + rotor * magnetizing / (rotor + magnetizing)
    current = machine.voltage / np.sqrt(3.0) / whole * magnetizing / (rotor + magnetizing)
    return 3.0 * machine.pairs / we * abs(current) ** 2 * machine.rotor / slip


@pytest.mark.parametrize("pairs", [1, 2])
@pytest.mark.parametrize("slip", [-0.5, -0.03, 1e-3, 0.033, 0.3, 1.0, 1.8])
def test_a_steady_torque_is_that_of_the_equivalent_circuit(slip, pairs):
    machine = Machine(pairs=pairs)
    drive = drive_of(**{"motor.pole_pairs": float(pairs)})
    speed = (1.0 - slip) * 2.0 * np.pi * 50.0 / pairs
    assert steady_torque(drive, PHASE_PEAK, speed) == pytest.approx(circuit_torque(machine, slip), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("machine", [Machine(), Machine(voltage=180.0, frequency=40.0), Machine(pairs=2)],
                         ids=["50 Hz", "40 Hz", "two pole pairs"])
def test_a_run_up_is_that_of_a_general_solver(machine):
    drive = drive_of(machine.frequency, **{"motor.pole_pairs": float(machine.pairs)})
    truth = run_up(machine, 0.4)[1]
    found, _ = simulated(drive, len(truth), machine.voltage * np.sqrt(2.0 / 3.0))
    assert np.abs(found - truth).max() < 1e-7 * np.abs(truth).max()


def test_a_run_up_ends_where_the_equivalent_circuit_meets_the_friction():
    found, _ = simulated(drive_of(), 20000)
    brakes = 1.0791e-4 * found[-1] + 0.012998
    assert steady_torque(drive_of(), PHASE_PEAK, found[-1]) == pytest.approx(brakes, rel=1e-7)


def test_a_run_up_is_the_same_in_every_frame():
    there, _ = simulated(drive_of(50.0), 4000)
    turns = np.exp(2j * np.pi * 10.0 * STEP * (np.arange(4000) + 0.5)) * np.sinc(10.0 * STEP)
    here, _ = simulated(drive_of(40.0), 4000, PHASE_PEAK * turns)
    assert np.abs(here - there).max() < 1e-5 * np.abs(there).max()


def test_sensitivities_are_those_of_central_differences():
    drive = drive_of()
    _, slopes = simulated(drive, 6000, free=FREE)
    for j, name in enumerate(FREE):
        h = 1e-5 * drive.value(name)
        up, down = (simulated(drive.with_values({name: drive.value(name) + s * h}), 6000, free=FREE)[0]
                    for s in (1.0, -1.0))
        numeric = (up - down) / (2.0 * h)
        assert np.abs(slopes[:, j] - numeric).max() < 1e-5 * np.abs(numeric).max(), name


def test_a_motor_that_stands_without_voltage_stays():
    found, _ = simulated(drive_of(), 100, 0.0)
    assert not found.any()


def test_a_short_circuited_stator_brakes_by_the_flux_that_is_left():
    drive = drive_of(0.0)
    plant = plant_of(drive, Layout((), ("motor_torque", *VOLTAGES), ("motor_speed",), STEP, gradient=False))
    start = np.zeros(plant.nx)
    start[0], start[-4 + FLUXES.index("rotor_flux_d")] = 200.0, 0.4
    braked, _ = simulated(drive, 2000, 0.0, start=start)
    plain, _ = simulated(replace(drive, values={**drive.values, "motor.magnetizing_inductance": 0.0}), 2000, 0.0,
                         start=start[:1])
    assert braked[-1] < plain[-1] - 1.0
