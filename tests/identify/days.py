"""One machine on several days: its values vary from recording to recording by a known standard deviation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.drive import Drive, one_body
from drivetool.logs import Experiment
from tests.recover import experiment
from tests.simulator.experiments import alternating
from tests.simulator.fast import simulate_fast
from tests.simulator.machine import Machine
from tests.simulator.records import white_noise

STEP, SECONDS = 2e-3, 8.0
NAMES = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque")


def machine_of(seed: int) -> np.ndarray:
    """(4,) inertia, viscous and Coulomb friction, idle torque of a servo: a tenth to ten times the usual."""
    rng = np.random.default_rng([seed, 7])
    size = 10.0 ** rng.uniform(-1.0, 1.0)
    return size * np.array([2e-4, 2e-4, 0.012, 0.004]) * 10.0 ** rng.uniform(-0.15, 0.15, 4)


def start_of(values: np.ndarray) -> Drive:
    """A drive whose inertia is a third too large."""
    return one_body().with_values({"motor.inertia": 1.3 * values[0]})


def days_of(values: np.ndarray, count: int, scatter: float, seed: int, name: str = "day") -> list[Experiment]:
    """Recordings of one machine.

    values   (4,) its mean; scatter: standard deviation of each recording's own over that
    """
    rng = np.random.default_rng([seed, 8])
    return [day_of(values * (1.0 + scatter * rng.standard_normal(4)), 100 * seed + i, f"{name}{i}")
            for i in range(count)]


def day_of(values: np.ndarray, seed: int, name: str) -> Experiment:
    """A recording of torque steps that turn the motor both ways."""
    n, unit = round(SECONDS / STEP), values[2] / 0.012
    torque = unit * alternating(0.0, (0.02, 0.045), (0.3, 0.6), 20, 0.3, STEP, seed)[:n]
    torque = np.resize(torque, n) + values[3]
    run = simulate_fast(Machine(*((v,) for v in values)), torque, STEP,
                        torque_noise=white_noise(n, 2e-4 * unit, 3 * seed + 1),
                        sensor_noise=white_noise(n, 0.05, 3 * seed + 2))
    return replace(experiment(run.command, run.measured, name, STEP), sha256=f"{name}-{seed}".ljust(64, "0"))
