"""Recordings of the motor of the coast-down reference, as simulated: coast-downs, and a run-up under supply."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.simulator.coasting import PULSES, RPM, STEP, Motor, counts, driven, filtered, motion, numbers
from tests.simulator.induction import Machine, up_and_down
from tests.simulator.records import Channels, quantise, write_mcap, write_parquet

# Counts are those of a 16-bit counter, at a rate that keeps the files small.
MOTOR, DISC = Motor(), 5e-5
COUNTER_STEP, COUNTER_RANGE = 2e-4, 65536
CUT, EVERY = 600, 20  # samples: 30 ms, in which the filter does not yet know both sides; one in a millisecond
HERTZ, NO_LOAD = (40, 45, 50, 55), 2240.0 / 40.0 * RPM  # of a supply, and the speed that it gives for one
THINNED = round(COUNTER_STEP / STEP)


def of_counts(seed: int, added: float) -> tuple[Channels, float]:
    """Coast-down from 2240 to 80 rpm without torque; added: inertia of a disc on the shaft."""
    motor = replace(MOTOR, inertia=MOTOR.inertia + added)
    angle, _ = motion(motor, lambda t: 0.0, 2240 * RPM, 80 * RPM, 5.0, COUNTER_STEP)
    return {"motor_angle": (np.mod(numbers(angle, seed) + 60_000, COUNTER_RANGE), "counts")}, COUNTER_STEP


def of_speed(seed: int) -> tuple[Channels, float]:
    """Half a second under torque, then off; the speed as the reference filters it."""
    torque, angle, _ = driven(MOTOR, 0.06, 100.0, 80 * RPM)
    speed, kept = filtered(counts(angle, seed)), slice(CUT, -CUT, EVERY)
    return {"motor_torque": (torque[kept], "Nm"), "motor_speed": (quantise(speed[kept], 1e-4), "rad/s")}, \
        EVERY * STEP


def of_supply(seed: int) -> tuple[Channels, float]:
    """Switched on at rest, off at speed, and coasting down; voltage and frequency as the converter says them."""
    machine = Machine(motor=MOTOR)
    angle, _, on = (values[::THINNED] for values in up_and_down(machine))
    return {"motor_angle": (numbers(angle, seed), "counts"), "supply_voltage": (machine.voltage * on, "V"),
            "supply_frequency": (machine.frequency * on, "Hz")}, COUNTER_STEP


def of_hertz(hertz: int) -> Channels:
    """Counts of a coast-down to 80 rpm from the no-load speed at a frequency of the supply."""
    angle, _ = motion(MOTOR, lambda t: 0.0, NO_LOAD * hertz, 80.0 * RPM, 5.0)
    return {"motor_angle": (np.round(counts(angle, 700 + hertz) / (2.0 * np.pi / PULSES)), "counts")}


RECORDS: dict[str, Callable[[], tuple[Channels, float]]] = {
    "plain": lambda: of_counts(701, 0.0),
    "disc": lambda: of_counts(702, DISC),
    "speed": lambda: of_speed(703),
    "supply": lambda: of_supply(704),
}
TRUTH = f"""\
# True values of the simulated motor; counts begin anywhere between two pulses. In disc.* its shaft carries a disc.
schema: drivetool/parameters/1
drive: {{name: one-body, bodies: [motor], shafts: []}}
parameters:
  motor.inertia: {{value: {MOTOR.inertia!r}, unit: kg m^2}}
  motor.viscous: {{value: {MOTOR.viscous!r}, unit: Nm s/rad}}
  motor.coulomb: {{value: {MOTOR.coulomb!r}, unit: Nm}}
# added by the disc: {DISC!r} kg m^2
"""
ELECTRICAL = f"""\
# What the plate and the data sheet of the motor say; supply.* is of a motor with just these values.
schema: drivetool/parameters/1
drive: {{name: one-body, bodies: [motor], shafts: []}}
parameters:
  motor.stator_resistance: {{value: {Machine().stator!r}, unit: ohm}}
  motor.rotor_resistance: {{value: {Machine().rotor!r}, unit: ohm}}
  motor.leakage_inductance: {{value: {Machine().leakage!r}, unit: H}}
  motor.magnetizing_inductance: {{value: {Machine().magnetizing!r}, unit: H}}
  motor.pole_pairs: {{value: {Machine().pairs}, unit: ''}}
"""
ANGLE = "schema: drivetool/channel-map/1\nroles:\n  motor_angle: {channel: motor_angle, unit: counts, per_rev: 1000"


def make(folder: Path) -> None:
    """Write the recordings, what is true of them, and the channel maps of the counters."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "truth.yaml").write_text(TRUTH)
    (folder / "electrical.yaml").write_text(ELECTRICAL)
    (folder / "counts.yaml").write_text(f"{ANGLE}}}\n")
    (folder / "map.yaml").write_text(f"{ANGLE}, wrap: {COUNTER_RANGE}}}\n")
    (folder / "supply_map.yaml").write_text(
        f"{ANGLE}}}\n  supply_voltage: supply_voltage\n  supply_frequency: supply_frequency\n")
    for name, record in RECORDS.items():
        values, step = record()
        write_parquet(folder / f"{name}.parquet", values, step)
        write_mcap(folder / f"{name}.mcap", values, step)
        print(f"{folder.name}/{name}: {len(next(iter(values.values()))[0]) * step:g} s", file=sys.stderr)
    for hertz in HERTZ:
        write_parquet(folder / f"run{hertz}.parquet", of_hertz(hertz), STEP)
        print(f"{folder.name}/run{hertz}", file=sys.stderr)
