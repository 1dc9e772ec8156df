"""Viscous friction of a body: torque in proportion to speed."""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, body):
    """-c w on the body."""
    assembly.torque(body, assembly.speed(body), -assembly.of_body(body, "viscous"))


EFFECT = Effect(
    code="viscous",
    of="body",
    quantities={"viscous": Quantity("{T} s/{q}", "viscous friction", (0.0, 1e12), 1e-3, 0.0)},
    stamp=stamp,
    law="T = c w",
    needs="at least two speeds; from motor torque and motor speed alone only the sum over the bodies",
    source="Tallfors 2005, (2.1)",
    present=("viscous",),
    referred={"viscous": 2},
    total={"viscous": "inertia"},  # all bodies then decay at one rate, Tallfors 2005 sec. 5.4
    friction=("viscous",),
)
