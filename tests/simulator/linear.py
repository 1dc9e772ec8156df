"""Machines without gap and Coulomb friction: exact from sample to sample by matrix exponential.

Written independently of the event simulator, from the equations, so that each checks the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from tests.simulator.machine import Machine, State, at_rest


@dataclass(frozen=True)
class LinearRun:
    """What happened, at the n sample instants; (records, ...) in front if there are several.

    time            (n,) [s]
    speeds, angles  (..., n, bodies) [rad/s], [rad]
    shaft_torques   (..., n, bodies-1) [Nm]
    """

    time: np.ndarray
    speeds: np.ndarray
    angles: np.ndarray
    shaft_torques: np.ndarray


def equations(machine: Machine) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (m, m), B (m, 4), C (shafts, m) of dx/dt = A x + B v, Ts = C x.

    x = speeds, twists, angle of body 0, and with a converter torque and torque rate;
    v = command, torque noise, load torque, 1.
    """
    n = machine.bodies
    lag = machine.converter_bandwidth is not None
    m = 2 * n + 2 * lag
    a, b, c = np.zeros((m, m)), np.zeros((m, 4)), np.zeros((n - 1, m))
    for k in range(n - 1):
        a[n + k, [k, k + 1]] = 1.0 / machine.ratio[k], -1.0
        c[k] = machine.damping[k] * a[n + k]
        c[k, n + k] = machine.stiffness[k]
    for k in range(n - 1):
        a[k] -= c[k] / machine.ratio[k] / machine.inertia[k]
        a[k + 1] += c[k] / machine.inertia[k + 1]
    for i in range(n):
        a[i, i] -= machine.viscous[i] / machine.inertia[i]
        b[i, 3] = -machine.idle_torque[i] / machine.inertia[i]
    a[2 * n - 1, 0] = 1.0
    b[0, 1] = 1.0 / machine.inertia[0]
    b[n - 1, 2] = -1.0 / machine.inertia[-1]
    if lag:
        w0 = machine.converter_bandwidth
        a[0, 2 * n] = 1.0 / machine.inertia[0]
        if np.isinf(machine.converter_damping):
            a[2 * n, 2 * n], b[2 * n, 0] = -w0, w0
        else:
            a[2 * n, 2 * n + 1] = 1.0
            a[2 * n + 1, 2 * n:] = -w0 * w0, -2.0 * machine.converter_damping * w0
            b[2 * n + 1, 0] = w0 * w0
    else:
        b[0, 0] = 1.0 / machine.inertia[0]
    return a, b, c


def simulate_linear(
    machine: Machine,
    torque: np.ndarray,
    step: float,
    start: State | None = None,
    torque_noise: np.ndarray | None = None,
    load_torque: np.ndarray | None = None,
) -> LinearRun:
    """One record, or many at once, of a machine that never switches.

    torque, torque_noise, load_torque  (n,) or (records, n) [Nm], held over each sample
    raises   ValueError if the machine has a gap or Coulomb friction
    """
    if not machine.is_linear:
        raise ValueError("simulate_linear: the machine has a gap or Coulomb friction; use simulate")
    a, b, c = equations(machine)
    start = start or at_rest(machine)
    given = [np.zeros(1) if v is None else np.asarray(v, float) for v in (torque, torque_noise, load_torque)]
    shape = np.broadcast_shapes(*(v.shape for v in given))
    command, noise, load = (np.broadcast_to(v, shape).reshape(-1, shape[-1]).T for v in given)
    n, records = command.shape
    whole, transition = _transition(a, b, machine.dead_time, step)
    command = np.vstack([np.full((whole + 1, records), start.torque), command])
    m, nb = len(a), machine.bodies
    z = np.ones((m + 5, records))
    z[:m] = _vector(machine, start)[:, None]
    kept = np.empty((n, m, records))
    for i in range(n):
        z[m], z[m + 1], z[m + 2], z[m + 3] = command[i], command[i + 1], noise[i], load[i]
        kept[i] = z[:m]
        z[:m] = transition @ z
    kept = np.moveaxis(kept, 2, 0).reshape(*shape, m)
    angles = np.empty((*shape, nb))
    angles[..., 0] = kept[..., 2 * nb - 1]
    for k, ratio in enumerate(machine.ratio):
        angles[..., k + 1] = angles[..., k] / ratio - kept[..., nb + k]
    return LinearRun(np.arange(n) * step, kept[..., :nb], angles, kept @ c.T)


def _transition(a, b, dead_time, step):
    """(whole samples of dead time, (m, m+5) map of [x, older command, newer command, noise, load, 1])."""
    whole = int(np.floor(dead_time / step + 1e-9))
    early = max(dead_time - whole * step, 0.0)
    m = len(a)
    first = np.eye(m, m + 5)
    for length, used in ((early, 0), (step - early, 1)):
        block = np.zeros((m + 4, m + 4))
        block[:m, :m], block[:m, m:] = a, b
        ahead = expm(block * length)[:m]
        wide = np.zeros((m, m + 5))
        wide[:, m + used], wide[:, m + 2:] = ahead[:, m], ahead[:, m + 1:]
        first = ahead[:, :m] @ first + wide
    return whole, first


def _vector(machine, start):
    converter = [start.torque, start.torque_rate] if machine.converter_bandwidth is not None else []
    return np.array([*start.speeds, *start.twists, start.angle, *converter], float)
