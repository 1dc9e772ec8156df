"""Friction that falls while the drive warms up."""

from math import exp

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def torque(w, _, time, side, p, out):
    """-(Td side + cd w) exp(-t/tau); Td, cd, tau = p[0..2], t from the start of the record."""
    tau = p[2, 0]
    share = exp(-time / tau)
    extra = p[0, 0] * side + p[1, 0] * w
    out[0] = -extra * share
    out[1] = -p[1, 0] * share
    out[3] = -side * share
    out[4] = -w * share
    out[5] = -extra * share * time / (tau * tau)


def stamp(assembly, body):
    """Friction above its final value, decaying over the record."""
    slides = assembly.acts(body, "drift_coulomb")
    if slides:
        assembly.friction(body, assembly.number(0.0))
    parameters = [assembly.of_body(body, s) for s in ("drift_coulomb", "drift_viscous", "drift_time")]
    assembly.law(torque, parameters, {assembly.speed(body): assembly.number(1.0)}, body=body, slides=slides)


EFFECT = Effect(
    code="friction-drift",
    of="body",
    quantities={
        "drift_coulomb": Quantity("{T}", "Coulomb friction lost while warming up", (-1e12, 1e12), 1e-3, 0.0),
        "drift_viscous": Quantity(
            "{T} s/{q}", "viscous friction lost while warming up", (-1e12, 1e12), 1e-3, 0.0),
        "drift_time": Quantity("s", "time constant of warming up", (1e-2, 1e6), 0.1, 10.0),
    },
    stamp=stamp,
    torque=torque,
    law="T = (Td sgn(w) + cd w) exp(-t/tau)",
    needs="steady running from cold for longer than the time constant; best a repeated record",
    source="Bittencourt, Gunnarsson 2012, J. Dyn. Sys. Meas. Control 134",
    present=("drift_coulomb", "drift_viscous"),
    friction=("drift_coulomb", "drift_viscous"),
)
