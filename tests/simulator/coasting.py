"""Coast-downs of a motor without torque: its equation of motion by a general solver, and the sensors' signals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import butter, sosfiltfilt

STEP, PULSES = 5e-5, 1000
RPM = np.pi / 30.0
LOW_PASS = 80.0  # [Hz] of the coast-down reference's example


@dataclass(frozen=True)
class Motor:
    """The motor of the coast-down reference, Table 5; surplus: breakaway less Coulomb torque."""

    inertia: float = 8.7499e-5
    viscous: float = 1.0791e-4
    coulomb: float = 0.012998
    drag: float = 0.0
    surplus: float = 0.0
    breakaway_speed: float = 0.02

    def friction(self, w: float) -> float:
        """Torque (18) at a speed, and the drag of the air."""
        low, bell = self.breakaway_speed / 10.0, np.sqrt(2.0) * self.breakaway_speed
        raised = np.sqrt(2.0 * np.e) * self.surplus * np.exp(-((w / bell) ** 2)) * w / bell
        return raised + self.coulomb * np.tanh(w / low) + self.viscous * w + self.drag * w * abs(w)


def motion(motor: Motor, torque: Callable[[float], float], speed: float, end: float, duration: float,
           step: float = STEP) -> tuple[np.ndarray, np.ndarray]:
    """(angle (n,), speed (n,)) from a speed on, until `end` or the duration is over."""
    def rate(t: float, x: np.ndarray) -> list[float]:
        return [x[1], (torque(t) - motor.friction(x[1])) / motor.inertia]

    def there(t: float, x: np.ndarray) -> float:
        return x[1] - end

    there.terminal, there.direction = True, -1.0
    found = solve_ivp(rate, (0.0, duration), [0.0, speed], "LSODA", dense_output=True,
                      events=there if end else None, rtol=1e-11, atol=1e-11, max_step=0.01)
    return tuple(found.sol(np.arange(0.0, found.t[-1], step)))


def driven(motor: Motor, torque: float, speed: float, end: float, half: float = 0.5, step: float = STEP,
           ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(torque, angle, speed) (n,): under a constant torque from a speed on for `half` s, then off to `end`."""
    up = motion(motor, lambda t: torque, speed, 0.0, half, step)
    down = motion(motor, lambda t: 0.0, float(up[1][-1]), end, 5.0, step)
    angle = np.concatenate([up[0][:-1], up[0][-1] + down[0]])
    logged = torque * (np.arange(len(angle)) < len(up[0]) - 1)
    return logged, angle, np.concatenate([up[1][:-1], down[1]])


def numbers(angle: np.ndarray, seed: int, pulses: int = PULSES) -> np.ndarray:
    """The angle as a counter has it, whole numbers, from anywhere between two pulses."""
    width = 2.0 * np.pi / pulses
    return np.floor((angle + np.random.default_rng(seed).uniform(0.0, width)) / width)


def counts(angle: np.ndarray, seed: int, pulses: int = PULSES) -> np.ndarray:
    """The same in rad."""
    return numbers(angle, seed, pulses) * (2.0 * np.pi / pulses)


def filtered(angle: np.ndarray, step: float = STEP, cut: float = LOW_PASS) -> np.ndarray:
    """Speed (n,) of an angle by differences and a fourth-order Butterworth filter, forward and backward."""
    return sosfiltfilt(butter(4, cut, fs=1.0 / step, output="sos"), np.gradient(angle, step))
