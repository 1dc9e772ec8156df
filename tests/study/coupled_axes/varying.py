"""Records of one body whose inertia depends on its angle, as that of an arm that carries a link which folds.

    J(q) dv/dt + 0.5 J'(q) v^2 + viscous v + coulomb sgn v + idle = torque
    J(q) = mean (1 + share cos(order q + phase))
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from tests.study.missing_laws.excitation import CLOSED

STEP = 2e-3  # s
PARTS = 4  # steps of the integrator in a sample
FRICTION_WIDTH_SHARE = 5e-3  # of the top speed, over which dry friction changes its sign
SHARE = 0.2
EXCITATIONS = ("sines", "point-to-point", "random-speeds", "speed-steps")


@dataclass(frozen=True)
class VaryingRecord:
    """(n,) torque [N m] and (n,) measured, every STEP; role: motor_angle or motor_speed.

    inertia  [kg m^2] mean over a period; around: mean over the angles visited, each counted once
    turns    that were visited, from the least angle to the largest
    """

    torque: np.ndarray
    measured: np.ndarray
    role: str
    excitation: str
    order: int
    inertia: float
    around: float
    turns: float


@njit(cache=True)
def _rate(q, v, torque, p, share):
    """Acceleration; p: mean inertia, viscous, dry, idle, order, phase, speed of the dry friction's change."""
    inside = p[4] * q + p[5]
    inertia, slope = p[0] * (1.0 + share * np.cos(inside)), -p[0] * share * p[4] * np.sin(inside)
    return (torque - 0.5 * slope * v * v - p[1] * v - p[2] * np.tanh(v / p[6]) - p[3]) / inertia


@njit(cache=True)
def _run(wanted, speeds, gains, p, share, disturbance):
    """((n,) torque, (n,) angle, (n,) speed) in a loop of position and speed."""
    n, h = len(wanted), STEP / PARTS
    torque, angle, speed = np.empty(n), np.empty(n), np.empty(n)
    q = v = 0.0
    for k in range(n):
        u = gains[0] * (wanted[k] - q) + gains[1] * (speeds[k] - v)
        torque[k], angle[k], speed[k] = u, q, v
        u += disturbance[k]
        for _ in range(PARTS):
            a1 = _rate(q, v, u, p, share)
            v2 = v + 0.5 * h * a1
            a2 = _rate(q + 0.5 * h * v, v2, u, p, share)
            v3 = v + 0.5 * h * a2
            a3 = _rate(q + 0.5 * h * v2, v3, u, p, share)
            v4 = v + h * a3
            a4 = _rate(q + h * v3, v4, u, p, share)
            q += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
            v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return torque, angle, speed


def draw(number: int, seed: int) -> VaryingRecord:
    """A record; number counts excitations and orders through, seed draws all else."""
    rng = np.random.default_rng([seed, 41])
    n = int(rng.uniform(8.0, 15.0) / STEP)
    name, order = EXCITATIONS[number % len(EXCITATIONS)], 1 + number // len(EXCITATIONS) % 2
    inertia, top, seconds = 10.0 ** rng.uniform(-3.0, 1.0), rng.uniform(3.0, 30.0), rng.uniform(0.15, 0.4)
    speeds = top * CLOSED[name](rng, STEP, n, seconds)
    wanted = np.cumsum(speeds) * STEP
    wanted -= wanted[0]
    torque = inertia * top / seconds  # that accelerates
    p = np.array([inertia, 0.05 * torque / top, torque * rng.uniform(0.02, 0.1), torque * rng.uniform(-0.03, 0.03),
                  order, rng.uniform(0.0, 2.0 * np.pi), FRICTION_WIDTH_SHARE * top])
    pole = 2.0 * np.pi * rng.uniform(1.5, 4.0)
    noise = torque * 10.0 ** rng.uniform(-3.0, -2.0) * rng.standard_normal(n)
    logged, angle, speed = _run(wanted, speeds, inertia * np.array([pole**2, 1.4 * pole]), p, SHARE, noise)
    place = np.linspace(angle.min(), angle.max(), 1000)
    around = inertia * float(np.mean(1.0 + SHARE * np.cos(order * place + p[5])))
    seen = rng.uniform() < 0.5
    role = "motor_angle" if seen else "motor_speed"
    measured = angle + 1e-5 * top * rng.standard_normal(n) if seen else speed + 1e-3 * top * rng.standard_normal(n)
    return VaryingRecord(logged, measured, role, name, order, inertia, around, float(np.ptp(angle) / 2.0 / np.pi))
