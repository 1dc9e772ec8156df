"""Run-ups and coast-downs of an induction motor as experiments, for estimators that are called without files."""

from __future__ import annotations

import numpy as np

from drivetool.logs import Experiment
from tests.coasting import STEP, counts, recording
from tests.simulator.induction import Machine, run_up, up_and_down

__all__ = ["ELECTRICAL", "Machine", "run_up", "switched"]

ELECTRICAL = {"motor.stator_resistance": 60.5, "motor.rotor_resistance": 42.2, "motor.leakage_inductance": 0.66,
              "motor.magnetizing_inductance": 1.73}


def switched(seed: int, machine: Machine | None = None, phases: bool = False) -> Experiment:
    """A run-up and a coast-down by counts, with what the converter says of its supply, or two phases of it."""
    machine = machine or Machine()
    angle, _, on = up_and_down(machine)
    signals = {"motor_angle": counts(angle, seed)}
    if phases:
        time = STEP * (np.arange(len(angle)) - np.argmax(on))
        vector = np.where(on, machine.phase(time), 0.0)
        signals |= {"motor_voltage_a": vector.real, "motor_voltage_b": (vector * np.exp(-2j * np.pi / 3.0)).real}
    else:
        signals |= {"supply_voltage": machine.voltage * on, "supply_frequency": machine.frequency * on}
    return recording(seed, f"switched-{seed}.parquet", **signals)
