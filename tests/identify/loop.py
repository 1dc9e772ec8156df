"""Axes in closed position control, whose loop feeds encoder noise and steps back into the logged torque."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from drivetool.drive import Drive, one_body
from drivetool.logs import Experiment
from tests.study.missing_laws import kernel
from tests.study.missing_laws.record import memory_noise

SECONDS = 20.0
MEMORY = 0.02  # s, of half the disturbance; the other half is white


@dataclass(frozen=True)
class Axis:
    """A machine, its encoder and its moves.

    values          inertia, viscous, coulomb, idle torque
    step [s]; bandwidth [rad/s] of the speed loop
    quantum, noise  of the encoder [rad]
    reach [rad], speed [rad/s], acceleration [rad/s^2] of its moves
    """

    values: tuple[float, float, float, float]
    step: float
    bandwidth: float
    quantum: float
    noise: float
    reach: float
    speed: float
    acceleration: float

    @property
    def truth(self) -> dict[str, float]:
        """The values under the tool's names."""
        names = ("inertia", "viscous", "coulomb", "idle_torque")
        return {f"motor.{n}": v for n, v in zip(names, self.values, strict=True)}

    @property
    def start(self) -> Drive:
        """A drive whose inertia is a third too large."""
        return one_body().with_values({"motor.inertia": 1.3 * self.values[0]})

    @property
    def rated(self) -> float:
        """Torque of the fastest move."""
        inertia, viscous, coulomb, _ = self.values
        return inertia * self.acceleration + viscous * self.speed + coulomb


MACHINES = (
    Axis((0.02, 0.015, 0.12, 0.02), 1e-3, 60.0, 2.0 * np.pi / 100000, 2e-5, 2.0, 6.0, 20.0),
    Axis((1.2e-4, 7e-5, 0.008, 0.0), 5e-4, 120.0, 2.0 * np.pi / 65536, 2e-5, 10.0, 60.0, 500.0),
    Axis((95.0, 203.0, 20.0, -3.0), 1e-3, 120.0, 1e-6, 2e-6, 0.1, 0.3, 3.0),
    Axis((2.0, 6.0, 5.0, 1.0), 2e-3, 50.0, 2.0 * np.pi / 262144, 1e-5, 1.0, 1.5, 4.0),
    Axis((0.3, 0.05, 0.6, 0.1), 1e-3, 50.0, 2.0 * np.pi / 200000, 1e-5, 3.0, 5.0, 15.0),
    Axis((0.005, 0.002, 0.03, 0.0), 1e-3, 100.0, 2.0 * np.pi / 65536, 3e-5, 6.0, 20.0, 100.0))


def loop_record(axis: Axis, seed: int, disturbance: float = 0.0, log_noise: float = 0.0,
                seconds: float = SECONDS, law: int = kernel.PLAIN, strength: tuple[float, ...] = ()) -> Experiment:
    """A record of random moves from point to point.

    disturbance, log_noise  root mean square over rated torque: behind the logged torque, and of the log alone
    law, strength           a further torque on the motor, with its parameters, see `kernel`
    """
    rng, n = np.random.default_rng([seed, 40503]), int(seconds / axis.step)
    speeds = _moves(axis, n, rng)
    angles = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * axis.step)])
    gain = axis.values[0] * axis.bandwidth
    share = min(4.0 * axis.bandwidth * axis.step, 1.0)
    controller = np.array([gain, 0.0, axis.bandwidth / 3.0, share, np.inf, np.inf])
    torque_noise = np.sqrt(0.5) * (rng.standard_normal(n) + memory_noise(rng, n, axis.step, MEMORY))
    torque, angle, _ = kernel.run(
        axis.step, 4, np.zeros(kernel.STATES), kernel.POSITION, np.zeros(n), speeds, angles, controller,
        law, np.array(axis.values), np.resize([*strength, *np.zeros(8)], 8),
        disturbance * axis.rated * torque_noise,
        axis.noise * rng.standard_normal(n), axis.quantum, True)
    made = Experiment("loop", "0" * 64, axis.step, 0.0, {
        "motor_torque": torque + log_noise * axis.rated * rng.standard_normal(n), "motor_angle": angle,
        "reference_angle": angles, "reference_speed": speeds}, ((0, n),))
    return replace(made, torque_is="measurement" if log_noise else "command")


def open_record(axis: Axis, seed: int) -> Experiment:
    """A record of torque steps in open loop."""
    rng, n = np.random.default_rng([seed, 40504]), int(SECONDS / axis.step)
    command = axis.rated * np.repeat(rng.uniform(-1.0, 1.0, n // 100 + 1), 100)[:n]
    controller = np.array([1.0, 0.0, 0.0, 1.0, np.inf, np.inf])
    torque, angle, _ = kernel.run(
        axis.step, 4, np.zeros(kernel.STATES), kernel.OPEN, command, np.zeros(n), np.zeros(n), controller,
        kernel.PLAIN, np.array(axis.values), np.zeros(8), np.zeros(n), axis.noise * rng.standard_normal(n),
        axis.quantum, True)
    return Experiment("open", "0" * 64, axis.step, 0.0, {"motor_torque": torque, "motor_angle": angle}, ((0, n),),
                      torque_is="command")


def _moves(axis: Axis, n: int, rng: np.random.Generator) -> np.ndarray:
    """(n,) speeds of moves between random places, rounded at their corners."""
    found, place = [], 0.0
    while sum(map(len, found)) < n:
        target = rng.uniform(-axis.reach, axis.reach)
        way, speed = abs(target - place), axis.speed * rng.uniform(0.2, 1.0)
        steep = axis.acceleration * rng.uniform(0.4, 1.0)
        rise = min(speed / steep, np.sqrt(way / steep))
        whole = way / (steep * rise) + rise
        t = np.arange(0.0, whole + 0.02, axis.step)
        speeds = np.clip(np.minimum(steep * t, steep * (whole - t)), 0.0, steep * rise)
        found.append(np.sign(target - place) * speeds)
        place += found[-1].sum() * axis.step
    window = np.hanning(2 * int(0.01 / axis.step) + 3)
    return np.convolve(np.concatenate(found)[:n], window / window.sum(), "same")
