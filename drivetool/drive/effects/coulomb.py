"""Coulomb friction of a body, with a true standstill.

Sliding friction is constant and opposes the motion. At zero speed the body sticks for as long
as the other torques stay below the level: a set-valued law. The common tanh(w/small) creeps at
standstill by 1e-2 rad/s whatever the step, which a fit then takes for physics.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, body):
    """-Tc sgn(w) on the body; sticking while |sum of the other torques| <= Tc.

    It does not act by itself where another law contains it.
    """
    if (body, "coulomb") not in assembly.replaced:
        assembly.friction(body, assembly.of_body(body, "coulomb"))


EFFECT = Effect(
    code="coulomb",
    of="body",
    quantities={"coulomb": Quantity("{T}", "Coulomb friction", (0.0, 1e12), 1e-3, 0.0)},
    stamp=stamp,
    law="T = Tc sgn(w); |T| <= Tc at w = 0",
    needs="motion in both directions; many slow reversals to distinguish the bodies",
    source="Tallfors 2005, ch. 5; Nordin, Galic, Gutman 1997",
    present=("coulomb",),
    referred={"coulomb": 1},
    friction=("coulomb",),
)
