"""What the model lacks: laws on the motor or on the load, a gap, a third mass, and faults of the log.

The size is a share of rated torque, as in the one-body study: of a law with a torque of its own its largest value,
of noise on the log the standard deviation; of drag, crank and eccentricity, whose torque depends on the motion, the
root mean square. A gap left out has a half gap of 3, 10 or 30 % of the twist at rated torque, a third mass 4, 13 or
40 % of the load's inertia. The root mean square of what is missing is stated of every record.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.study.missing_laws.laws import SIZES, Law, draw_law as draw_on_one_body
from tests.study.two_masses import kernel
from tests.study.two_masses.machine import HALF_GAPS, Machine

BODIES = ("motor", "load")
ON_EITHER_BODY = ("asymmetry", "stribeck", "drag", "warm-up", "load-steps", "cogging", "gravity", "crank")
# The model has dry friction on the motor alone unless load.coulomb is freed.
LAWS = (*(f"{body}.{law}" for law in ON_EITHER_BODY for body in BODIES), "load.dry", "motor.log-noise",
        "motor.eccentricity", "shaft.gap", "load.third-mass")
# Laws sized by the motion, with the largest strength that a machine may have: the share of the body's inertia that
# varies, the ripple of the speed, and drag at rated speed over rated torque: few records come near that speed.
MOST = {"crank": 0.5, "eccentricity": 0.1, "drag": 2.0}
THIRD_MASSES = {"S": 0.04, "M": 0.13, "L": 0.4}  # share of the load's inertia
THIRD_DAMPING = 0.03  # relative


@dataclass(frozen=True)
class Placed:
    """A law on a body.

    law   its name is "none" where nothing is missing; a crank, an eccentricity and a third mass have shares as
          their strength, drag the coefficient [N m s^2/rad^2], the others [N m]
    body  of BODIES, by number
    """

    law: Law
    body: int

    @property
    def code(self) -> int:
        """Of the kernel."""
        inside = self.law.name in kernel.CODES and not (self.law.name == "third-mass" and self.law.strength == 0.0)
        return kernel.CODES.index(self.law.name) if inside else kernel.PLAIN

    def numbers(self, machine: Machine) -> np.ndarray:
        """(4,) what the kernel wants of it."""
        if self.code == kernel.THIRD:
            mass, c = self.law.strength * machine.values["load.inertia"], self.law.constants
            angular = 2.0 * np.pi * c["frequency"]
            return np.array([mass, mass * angular**2, 2.0 * c["damping"] * angular * mass, 0.0])
        rest = () if self.law.name == "third-mass" else self.law.constants.values()
        return np.array([self.law.strength, *rest, *[0.0] * 3])[:4]

    def at(self, strength: float) -> Placed:
        """The same with another strength."""
        return replace(self, law=replace(self.law, strength=strength))

    def fastest(self, machine: Machine) -> float:
        """[1/s] what the kernel's step must resolve, up to twice the rated speed."""
        shaft = 2.0 * np.pi * machine.resonance
        if self.code == kernel.THIRD:  # its own frequency on what is left of the load
            own = 2.0 * np.pi * self.law.constants["frequency"]
            shaft = np.hypot(shaft, own) / np.sqrt(1.0 - self.law.strength)
        inertia = machine.values[f"{BODIES[self.body]}.inertia"]
        own = self.law.fastest(replace(machine.rigid, inertia=inertia), 2.0 * machine.rated_speed)
        return max(shaft, own)

    def curves(self, machine: Machine, speeds: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of friction referred to the motor, as in Law.curves: the load's counts at the motor's speed."""
        friction, uneven = self.law.curves(machine.rigid, speeds, times)
        if self.law.name == "drag":
            friction = friction + self.law.strength * speeds**2
        elif self.law.name == "dry":
            friction = friction + self.law.strength
        return friction, uneven


def draw_law(situation: str, machine: Machine, seconds: float, rng: np.random.Generator) -> Placed:
    """A law without strength, its other constants drawn."""
    body, _, name = situation.partition(".")
    if situation not in LAWS:
        return Placed(Law("none"), 0)
    if body not in BODIES:  # of the shaft
        return Placed(Law(name), 0)
    law = draw_on_one_body(name, machine.rigid, seconds, rng)
    if name == "third-mass":
        law = replace(law, constants={"frequency": machine.resonance * rng.uniform(1.3, 3.0),
                                      "damping": THIRD_DAMPING})
    return Placed(law, BODIES.index(body))


def half_gap_of(size: str, machine: Machine) -> float:
    """[rad] of a gap left out."""
    return HALF_GAPS.get(size, 0.0) * machine.rated_twist


def strength_of(name: str, size: str, machine: Machine) -> float:
    """Strength of a law that is not sized by the motion; a gap is one of the machine's numbers."""
    if name in ("none", "gap"):
        return 0.0
    return THIRD_MASSES.get(size, 0.0) if name == "third-mass" else SIZES.get(size, 0.0) * machine.rated_torque
