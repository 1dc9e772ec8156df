"""Records of one joint of a planar arm whose other joint moves as well: no one body explains them.

Two uniform links in a horizontal plane, each joint under a loop of its own (Siciliano et al. 2009, 7.3.2). The
logged joint receives little torque and the other much, so that most of its torque answers the other's motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from tests.study.missing_laws.excitation import CLOSED

STEP = 2e-3  # s
PARTS = 4  # steps of the integrator in a sample
FRICTION_WIDTH = 1e-2  # rad/s over which dry friction changes its sign
EXCITATIONS = ("sines", "point-to-point", "random-speeds", "speed-steps")


@dataclass(frozen=True)
class JointRecord:
    """(n,) torque [N m] and (n,) measured of one joint, every STEP; role: motor_angle or motor_speed.

    inertia  [kg m^2] of the joint if the other is held, mean over the record
    coupled  root mean square of the torque that answers the other joint, over that of the logged torque
    """

    torque: np.ndarray
    measured: np.ndarray
    role: str
    excitation: str
    inertia: float
    coupled: float


@njit(cache=True)
def _rates(x, torque, p, out):
    """p: inertias of both links about their joints with what they carry, coupling, dry and viscous friction."""
    shoulder, elbow, coupling = p[0], p[1], p[2]
    c, s = coupling * np.cos(x[1]), coupling * np.sin(x[1])
    first = torque[0] + s * (2.0 * x[2] * x[3] + x[3] * x[3]) - p[3] * np.tanh(x[2] / FRICTION_WIDTH) - p[5] * x[2]
    second = torque[1] - s * x[2] * x[2] - p[4] * np.tanh(x[3] / FRICTION_WIDTH) - p[6] * x[3]
    m11, m12, m22 = shoulder + elbow + 2.0 * c, elbow + c, elbow
    det = m11 * m22 - m12 * m12
    out[0], out[1] = x[2], x[3]
    out[2], out[3] = (m22 * first - m12 * second) / det, (m11 * second - m12 * first) / det


@njit(cache=True)
def _run(wanted, speeds, gains, p):
    """((n, 2) torques, (n, 4) states) of the arm in its loops."""
    n, h = len(wanted), STEP / PARTS
    torques, states = np.empty((n, 2)), np.empty((n, 4))
    x, k1, k2, k3, k4, u = np.zeros(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(2)
    for k in range(n):
        for i in range(2):
            u[i] = gains[i, 0] * (wanted[k, i] - x[i]) + gains[i, 1] * (speeds[k, i] - x[2 + i])
        torques[k], states[k] = u, x
        for _ in range(PARTS):
            _rates(x, u, p, k1)
            _rates(x + 0.5 * h * k1, u, p, k2)
            _rates(x + 0.5 * h * k2, u, p, k3)
            _rates(x + h * k3, u, p, k4)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return torques, states


def draw(number: int, seed: int, seconds: float | None = None) -> JointRecord:
    """A record.

    number   counts excitations and joints through; seed draws all else
    seconds  of the record, instead of a draw
    """
    rng = np.random.default_rng([seed, 97])
    drawn = rng.uniform(8.0, 15.0)
    n = int((drawn if seconds is None else seconds) / STEP)
    mass, length = rng.uniform(2.0, 6.0, 2), rng.uniform(0.3, 0.5, 2)
    shoulder, elbow = mass * length**2 / 3.0
    shoulder += mass[1] * length[0] ** 2
    coupling = 0.5 * mass[1] * length[0] * length[1]
    p = np.array([shoulder, elbow, coupling, *rng.uniform(0.1, 0.6, 2), *rng.uniform(0.05, 0.2, 2)])
    logged, name = number // len(EXCITATIONS) % 2, EXCITATIONS[number % len(EXCITATIONS)]
    most = rng.uniform(2.0, 5.0, 2)
    most[logged] *= rng.uniform(0.0, 0.1)
    speeds = np.column_stack([CLOSED[name](rng, STEP, n, rng.uniform(0.15, 0.4)) for _ in range(2)]) * most
    wanted = np.cumsum(speeds, axis=0) * STEP
    wanted = 1.5 * np.tanh((wanted - wanted[0]) / 1.5)  # a joint stays within its stops
    speeds = np.gradient(wanted, STEP, axis=0)
    masses = np.array([shoulder + elbow, elbow])
    pole = 2.0 * np.pi * rng.uniform(1.5, 3.0, 2)
    pole[logged] = 2.0 * np.pi * rng.uniform(0.3, 1.0)
    gains = np.column_stack([masses * pole**2, 1.4 * masses * pole])
    torques, states = _run(wanted, speeds, gains, p)
    angle, speed = states[:, logged], states[:, 2 + logged]
    folded = 2.0 * coupling * np.cos(states[:, 1])
    own = shoulder + elbow + folded if logged == 0 else np.full(n, elbow)
    torque = torques[:, logged]
    friction = p[3 + logged] * np.tanh(speed / FRICTION_WIDTH) + p[5 + logged] * speed
    alone = own.mean() * np.gradient(speed, STEP) + friction
    coupled, inertia = float(np.std(torque - alone) / np.std(torque)), float(own.mean())
    if rng.uniform() < 0.5:
        return JointRecord(torque, angle + 2e-5 * rng.standard_normal(n), "motor_angle", name, inertia, coupled)
    noisy = speed + 1e-3 * np.std(speed) * rng.standard_normal(n)
    return JointRecord(torque, noisy, "motor_speed", name, inertia, coupled)
