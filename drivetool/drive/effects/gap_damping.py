"""Shaft damping that acts in the gap as well: oil between the flanks, or a clutch parallel to the gap.

With it and no other damping the law is that of Tallfors 2005, chapter 6; without it that of (5.17), whose damping
is part of the contact. A drive may have both.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, shaft):
    """Added to the damping in contact."""
    damping, more = assembly.always_damping.get(shaft), assembly.of_shaft(shaft, "gap_damping")
    assembly.always_damping[shaft] = more if damping is None else damping + more


EFFECT = Effect(
    code="damping-in-gap",
    of="shaft",
    quantities={"gap_damping": Quantity(
        "{T} s/{q}", "damping that acts in the gap too", (0.0, 1e12), 1e-3, 0.0)},
    stamp=stamp,
    law="Ts = ks dead(z, a) + g d(twist)/dt",
    needs="many passages through the gap",
    source="Tallfors 2005, ch. 6",
    present=("gap_damping",),
)
