"""Inertia of a body: what the sum of its torques accelerates."""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, body):
    """J dw/dt = sum of torques; the sum is stamped by the other effects."""
    assembly.masses.append(assembly.of_body(body, "inertia"))


EFFECT = Effect(
    code="inertia",
    of="body",
    quantities={"inertia": Quantity("{T} s^2/{q}", "inertia", (1e-12, 1e12), 1.0)},
    stamp=stamp,
    law="J dw/dt = sum of torques",
    needs="torque that changes the speed",
    source="Tallfors 2005, (2.1)",
)
