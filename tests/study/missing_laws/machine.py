"""Random one-body drives: the bigger, the slower and the more sluggish."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MIN_POWER, MAX_POWER = 20.0, 2e6  # [W] a small servo, a rolling mill


@dataclass(frozen=True)
class Machine:
    """A drive whose model is right: inertia dv/dt + viscous v + coulomb sgn v + idle = torque.

    rated_torque [N m], rated_speed [rad/s]; inertia [kg m^2], viscous [N m s/rad], coulomb and idle [N m]
    """

    rated_torque: float
    rated_speed: float
    inertia: float
    viscous: float
    coulomb: float
    idle: float

    def numbers(self) -> np.ndarray:
        """(4,) what the kernel wants."""
        return np.array([self.inertia, self.viscous, self.coulomb, self.idle])


def draw_machine(rng: np.random.Generator) -> Machine:
    """A machine of any power between MIN_POWER and MAX_POWER, uniform in its logarithm."""
    bigger = np.log(MAX_POWER / MIN_POWER) * rng.uniform()
    power = MIN_POWER * np.exp(bigger)
    speed = 300.0 * np.exp(-0.2 * bigger) * 10.0 ** rng.uniform(-0.25, 0.25)
    torque = power / speed
    # Time from rest to rated speed at rated torque: tens of milliseconds, up to a second for mills.
    runup = 0.045 * np.exp(0.16 * bigger) * 10.0 ** rng.uniform(-0.25, 0.35)
    return Machine(rated_torque=torque, rated_speed=speed, inertia=torque * runup / speed,
                   viscous=torque / speed * rng.uniform(0.02, 0.15), coulomb=torque * rng.uniform(0.03, 0.13),
                   idle=torque * rng.uniform(-0.03, 0.03))
