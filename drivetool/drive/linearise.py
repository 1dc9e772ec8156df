"""The drive as a linear system: contact closed, no Coulomb friction.

The drive for small motion about a load that keeps its gaps closed: state space, resonances and anti-resonances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from drivetool.drive.assemble import Assembly, Layout
from drivetool.drive.chain import Drive
from drivetool.quantity import owner_of, quantity_of

MOTOR_TORQUE = "motor_torque"


@dataclass(frozen=True)
class Mode:
    """A resonance or anti-resonance from motor torque to motor speed.

    kind           resonance: poles; anti-resonance: zeros, at which the motor is at rest
    frequency_hz   of the undamped drive, from stiffnesses and inertias alone
    damping_ratio  of the pair of poles or zeros; where the pair does not oscillate, that of the
                   undamped mode shape
    damped_hz      frequency of its oscillation; zero if it does not oscillate
    """

    kind: Literal["resonance", "anti-resonance"]
    frequency_hz: float
    damping_ratio: float
    damped_hz: float


def linear_drive(drive: Drive) -> Drive:
    """The drive without gaps, Coulomb friction, bristles, transmission loss and dead time."""
    removed = ("half_gap", "coulomb", "bristle_stiffness", "loss_driving", "loss_driven", "dead_time")
    return replace(drive, damping_law="inside", values={  # the law matters in a gap alone
        k: v for k, v in drive.values.items() if quantity_of(k) not in removed})


def chain_alone(drive: Drive) -> Drive:
    """The chain alone, without torque path and sensor."""
    return replace(drive, values={
        k: v for k, v in drive.values.items() if owner_of(k) not in ("converter", "sensor")})


def state_space(drive: Drive, inputs: Sequence[str] = (MOTOR_TORQUE,), outputs: Sequence[str] = ("motor_speed",),
                ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """State space in continuous time, the converter included, the dead time not.

    inputs   roles; the load torque opposes the load's motion
    outputs  roles
    returns  (A (n, n), B (n, nu), C (ny, n), D (ny, nu)); states are the speeds, the twists, the
             angle if an output is one, and the converter's torque and torque rate
    raises   BadParameters: a value is missing, or a role that the drive does not have
    source   Tallfors 2005, (2.1), (2.3)
    """
    others = tuple(role for role in inputs if role != MOTOR_TORQUE)
    layout = Layout((), (MOTOR_TORQUE, *others), tuple(outputs), 1.0, gradient=False)
    system = Assembly(linear_drive(drive), layout).system()
    a_matrix = system.rows[:, :, 0] / system.mass[:, :1]
    columns = [system.nx + (MOTOR_TORQUE, *others).index(role) for role in inputs]
    return (a_matrix[:, :system.nx], a_matrix[:, columns], system.outputs[:, :, 0],
            np.zeros((system.ny, len(columns))))


def resonances(drive: Drive) -> list[Mode]:
    """Resonances and anti-resonances from motor torque to motor speed, by frequency.

    A chain of n bodies has n - 1 of each. The converter does not affect them.

    source  Tallfors 2005, sec. 2.1: sqrt(ks (Jm + Jl)/(Jm Jl)), cs/2 sqrt((Jm + Jl)/(ks Jm Jl))
            and sqrt(ks/Jl) for two masses
    """
    inertia, stiffness, damping = _matrices(drive)
    free = _modes("resonance", inertia, stiffness, damping)[1:]  # the first is the rigid body
    # Zeros of a collocated response: the modes of the rest of the chain while the motor is held.
    held = _modes("anti-resonance", inertia[1:], stiffness[1:, 1:], damping[1:, 1:])
    return sorted(free + held, key=lambda mode: mode.frequency_hz)


def _matrices(drive: Drive) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inertias (n,), stiffness (n, n) and damping (n, n) over the angles of the bodies."""
    plain = Assembly(linear_drive(drive), Layout((), (MOTOR_TORQUE,), (), 1.0, gradient=False))
    n = plain.n
    stiffness, damping = np.zeros((n, n)), np.zeros((n, n))
    for k, (ks, _, ratio) in enumerate(plain.shafts):
        twist = np.zeros(n)
        twist[k], twist[k + 1] = 1.0 / ratio.v, -1.0
        stiffness += ks.v * np.outer(twist, twist)
        damping += plain.damping_of(k).v * np.outer(twist, twist)
    damping += np.diag([plain.of_body(k, "viscous").v for k in range(n)])
    return np.array([mass.v for mass in plain.masses]), stiffness, damping


def _modes(kind, inertia: np.ndarray, stiffness: np.ndarray, damping: np.ndarray) -> list[Mode]:
    """The modes of J q'' + C q' + K q = 0, by frequency."""
    if not len(inertia):
        return []
    root = np.sqrt(inertia)
    squares, shapes = np.linalg.eigh(stiffness / np.outer(root, root))
    loss = damping / np.outer(root, root)
    n, eye = len(root), np.eye(len(root))
    rates = np.linalg.eigvals(np.block([[-loss, -stiffness / np.outer(root, root)], [eye, np.zeros((n, n))]]))
    ringing = list(rates[rates.imag > 0.0])
    found = []
    for square, shape in zip(squares, shapes.T, strict=True):
        w = np.sqrt(max(square, 0.0))
        modal_damping = shape @ loss @ shape
        zeta = modal_damping / (2.0 * w) if w > 0.0 else np.inf
        pole = min(ringing, key=lambda rate: abs(abs(rate) - w), default=None)
        rings = zeta < 1.0 and pole is not None
        if rings:
            ringing.remove(pole)
            zeta = -pole.real / abs(pole)
        found.append(Mode(kind, float(w / (2.0 * np.pi)), float(zeta),
                          float(pole.imag / (2.0 * np.pi)) if rings else 0.0))
    return found
