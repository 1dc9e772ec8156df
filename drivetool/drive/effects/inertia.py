"""Inertia of a body: what the sum of its torques accelerates."""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def mass(value):
    """J; the sum of torques is stamped by the other effects."""
    return value("inertia")


EFFECT = Effect(
    code="inertia",
    of="body",
    quantities={"inertia": Quantity("{T} s^2/{q}", "inertia", (1e-12, 1e12), 1.0)},
    mass=mass,
    law="J dw/dt = sum of torques",
    needs="torque that changes the speed",
    source="Tallfors 2005, (2.1)",
)
