"""The robot axis and the bus of the literature, as machines and as records.

Robot: three masses, Ostring et al. 2003, set 1; position controlled, which is a PI controller of the speed.
Bus: two masses with a gear ratio; what the wheels carry is an inertia of mass times radius squared.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import max_len_seq

from tests.simulator.experiments import chirp
from tests.simulator.fast import PI, simulate_fast
from tests.simulator.machine import Machine, State, at_rest, running
from tests.simulator.records import Channels, quantise, white_noise
from tests.simulator.simulate import simulate_linear

ROBOT_STEP, BUS_STEP = 5e-4, 5e-3
ROBOT = Machine((3.9e-4, 12.2, 6.3), (2.6e-2, 232.0, 11.0), stiffness=(1.9e5, 1.5e5), damping=(168.0, 12.0),
                ratio=(118.0, 1.0))
ROBOT_GAP = replace(ROBOT, coulomb=(0.12, 0.0, 0.0), half_gap=(6e-5, 0.0))
ROBOT_NOISE = 0.01, 0.05  # torque [Nm], speed [rad/s], std per sample
MASS, RADIUS, WHEELS = 12350.0, 0.45, 22.1
ROLLING = 2420.0 * RADIUS
BUS = Machine((4.5, WHEELS + MASS * RADIUS**2), (0.02, 40.0), (), (0.0, ROLLING), (1520e3,), (3600.0,),
    ratio=(8.79,))
BUS_NOISE = 3.0, 0.03
BUS_OFFSET, BUS_AMPLITUDE = 160.0, 76.7


def robot_reference(kind: str, size: float, n: int = 24_000, seed: int = 1) -> np.ndarray:
    """(n,) speed reference [rad/s] of about `size` rms: chirp from 50 to 0.5 Hz, or ten sines from 5 to 50 Hz."""
    t = np.arange(n) * ROBOT_STEP
    if kind == "chirp":
        rate = (0.5 - 50.0) / t[-1]
        return np.sqrt(2.0) * size * np.cos(2.0 * np.pi * (50.0 + 0.5 * rate * t) * t)
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 10)
    return np.sqrt(0.2) * size * np.cos(2.0 * np.pi * np.outer(t, np.linspace(5.0, 50.0, 10)) + phase).sum(axis=1)


def robot_record(machine: Machine, kind: str, size: float, seed: int) -> Channels:
    """Torque command, noisy speed and the reference, under a controller that is unknown to the tool."""
    reference = robot_reference(kind, size)
    torque, speed = (white_noise(len(reference), std, 2 * seed + i) for i, std in enumerate(ROBOT_NOISE))
    run = simulate_fast(machine, np.zeros_like(reference), ROBOT_STEP, at_rest(machine),
                        PI(reference, 0.07, 0.7, limit=20.0, resolution=1e-3), torque, sensor_noise=speed,
                        resolution=1e-3)
    return {"motor_torque": (run.command, "Nm"), "motor_speed": (run.measured, "rad/s"),
            "reference_speed": (quantise(reference, 1e-3), "rad/s")}


def bus_torque(kind: str, seed: int) -> np.ndarray:
    """(n,) torque [Nm] about an offset that keeps the gap closed."""
    if kind == "prbs":  # ten-cell shift register, 1023 long, 10 ms clock
        bits, _ = max_len_seq(10, state=np.random.default_rng(seed).integers(0, 2, 10) | np.eye(10, dtype=int)[0])
        wave = np.tile(np.repeat(2.0 * bits - 1.0, 2), 3)
    elif kind == "chirp":
        wave = chirp(0.1, 30.0, 1.0, 150.0 if seed % 2 else 295.0, BUS_STEP)
    else:  # stepped sine
        hz = np.geomspace(0.5, 25.0, 24) * (1.0 if seed % 2 else 1.03)
        wave = np.concatenate([np.sin(2.0 * np.pi * f * np.arange(round(3.0 / BUS_STEP)) * BUS_STEP) for f in hz])
    return quantise(BUS_OFFSET + BUS_AMPLITUDE * wave, 0.1)


def bus_record(torque: np.ndarray, start: State, seed: int, machine: Machine = BUS) -> Channels:
    """Torque command and noisy motor speed."""
    noise, sensor = (white_noise(len(torque), std, 2 * seed + i) for i, std in enumerate(BUS_NOISE))
    run = simulate_linear(machine, torque, BUS_STEP, start, noise)
    return {"motor_torque": (torque, "Nm"), "motor_speed": (quantise(run.speeds[:, 0] + sensor, 1e-2), "rad/s")}


def bus_run(kind: str, seed: int) -> Channels:
    """One experiment on the road, from steady running at the offset's speed."""
    start = running(BUS, 20.0)
    through = BUS_OFFSET - start.torque  # what accelerates; the shaft is wound up for its share
    share = BUS.inertia[1] / (BUS.inertia[1] + BUS.inertia[0] * BUS.ratio[0] ** 2)
    twist = start.twists[0] + through * BUS.ratio[0] * share / BUS.stiffness[0]
    return bus_record(bus_torque(kind, seed), replace(start, twists=(twist,), torque=BUS_OFFSET), seed)


def bus_held(seed: int) -> Channels:
    """Standstill with the wheels held: the motor swings on the drive shaft."""
    held = replace(BUS, inertia=(BUS.inertia[0], 1e12), idle_torque=(), viscous=(BUS.viscous[0], 0.0))
    twist = BUS_OFFSET * BUS.ratio[0] / BUS.stiffness[0]
    return bus_record(bus_torque("prbs", seed), State((0.0, 0.0), (twist,), 0.0, BUS_OFFSET), seed, held)


def bus_acceleration(seed: int, slope: float = 0.0) -> Channels:
    """Constant torque up, coast down, on a road that rises by `slope`, a share."""
    n = round(12.0 / BUS_STEP)
    torque = np.concatenate([np.full(n, 450.0), np.zeros(n)])
    machine = replace(BUS, idle_torque=(0.0, ROLLING + MASS * 9.80665 * slope * RADIUS)) if slope else BUS
    return bus_record(torque, running(machine, 20.0), seed, machine)
