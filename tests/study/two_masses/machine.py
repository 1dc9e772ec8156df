"""Random two-mass drives: the rigid drives of the one-body study, cut in two by a shaft."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tests.study.missing_laws.machine import Machine as Rigid, draw_machine as draw_rigid

LOAD_SHARE = (0.25, 0.8)  # of the inertia
RESONANCE = (8.0, 35.0)  # [Hz] of the load on the shaft, the motor held
DAMPING = (0.01, 0.06)  # relative, of the same
# In the order of the kernel's numbers.
NAMES = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "shaft.half_gap", "motor.viscous",
         "load.viscous", "motor.coulomb", "motor.idle_torque", "load.idle_torque")
# Half gaps over the twist at rated torque.
HALF_GAPS = {"S": 0.03, "M": 0.1, "L": 0.3}


@dataclass(frozen=True)
class Machine:
    """A drive whose model is right; `values` has the parameters by the names of the command line.

    rigid  the drive as one body: rated torque [N m] and speed [rad/s], sums of inertia and friction
    """

    rigid: Rigid
    values: Mapping[str, float]

    @property
    def rated_torque(self) -> float:
        """[N m]"""
        return self.rigid.rated_torque

    @property
    def rated_speed(self) -> float:
        """[rad/s]"""
        return self.rigid.rated_speed

    @property
    def rated_twist(self) -> float:
        """[rad] of the shaft at rated torque."""
        return self.rigid.rated_torque / self.values["shaft.stiffness"]

    @property
    def antiresonance(self) -> float:
        """[Hz] of the load on the shaft, the motor held."""
        return float(np.sqrt(self.values["shaft.stiffness"] / self.values["load.inertia"]) / (2.0 * np.pi))

    @property
    def resonance(self) -> float:
        """[Hz] of both inertias on the shaft, free."""
        return self.antiresonance * np.sqrt(self.rigid.inertia / self.values["motor.inertia"])

    def numbers(self) -> np.ndarray:
        """(NUMBERS,) what the kernel wants."""
        return np.array([self.values[name] for name in NAMES])


def draw_machine(rng: np.random.Generator) -> Machine:
    """A machine without a gap."""
    rigid = draw_rigid(rng)
    share = rng.uniform(*LOAD_SHARE)
    angular = 2.0 * np.pi * np.exp(rng.uniform(*np.log(RESONANCE)))
    load = share * rigid.inertia
    damping = 2.0 * np.exp(rng.uniform(*np.log(DAMPING))) * angular * load
    viscous, idle = rng.uniform(0.2, 0.8), rng.uniform()
    return Machine(rigid, {
        "motor.inertia": rigid.inertia - load, "motor.viscous": (1.0 - viscous) * rigid.viscous,
        "motor.coulomb": rigid.coulomb, "motor.idle_torque": (1.0 - idle) * rigid.idle,
        "load.inertia": load, "load.viscous": viscous * rigid.viscous, "load.idle_torque": idle * rigid.idle,
        "shaft.stiffness": load * angular**2, "shaft.damping": damping, "shaft.half_gap": 0.0})
