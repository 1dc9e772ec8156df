"""The thirteen laws that the model lacks: constants by size, and what they add to the friction curve.

The size is a share of rated torque. Ten laws have a torque of their own: its largest value has this share (of
noise on the log: the standard deviation). The torque of the others depends on the motion: their strength is found
by simulation, so that the root mean square of the torque that the model misses has this share (see record.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from tests.study.missing_laws import kernel
from tests.study.missing_laws.machine import Machine

SIZES = {"S": 0.015, "M": 0.05, "L": 0.15}
LAWS = ("asymmetry", "stribeck", "lugre", "cogging", "gravity", "crank", "backlash", "elastic-shaft", "log-noise",
        "eccentricity", "saturation", "warm-up", "load-steps")
# Laws sized by the motion, with the largest strength that a machine may have: the share of the inertia that
# varies, the share behind the gap or shaft, the ripple of the speed, the share of the torque's peak cut off.
MOST = {"crank": 0.5, "backlash": 0.7, "elastic-shaft": 0.7, "eccentricity": 0.1, "saturation": 0.7}
# A law of size zero is the plain machine; these are so as a limit only, and the kernel then receives none.
LIMITS = ("lugre", "backlash", "elastic-shaft")


@dataclass(frozen=True)
class Law:
    """A law of one machine.

    name       of LAWS, or "none"
    strength   [N m] largest torque, or a share as in MOST
    constants  by name, as drawn by `draw_law`
    """

    name: str
    strength: float = 0.0
    constants: Mapping[str, float] = field(default_factory=dict)

    @property
    def code(self) -> int:
        """Of the kernel."""
        inside = self.name in kernel.CODES and not (self.name in LIMITS and self.strength == 0.0)
        return kernel.CODES.index(self.name) if inside else kernel.PLAIN

    def numbers(self, machine: Machine) -> np.ndarray:
        """(5,) what the kernel wants of it."""
        c, first = self.constants, self.strength
        if self.name in ("stribeck", "lugre"):
            rest = [c["speed"], c["shape"]]
            if self.code == kernel.LUGRE:
                stiffness = (machine.coulomb + first) / self._presliding(machine)
                rest += [stiffness, c["damping"] * 2.0 * np.sqrt(stiffness * machine.inertia)]
        elif self.name == "saturation":
            first, rest = (1.0 - first) * c["peak"], []
        elif self.code in (kernel.BACKLASH, kernel.SHAFT):
            reduced = machine.inertia * first * (1.0 - first)
            stiffness = reduced * (2.0 * np.pi * c["frequency"]) ** 2
            loss = c["damping"] * 2.0 * np.sqrt(stiffness * reduced)
            rest = [stiffness, loss] if self.name == "elastic-shaft" else [stiffness, c["loss"], c["half_gap"]]
        elif self.name in LIMITS:
            rest = []
        else:
            rest = list(c.values())
        return np.array([first, *rest, *[0.0] * (4 - len(rest))])

    def _presliding(self, machine: Machine) -> float:
        """[rad] grows with the size, so that no friction of size zero has any."""
        return self.constants["presliding"] * self.strength / (SIZES["L"] * machine.rated_torque)

    def fastest(self, machine: Machine, top: float) -> float:
        """[1/s] what the kernel's step must resolve up to the speed `top` [rad/s]."""
        c, inertia = self.constants, machine.inertia
        rate = {"cogging": lambda: c["periods"] * top, "crank": lambda: 2.0 * top, "gravity": lambda: top,
                "backlash": lambda: 4.0 * np.pi * c["frequency"] / (1.0 - self.strength),
                "elastic-shaft": lambda: 2.0 * np.pi * c["frequency"],
                "stribeck": lambda: self.strength / c["speed"] / inertia}
        if self.code == kernel.LUGRE:  # the bristles over the sliding body, and the body on the bristles
            _, _, _, stiffness, damping = self.numbers(machine)
            # At speed the bristles only follow: there the step must be stable, and need not be exact.
            return max(0.2 * stiffness * top / machine.coulomb, np.sqrt(stiffness / inertia), damping / inertia)
        return rate[self.name]() if self.name in rate else 0.0

    def curves(self, machine: Machine, speeds: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((n,) friction, mean of both directions; (n,) what differs between them) at speeds [rad/s], in N m.

        times  (k,) [s] over which friction that changes is averaged
        """
        friction, uneven, c = machine.coulomb + machine.viscous * speeds, np.zeros(len(speeds)), self.constants
        if self.name == "asymmetry":
            half = 0.5 * self.strength * (c["dry"] + (1.0 - c["dry"]) * np.minimum(speeds / c["speed"], 1.0))
            friction, uneven = friction + half, c["side"] * half
        elif self.name in ("stribeck", "lugre"):
            friction = friction + self.strength * np.array([kernel.falling(v / c["speed"], c["shape"])
                                                            for v in speeds])
        elif self.name == "warm-up":
            friction = friction + self.strength * np.mean(np.exp(-times / c["time"]))
        return friction, uneven


def draw_law(name: str, machine: Machine, seconds: float, rng: np.random.Generator) -> Law:
    """A law without strength, its other constants drawn."""
    rated, phase = machine.rated_speed, float(rng.uniform(0.0, 2.0 * np.pi))
    falling = {"speed": rated * 10.0 ** rng.uniform(-1.7, -1.0), "shape": float(rng.integers(3))}
    masses = {"frequency": 10.0 ** rng.uniform(1.1, 1.8), "damping": rng.uniform(0.02, 0.1)}
    constants = {
        "asymmetry": {"side": float(rng.choice([-1.0, 1.0])), "dry": float(rng.choice([0.0, 0.5, 1.0])),
                      "speed": 0.5 * rated},
        "stribeck": falling,
        "lugre": falling | {"presliding": 10.0 ** rng.uniform(-2.0, -1.2), "damping": rng.uniform(0.2, 0.8)},
        "cogging": {"periods": float(rng.integers(4, 31)), "phase": phase},
        "gravity": {"phase": phase}, "crank": {"phase": phase}, "eccentricity": {"phase": phase},
        # The loss of a contact per penetration's rate: restitution of about 0.9 at a tenth of rated speed.
        "backlash": masses | {"half_gap": 10.0 ** rng.uniform(-2.7, -1.5), "loss": 1.0 / rated},
        "elastic-shaft": masses,
        "warm-up": {"time": seconds * rng.uniform(0.25, 0.8)},
    }
    return Law(name, 0.0, constants.get(name, {}))
