"""Inertia that was added to a body and is known: a disc, a tool, a part on the table.

A change of known size between recordings identifies what a single one cannot: the scale of all torques.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def mass(value):
    """The known inertia."""
    return value("added_inertia")


EFFECT = Effect(
    code="added-inertia",
    of="body",
    quantities={"added_inertia": Quantity(
        "{T} s^2/{q}", "inertia added to the body in some recordings", (0.0, 1e12), 1.0, 0.0)},
    mass=mass,
    law="J + J_added in the place of J",
    needs="a recording with it and one without: in one alone only the sum of both inertias shows",
    source="Swevers, Verdonck, De Schutter 2007, IEEE Control Systems Magazine 27(5): payload identification",
    present=("added_inertia",),
)
