"""Deviations in units of the noise: one-step errors of a Kalman filter on the plain linear machine.

A deviation of the outputs goes in as if it were measured; what comes out has unit variance wherever
the input is noise. Its norm squared is twice the log likelihood ratio that the deviation is worth.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.linalg import expm

from tests.hidden.case import Noise
from tests.hidden.profiles import STEP
from tests.simulator.linear import equations
from tests.simulator.machine import Machine


def outputs(machine: Machine, roles) -> np.ndarray:
    """(roles, states) rows that give the sensors' values from the state of `equations`."""
    n = machine.bodies
    _, _, torques = equations(machine)
    angle = np.zeros(2 * n)
    angle[2 * n - 1] = 1.0
    rows = {"motor_speed": np.eye(2 * n)[0], "motor_angle": angle}
    if n > 1:
        load = angle.copy()
        for k, ratio in enumerate(machine.ratio):
            load /= ratio
            load[n + k] -= 1.0
        rows |= {"shaft_torque": torques[0, :2 * n], "load_speed": np.eye(2 * n)[n - 1], "load_angle": load}
    return np.array([rows[role] for role in roles])


def discrete(machine: Machine) -> tuple[np.ndarray, np.ndarray]:
    """(F, G) of x[k+1] = F x[k] + G [command, noise, load, 1]; exact for held inputs."""
    a, b, _ = equations(machine)
    block = np.zeros((len(a) + 4,) * 2)
    block[:len(a), :len(a)], block[:len(a), len(a):] = a, b
    exponential = expm(block * STEP)[:len(a)]
    return exponential[:, :len(a)], exponential[:, len(a):]


class Whitener:
    """Filter for deviations of one machine; start states are taken as known."""

    def __init__(self, machine: Machine, roles, noise: Noise, floor: dict[str, float]):
        f, g = discrete(machine)
        h = outputs(machine, roles)
        std = noise.torque
        if noise.coloured > 0.0:
            pole = np.exp(-1.0 / noise.memory)
            f = np.block([[f, g[:, 1:2]], [np.zeros((1, len(f))), np.array([[pole]])]])
            h = np.hstack([h, np.zeros((len(h), 1))])
            noise_input = np.zeros((len(f), 2))
            noise_input[:-1, 0] = noise.torque * g[:, 1]
            noise_input[-1, 1] = noise.coloured * np.sqrt(1.0 - pole**2)
        else:
            noise_input = std * g[:, 1:2]
        sensor = np.array([max(noise.sensors[role], floor[role]) for role in roles])
        self.model = tuple(np.ascontiguousarray(a) for a in (f, h, noise_input @ noise_input.T, np.diag(sensor**2)))

    def __call__(self, deviation: np.ndarray) -> np.ndarray:
        """(n, roles, columns) -> the same, whitened."""
        return _filter(*self.model, np.ascontiguousarray(deviation))


@njit(cache=True)
def _filter(f, h, q, r, deviation):
    samples, size, columns = deviation.shape
    x = np.zeros((f.shape[0], columns))
    p = np.zeros_like(f)
    white = np.empty_like(deviation)
    gain, root_inverse = np.zeros((f.shape[0], size)), np.eye(size)
    h_transposed, f_transposed = np.ascontiguousarray(h.T), np.ascontiguousarray(f.T)
    steady = False
    for i in range(samples):
        if not steady:
            s = h @ p @ h_transposed + r
            root_inverse = np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(s)))
            gain = p @ h_transposed @ np.ascontiguousarray(np.linalg.inv(s))
            p_next = f @ (p - gain @ h @ p) @ f_transposed + q
            # Angles make a few entries drift for ever by rounding; a fixed horizon is enough.
            steady = np.max(np.abs(p_next - p)) <= 1e-12 * np.max(np.abs(p)) and i > 10
            p = p_next
        error = deviation[i] - h @ x
        white[i] = root_inverse @ error
        x = f @ (x + gain @ error)
    return white
