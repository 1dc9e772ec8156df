"""Machines for the hidden-effect tests, by seed: what a plain fit knows, nothing hidden yet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tests.simulator.machine import Machine

BODIES = {1: ("motor",), 2: ("motor", "load"), 3: ("motor", "gear", "arm")}
SHAFTS = {1: (), 2: ("shaft",), 3: ("shaft", "shaft2")}


@dataclass(frozen=True)
class Rig:
    """A machine with the scales of its experiments.

    machine  without hidden effects; linear axes have [N, m] for [Nm, rad]
    top      [rad/s] speed that half a second of rated torque gives; the scale of all speeds
    turn     [rad] 1 for rotary machines, metres per radian for linear axes
    linear   whether it is a linear axis
    duration [s] of its records
    """

    machine: Machine
    top: float
    turn: float = 1.0
    linear: bool = False
    duration: float = 12.0

    @property
    def units(self) -> tuple[str, str]:
        """(torque, motion) unit."""
        return ("N", "m") if self.linear else ("Nm", "rad")

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names, from the motor outwards."""
        return BODIES[self.machine.bodies]

    @property
    def rated(self) -> float:
        """Rated torque [Nm]."""
        return self.machine.rated_torque

    @property
    def resonance(self) -> float:
        """Lowest resonance [Hz]; 15 for one body, which has none."""
        return resonances(self.machine)[0] if self.machine.bodies > 1 else 15.0


def resonances(machine: Machine) -> list[float]:
    """Undamped resonances [Hz], ascending."""
    n = machine.bodies
    stiffness = np.zeros((n, n))
    for k, (ks, ratio) in enumerate(zip(machine.stiffness, machine.ratio, strict=True)):
        row = np.array([1.0 / ratio, -1.0])
        stiffness[k:k + 2, k:k + 2] += ks * np.outer(row, row)
    root = 1.0 / np.sqrt(np.array(machine.inertia))
    squares = np.linalg.eigvalsh(stiffness * np.outer(root, root))
    return [math.sqrt(max(s, 0.0)) / 2.0 / math.pi for s in squares[1:]]


def rig_by_seed(seed: int, bodies: int = 2, linear: bool = False,
                coulomb: Mapping[int, float] | None = None, duration: float = 12.0) -> Rig:
    """A plausible machine; the same seed with other options keeps what they leave alone.

    Inertia ratio 0.1 to 10, resonance 5 to 60 Hz, damping 1 to 10 %. Viscous friction is shared in
    proportion to the inertias and the idle torque is on the last body, so that a fit of the sums
    describes the machine completely.
    coulomb  body (-1: the last) -> Coulomb friction over rated torque; the plain fit knows of it
    """
    rng = np.random.default_rng([seed, 7919])
    motor = 10.0 ** rng.uniform(0.3, 2.0) if linear else 10.0 ** rng.uniform(-1.0, 1.0)
    ratio, hertz = 10.0 ** rng.uniform(-1.0, 1.0), 5.0 * 12.0 ** rng.uniform()
    zeta = 0.01 * 10.0 ** rng.uniform(0.0, 1.0)
    gain = rng.uniform(2.0, 8.0) if linear else rng.uniform(20.0, 80.0)
    friction, idle = rng.uniform(0.02, 0.08), rng.uniform(0.02, 0.1)
    gear_share, second_stiffness = rng.uniform(0.3, 0.7), rng.uniform(1.8, 3.0)
    inertia = {1: (motor * (1.0 + ratio),), 2: (motor, motor * ratio),
               3: (motor, motor * ratio * gear_share, motor * ratio * (1.0 - gear_share))}[bodies]
    total = sum(inertia)
    rated, top = total * gain, 0.5 * gain
    viscous = tuple(friction * rated / top * j / total for j in inertia)
    stiffness, damping = _shafts(inertia, hertz, second_stiffness, zeta)
    level = [0.0] * bodies
    for index, share in (coulomb or {}).items():
        level[index] = rated * share
    machine = Machine(inertia, viscous, tuple(level), (0.0,) * (bodies - 1) + (idle * rated,), stiffness,
                      damping, rated_torque=rated)
    return Rig(machine, top, 0.02 if linear else 1.0, linear, duration)


def _shafts(inertia, hertz, second_stiffness, zeta):
    """Stiffnesses that put the lowest resonance at `hertz`, and damping of `zeta` there.

    second  stiffness of a second shaft over that of the first
    """
    if len(inertia) == 1:
        return (), ()
    shape = (1.0, second_stiffness)[: len(inertia) - 1]
    lowest = resonances(Machine(inertia, stiffness=shape))[0]
    scale = (hertz / lowest) ** 2
    stiffness = tuple(s * scale for s in shape)
    return stiffness, tuple(zeta / math.pi / hertz * s for s in stiffness)
