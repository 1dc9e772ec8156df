"""A clamped body: held at standstill from outside while a recording is made, as by a brake or a fixture.

What is left to move swings against it: the record tells the inertias and shafts that move, and nothing beyond.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

# Inertia of the clamp, in the drive's own unit. A torque of 1e6 moves it by 1e-4 of a unit in a minute; an inertia
# of 1e3 beside it keeps seven digits more than a recording has.
FIXTURE = 1e14


def stamp(assembly, body):
    """As heavy as what it is fixed to."""
    clamped = assembly.of_body(body, "clamped")
    if clamped.v != 0.0:
        assembly.carry(body, clamped * FIXTURE)


EFFECT = Effect(
    code="clamp",
    of="body",
    quantities={"clamped": Quantity("", "1 while the body is clamped, else 0", (0.0, 1.0), 1.0, 0.0, (0.0, 1.0))},
    stamp=stamp,
    law="w = 0",
    needs="a recording with the body clamped, and a torque that swings the others",
    source="bus driveline paper: the motor excited with the wheels held",
    present=("clamped",),
)
