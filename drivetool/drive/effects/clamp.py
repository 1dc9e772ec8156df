"""A clamped body: held at standstill from outside while a recording is made, as by a brake or a fixture.

The other bodies oscillate against it: the record identifies the inertias and shafts that move, and no others.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

# Inertia of the clamp, in the drive's own unit. A torque of 1e6 moves it by less than 1e-4 of a unit in a minute. A
# larger one would cost digits of the other inertias: 1e3 next to it keeps seven more than a recording has.
CLAMP_INERTIA = 1e14


def stamp(assembly, body):
    """Add the inertia of the fixture."""
    clamped = assembly.of_body(body, "clamped")
    if clamped.v != 0.0:
        assembly.carry(body, clamped * CLAMP_INERTIA)


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
