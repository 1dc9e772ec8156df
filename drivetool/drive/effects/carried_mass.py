"""A mass that a body carries at a radius: the vehicle on its wheels, the table on its pinion."""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def mass(value):
    """m r^2."""
    return value("carried_mass") * value("radius") * value("radius")


EFFECT = Effect(
    code="carried-mass",
    of="body",
    quantities={
        "carried_mass": Quantity("{T} s^2/{q}/m^2", "mass that moves with the body", (0.0, 1e12), 1.0, 0.0),
        "radius": Quantity("m", "radius at which the mass is carried, 1 m unless given", (0.0, 1e6), 1.0, 1.0)},
    mass=mass,
    law="J + m r^2 in the place of J",
    needs="torque that changes the speed, and a radius that is known; inertia and mass only show as their sum",
    source="bus driveline paper: Jc = Jw + m r^2",
    present=("carried_mass",),
)
