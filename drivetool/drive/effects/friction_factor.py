"""One factor on the friction of all bodies: the same machine on another day, with other oil or another preload.

It stamps nothing: `Assembly.of_body` multiplies what effects declare as friction.
"""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

EFFECT = Effect(
    code="friction-factor",
    of="friction",
    quantities={"factor": Quantity("", "factor on the friction of all bodies", (0.0, 1e6), 1.0, 1.0)},
    law="T = f (Tc sgn(w) + c w + ..)",
    needs="a recording that identifies the friction at a factor of one, and one of another day",
    source="Bittencourt, Gunnarsson 2012, J. Dyn. Sys. Meas. Control 134",
    present=("factor",),
)
