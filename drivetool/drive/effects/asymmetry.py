"""Friction that depends on the direction of motion.

Only the viscous part needs a law: Coulomb friction that differs by direction is Coulomb friction
plus an idle torque, exactly.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def torque(w, _, time, side, p, out):
    """-ca |w|, ca = p[0]: more friction forward, less backward."""
    out[0] = -p[0, 0] * abs(w)
    out[1] = -p[0, 0] if w > 0.0 else p[0, 0]
    out[3] = -abs(w)


def stamp(assembly, body):
    """c + ca forward, c - ca backward."""
    assembly.law(torque, [assembly.of_body(body, "viscous_asymmetry")],
                 {assembly.speed(body): assembly.number(1.0)}, body=body)


EFFECT = Effect(
    code="asymmetric-friction",
    of="body",
    quantities={"viscous_asymmetry": Quantity(
        "{T} s/{q}", "half the difference of viscous friction forward and backward", (-1e12, 1e12), 1e-3, 0.0)},
    stamp=stamp,
    torque=torque,
    law="T = (c + ca sgn(w)) w",
    needs="at least two speeds in either direction",
    source="Armstrong-Helouvry 1991, Control of Machines with Friction",
    present=("viscous_asymmetry",),
    friction=("viscous_asymmetry",),
    odd=False,
)
