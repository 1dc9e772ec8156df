"""What a machine may have beyond inertia, linear shafts, viscous and Coulomb friction.

All values are neutral by default; empty tuples are neutral values for every body or shaft.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

BODY = {"stribeck": 0.0, "stribeck_speed": 1.0, "stribeck_power": 2.0, "coulomb_back": math.nan,
        "viscous_back": math.nan, "quadratic": 0.0, "lugre_stiffness": 0.0, "lugre_damping": 0.0}
SHAFT = {"hardening_twist": math.inf, "hardening_power": 2.0, "damping_torque": math.inf,
         "loss_driving": 0.0, "loss_driven": 0.0}


@dataclass(frozen=True)
class Effects:
    """Laws beyond those of the plain machine; n bodies.

    stribeck, stribeck_speed, stribeck_power  (n,) [Nm], [rad/s], [-]: sliding friction is coulomb + stribeck
                     exp(-(|w| / stribeck_speed)^power), breakaway coulomb + stribeck
    coulomb_back, viscous_back  (n,) of negative motion; NaN: as in the other direction
    quadratic        (n,) [Nm s^2/rad^2] torque c2 w |w| against the motion
    lugre_stiffness, lugre_damping  (n,) [Nm/rad], [Nm s/rad] s0, s1 of Canudas de Wit et al. 1995: where s0 is
                     positive, the sliding friction g(w) as above acts through a bristle and never sticks:
                     torque s0 z + s1 dz/dt against the motion, dz/dt = w - s0 |w| z / g(w)
    hardening_twist, hardening_power  (n-1,) [rad], [-]: torque k phi (1 + (|phi| / twist)^power)
                     of the elastic deflection phi
    damping_torque   (n-1,) [Nm] T0: damping c (1 + |elastic torque| / T0)
    loss_driving, loss_driven  (n-1,) [-] of a transmission: dry friction on the body behind the shaft, as
                     Coulomb's, of the level loss |T|; T is the shaft's torque, which drives or is driven as it
                     has or has not the sign of the motion (at standstill: of the motion that would be).
                     Of one body alone (1,): T = u - rotor_inertia dw/dt, u being all torques on the motor's side
                     (behind the converter, torque noise, ripple)
    rotor_inertia    [kg m^2] of one body alone, the part of its inertia in front of the transmission
    ripple           (amplitude [Nm], order [-], phase [rad]): a sin(order angle + phase) is added
                     to the torque on body 0; so is ripple2
    imbalance        (amplitude [Nm], ratio [-], phase [rad]): a sin(angle / ratio + phase) opposes
                     the last body, as a weight does
    drift            (share [-], time [s]): viscous and Coulomb friction of all bodies times
                     1 + share exp(-t / time)
    load_step        (torque [Nm], time [s]): opposes the last body from then on
    filter_time      [s] of a first-order low pass between the speed of body 0 and its sensor
    """

    stribeck: tuple[float, ...] = ()
    stribeck_speed: tuple[float, ...] = ()
    stribeck_power: tuple[float, ...] = ()
    coulomb_back: tuple[float, ...] = ()
    viscous_back: tuple[float, ...] = ()
    quadratic: tuple[float, ...] = ()
    lugre_stiffness: tuple[float, ...] = ()
    lugre_damping: tuple[float, ...] = ()
    hardening_twist: tuple[float, ...] = ()
    hardening_power: tuple[float, ...] = ()
    damping_torque: tuple[float, ...] = ()
    loss_driving: tuple[float, ...] = ()
    loss_driven: tuple[float, ...] = ()
    rotor_inertia: float = 0.0
    ripple: tuple[float, float, float] = (0.0, 1.0, 0.0)
    ripple2: tuple[float, float, float] = (0.0, 1.0, 0.0)
    imbalance: tuple[float, float, float] = (0.0, 1.0, 0.0)
    drift: tuple[float, float] = (0.0, 1.0)
    load_step: tuple[float, float] = (0.0, 0.0)
    filter_time: float = 0.0

    def of(self, name: str, size: int) -> tuple[float, ...]:
        """The tuple of a law, with neutral values if it is empty; ValueError for another length."""
        values = tuple(float(v) for v in getattr(self, name))
        if values and len(values) != size:
            raise ValueError(f"{name}: wanted {size} values, found {len(values)}")
        return values or ((BODY | SHAFT)[name],) * size

    @property
    def none(self) -> bool:
        """Whether no law differs from its neutral value."""
        return all(getattr(self, f.name) == f.default for f in fields(self))


NONE = Effects()
