"""One factor on the friction of all bodies: the same machine on another day, with other oil or another preload.

`Assembly.of_body` multiplies by it what effects declare as friction.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def prepare(assembly, _drive):
    """The factor, which the stamps of all friction need."""
    assembly.friction_factor = assembly.parameter("friction.factor")


EFFECT = Effect(
    code="friction-factor",
    of="friction",
    quantities={"factor": Quantity("", "factor on the friction of all bodies", (0.0, 1e6), 1.0, 1.0)},
    prepare=prepare,
    law="T = f (Tc sgn(w) + c w + ..)",
    needs="a recording that identifies the friction at a factor of one, and one of another day",
    source="Bittencourt, Gunnarsson 2012, J. Dyn. Sys. Meas. Control 134",
    present=("factor",),
)
