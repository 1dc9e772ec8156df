"""Friction of all bodies that falls by the same share while the drive warms up.

One oil, one temperature: if only the motor is measured, a record cannot identify the loss of each body, and this
law fixes it.
"""

from drivetool.drive.effects import drift
from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, _drive):
    """Friction of every body above its final value; drift.py is the same for one body."""
    coulomb_share, viscous_share, time = (
        assembly.parameter(f"friction.{s}") for s in ("drift_coulomb", "drift_viscous", "drift_time"))
    for body in range(assembly.n):
        slides = assembly.acts(body, "coulomb")
        level = coulomb_share * assembly.of_body(body, "coulomb") if slides else assembly.number(0.0)
        assembly.law(drift.torque, [level, viscous_share * assembly.of_body(body, "viscous"), time],
                     {assembly.speed(body): assembly.number(1.0)}, body=body, slides=slides)


EFFECT = Effect(
    code="warm-up",
    of="friction",
    quantities={
        "drift_coulomb": Quantity("", "share of Coulomb friction lost while warming up", (-1.0, 1e3), 1e-3, 0.0),
        "drift_viscous": Quantity("", "share of viscous friction lost while warming up", (-1.0, 1e3), 1e-3, 0.0),
        "drift_time": Quantity("s", "time constant of warming up", (1e-2, 1e6), 0.1, 10.0),
    },
    stamp=stamp,
    torque=drift.torque,
    law="T = (sd Tc sgn(w) + sv c w) exp(-t/tau), shares of the warm friction of every body",
    needs="steady running from cold for longer than the time constant; best a repeated record",
    source="Bittencourt, Gunnarsson 2012, J. Dyn. Sys. Meas. Control 134",
    present=("drift_coulomb", "drift_viscous"),
)
