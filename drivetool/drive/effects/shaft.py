"""Elastic shaft between two neighbouring bodies, with damping and a gear ratio."""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, shaft):
    """Ts = ks twist + cs d(twist)/dt, twist = angle/ratio - next angle; -Ts/ratio acts on the first body."""
    stiffness, damping, ratio = (assembly.of_shaft(shaft, s) for s in ("stiffness", "damping", "ratio"))
    assembly.shafts.append((stiffness, damping, ratio))
    # As a gap would have it; without one there is contact always.
    of_contact = assembly.drive.damping_law != "always"
    (assembly.contact_damping if of_contact else assembly.always_damping)[shaft] = damping


EFFECT = Effect(
    code="shaft",
    of="shaft",
    quantities={
        "stiffness": Quantity("{T}/{q}", "stiffness", (1e-9, 1e15), 1.0),
        "damping": Quantity("{T} s/{q}", "damping", (0.0, 1e12), 1e-3, 0.0),
        "ratio": Quantity("", "gear ratio", (1e-6, 1e6), 1.0, 1.0),
    },
    stamp=stamp,
    law="Ts = ks twist + cs d(twist)/dt",
    needs="excitation near the resonance",
    source="Tallfors 2005, (2.1); Ostring, Gunnarsson, Norrlof 2003 for the ratio",
)
