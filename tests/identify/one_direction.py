"""Records of a pump, fan or conveyor: it starts, runs, coasts and stands, in one direction of motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivetool.logs import Experiment
from tests.recover import STEP, experiment
from tests.simulator.controllers import SpeedPI
from tests.simulator.machine import Machine, at_rest
from tests.simulator.records import white_noise
from tests.simulator.simulate import Sensor, simulate

DURATION, SWITCHED_OFF = 12.0, 7.6  # s
TIMES = [0.0, 0.5, 1.3, 3.0, 3.5, 5.0, 5.5, SWITCHED_OFF]
SPEEDS = [0.0, 0.0, 0.6, 0.6, 1.0, 1.0, 0.4, 0.4]  # over the top speed, at these times
TORQUE_TIMES = [0.0, 0.5, 0.51, 2.5, 2.6, 4.0, 4.1, 6.0, 6.1, SWITCHED_OFF, SWITCHED_OFF + 0.01]
TORQUES = [0.0, 0.0, 0.5, 0.5, 1.0, 1.0, 0.6, 0.6, 0.9, 0.9, 0.0]  # over that of the top speed


@dataclass(frozen=True)
class OneDirection:
    """A record and its truth; total: Coulomb friction and idle torque together, positive."""

    machine: Machine
    record: Experiment

    @property
    def total(self) -> float:
        return self.machine.coulomb[0] + abs(self.machine.idle_torque[0])


def one_direction(seed: int) -> OneDirection:
    """A machine drawn by its number: half with an idle torque, a third turning backward, half in closed loop."""
    rng = np.random.default_rng(1000 + seed)
    inertia = 10.0 ** rng.uniform(-3.0, 0.5)
    viscous, top = inertia / rng.uniform(0.5, 3.0), rng.uniform(20.0, 120.0)
    dry = viscous * top * rng.uniform(0.1, 1.0)
    idle = dry * rng.uniform(0.0, 0.45) if seed % 2 else 0.0
    side = -1.0 if seed % 3 == 0 else 1.0
    machine = Machine((inertia,), (viscous,), (dry - idle,), (side * idle,))
    largest, n = viscous * top + dry, round(DURATION / STEP)
    rated = largest + inertia * top / 0.5
    noise = white_noise(n, 10.0 ** rng.uniform(-3.5, -2.0) * top, 7 * seed + 1)
    disturbance = white_noise(n, rated * rng.choice([0.0, 0.003, 0.02]), 7 * seed + 3)
    time, driven = STEP * np.arange(n), round(SWITCHED_OFF / STEP)
    command = side * largest * np.interp(time, TORQUE_TIMES, TORQUES)
    if seed % 4 < 2:
        gain = inertia / rng.uniform(0.03, 0.15)
        speed = side * top * np.interp(time, TIMES, SPEEDS)[:driven]
        controller = SpeedPI(speed, gain, gain / rng.uniform(0.1, 0.4), STEP, limit=rated)
        command = np.zeros(n)
        command[:driven] = simulate(machine, np.zeros(driven), STEP, at_rest(machine), controller,
                                    disturbance[:driven], sensor=Sensor("speed", noise[:driven])).command
    # Switched off, a converter gives no torque, and so no noise of one.
    run = simulate(machine, command, STEP, at_rest(machine), None, np.where(command == 0.0, 0.0, disturbance),
                   sensor=Sensor("speed", noise))
    return OneDirection(machine, experiment(run.command, run.measured, f"one-direction-{seed}"))
