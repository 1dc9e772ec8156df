"""Loss of a transmission: dry friction on the body behind it that grows with the torque transmitted.

Teeth and threads slide under the load that they carry. So a gear of 90 % efficiency takes a tenth of the
torque while the motor drives; while it is driven, its loss adds to the torque that brakes the body. Both act as
Coulomb friction does: against the motion, and at standstill they hold.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.errors import BadParameters, ImpossibleValues
from drivetool.quantity import Quantity, name_of


def stamp(assembly, body):
    """(loss |T|) sgn(w) on the body behind a shaft of torque T; of the first body T = u - J_rotor dw/dt."""
    name = name_of(assembly.drive.bodies[body], "rotor_inertia")
    driving, driven = (assembly.of_body(body, suffix) for suffix in ("loss_driving", "loss_driven"))
    rotor = assembly.of_body(body, "rotor_inertia") / assembly.masses[body]
    if body and rotor.v:
        raise BadParameters("a rotor in front of the first transmission only", name, "Delete it.")
    if not rotor.v < 1.0:
        raise ImpossibleValues(f"{name} below the inertia of its body", f"{assembly.parameter(name).v:g}",
                               "Correct it.")
    assembly.friction(body, assembly.number(0.0))
    assembly.losses[body] = (driving, driven, rotor)


EFFECT = Effect(
    code="transmission-loss",
    of="body",
    quantities={
        "loss_driving": Quantity("", "share of the transmitted torque that is lost where the motor drives",
                                 (0.0, 0.9), 1e-2, 0.0),
        "loss_driven": Quantity("", "share of the transmitted torque that is lost where the motor is driven",
                                (0.0, 0.9), 1e-2, 0.0),
        "rotor_inertia": Quantity("{T} s^2/{q}", "part of the first body's inertia in front of its transmission",
                                  (0.0, 1e12), 1.0, 0.0),
    },
    stamp=stamp,
    law="T_loss = loss |T| sgn(w); |T_loss| <= loss |T| at w = 0",
    needs="large and small torques at like speeds, in driving and in braking; a known inertia behind it",
    source="Hamon, Gautier, Garrec 2010, IEEE/RSJ IROS: dry friction that depends on load and velocity",
    present=("loss_driving", "loss_driven"),
)
