"""Backlash: the shaft carries no torque until its ends are in contact.

Two published forms. "inside" (Tallfors 2005, 5.17): the dead zone acts on twist plus damping, so
the torque is continuous and never pulls. "always" (chapter 6): the dead zone acts on the twist
alone and the damping acts in the gap too.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, shaft):
    """Ts = ks (z - a) above a, 0 between, ks (z + a) below -a."""
    assembly.gaps[shaft] = assembly.of_shaft(shaft, "half_gap")


EFFECT = Effect(
    code="backlash",
    of="shaft",
    quantities={"half_gap": Quantity("{q}", "backlash half gap", (0.0, 1e3), 1e-4, 0.0)},
    stamp=stamp,
    law="Ts = ks dead(z, a), z = twist + (cs/ks) d(twist)/dt",
    needs="shaft torque of both signs",
    source="Tallfors 2005, (5.17) and ch. 6; another law: Nordin, Galic, Gutman 1997",
    present=("half_gap",),
)
