"""Light rigs with a shaft-torque sensor: records of constant speeds and of torque steps, by seed.

The family is about Table 6.2 of Tallfors 2005: a motor of 4.8 kg m^2, a load of 0.05 to 0.3 of it, a shaft that
resonates at 6 to 20 Hz, friction of each side by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.simulator import experiments
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine, State, running
from tests.simulator.records import Channels, white_noise, write_mcap, write_parquet

STEP = 1e-3
SPEEDS = (105.0, 136.0, 157.0)
TABLE = Machine(inertia=(4.78, 0.646), viscous=(0.107, 0.0307), idle_torque=(24.2, -1.02), stiffness=(3770.0,),
                damping=(0.083,), rated_torque=200.0)
HEAVY = Machine(inertia=(0.710, 4.87), viscous=(0.0258, 0.120), idle_torque=(-0.799, 29.8), stiffness=(4130.0,),
                damping=(2.01,), rated_torque=200.0)


@dataclass(frozen=True)
class Sensors:
    """Standard deviations per sample: torque of the converter [Nm], speed [rad/s], shaft torque [Nm]."""

    converter: float = 0.3
    speed: float = 0.02
    shaft: float = 0.2


def rig_of(seed: int) -> Machine:
    """A light rig: load 0.05 to 0.3 of the motor, 5 to 30 Nm of idle torque."""
    rng = np.random.default_rng(seed)
    motor, idle = rng.uniform(2.0, 6.0), rng.uniform(5.0, 30.0)
    load = motor * rng.uniform(0.05, 0.3)
    reduced, rate = motor * load / (motor + load), 2.0 * np.pi * rng.uniform(6.0, 20.0)
    return Machine(
        inertia=(motor, load), viscous=(rng.uniform(0.03, 0.2), rng.uniform(0.01, 0.05)),
        idle_torque=(idle, rng.uniform(0.5, 2.0)), stiffness=(reduced * rate**2,),
        damping=(2.0 * rng.uniform(0.001, 0.02) * reduced * rate,), rated_torque=200.0)


def channels(machine: Machine, torque: np.ndarray, speed: float, seed: int, sensors: Sensors,
             reference: np.ndarray | None = None) -> Channels:
    """Torque command, motor speed, load speed and shaft torque of a record that begins at a constant speed."""
    start, rng = running(machine, speed), np.random.SeedSequence(seed).generate_state(4)
    control = None if reference is None else PI(reference, 60.0, 100.0, start.torque, 400.0, 1e-3)
    n = len(torque) if reference is None else len(reference)
    run = simulate_fast(machine, torque if reference is None else np.zeros(n), STEP, start, control,
                        white_noise(n, sensors.converter, rng[0]),
                        sensor_noise=white_noise(n, sensors.speed, rng[1]))
    shaft = run.shaft_torques[:, 0] + white_noise(n, sensors.shaft, rng[2])
    load = run.speeds[:, 1] + white_noise(n, sensors.speed, rng[3])
    return {"motor_torque": (run.command, "Nm"), "motor_speed": (run.measured, "rad/s"),
            "load_speed": (load, "rad/s"), "shaft_torque": (shaft, "Nm")}


def from_the_load(machine: Machine, torque: np.ndarray, speed: float, seed: int,
                  sensors: Sensors = Sensors()) -> Channels:
    """The same channels with the machine at the load as the motor: its torque drives, the other one is its load.

    machine  without a gap
    torque   (n,) steps about what keeps the speed [Nm]
    """
    rng, n = np.random.SeedSequence(seed).generate_state(4), len(torque)
    through = -(machine.viscous[0] * speed + machine.idle_torque[0])  # the shaft drives the first body
    start = State((speed, speed), (through / machine.stiffness[0],))
    command = np.round(torque + machine.viscous[1] * speed + machine.idle_torque[1] - through, 3)
    run = simulate_fast(machine, np.zeros(n), STEP, start,
                        load_torque=-(command + white_noise(n, sensors.converter, rng[0])),
                        sensor_noise=white_noise(n, sensors.speed, rng[1]))
    return {"motor_torque": (command, "Nm"),
            "motor_speed": (run.speeds[:, 1] + white_noise(n, sensors.speed, rng[3]), "rad/s"),
            "load_speed": (run.measured, "rad/s"),
            "shaft_torque": (white_noise(n, sensors.shaft, rng[2]) - run.shaft_torques[:, 0], "Nm")}


def steady_record(machine: Machine, seed: int, speeds: tuple[float, ...] = SPEEDS,
                  sensors: Sensors = Sensors()) -> Channels:
    """Speed control at several constant speeds, 6 s each."""
    reference = experiments.staircase(speeds, 6.0, 1.5, STEP)
    return channels(machine, np.zeros(0), speeds[0], seed, sensors, reference)


def steps_record(machine: Machine, seed: int, speed: float = 110.0, duration: float = 8.0,
                 sensors: Sensors = Sensors()) -> Channels:
    """Torque steps up and down about what keeps the speed, open loop; the shaft torque keeps its sign or not."""
    torque = running(machine, speed).torque + torque_steps(seed, duration)
    return channels(machine, np.round(torque, 3), speed, seed, sensors)


def torque_steps(seed: int, duration: float) -> np.ndarray:
    """Steps [Nm] up and down in turn, of 20 to 60 Nm."""
    rng, n = np.random.default_rng(seed), round(duration / STEP)
    torque, i, sign = np.zeros(n), 300, 1.0
    while i < n:
        hold = round(rng.uniform(0.2, 0.5) / STEP)
        torque[i:i + hold] += sign * rng.uniform(20.0, 60.0)
        sign, i = -sign, i + hold
    return torque


def write(folder: Path, name: str, record: Channels, roles: tuple[str, ...]) -> Path:
    """The record with these roles as Parquet and MCAP; returns the Parquet."""
    kept = {role: record[role] for role in roles}
    write_mcap(folder / f"{name}.mcap", kept, STEP)
    write_parquet(folder / f"{name}.parquet", kept, STEP)
    return folder / f"{name}.parquet"


def idle_at_motor(machine: Machine, torque: float) -> Machine:
    """The machine with another idle torque at the motor."""
    return replace(machine, idle_torque=(torque, machine.idle_torque[1]))
