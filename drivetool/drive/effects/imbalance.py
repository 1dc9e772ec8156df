"""Imbalance: a weight on a body that gravity pulls down once per turn."""

from drivetool.drive.effects import ripple
from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, body):
    """At the body's own angle; a ripple of first order is the same law."""
    parameters = [assembly.of_body(body, s) for s in ("imbalance_sine", "imbalance_cosine")]
    assembly.law(ripple.torque, [*parameters, assembly.number(1.0)], assembly.angle_of(body), body=body)


EFFECT = Effect(
    code="imbalance",
    of="body",
    quantities={
        "imbalance_sine": Quantity("{T}", "imbalance, sine of the angle", (-1e12, 1e12), 1e-3, 0.0),
        "imbalance_cosine": Quantity("{T}", "imbalance, cosine of the angle", (-1e12, 1e12), 1e-3, 0.0),
    },
    stamp=stamp,
    torque=ripple.torque,
    law="T = a sin(angle) + b cos(angle) of the body, added to the torque that drives it",
    needs="several turns of the load; from the motor alone it is the same as a ripple of first order",
    source="Genta 2005, Dynamics of Rotating Systems",
    present=("imbalance_sine", "imbalance_cosine"),
    odd=False,
    over_angle=True,
)
