"""Torque ripple of the motor: a torque that repeats with its angle, of up to three orders."""

from math import cos, sin

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

RIPPLES = ("ripple", "ripple2", "ripple3")  # one name per order; a drive may have three
RIPPLE_QUANTITIES = {
    "sine": Quantity("{T}", "torque ripple, sine of the angle", (-1e12, 1e12), 1e-3, 0.0),
    "cosine": Quantity("{T}", "torque ripple, cosine of the angle", (-1e12, 1e12), 1e-3, 0.0),
    "order": Quantity("1/{q}", "order of the ripple: periods in 2 pi", (1e-6, 1e6), 1e-3, 1.0),
}


def torque(angle, _, time, side, p, out):
    """a sin(n angle) + b cos(n angle); a, b, n = p[0..2]."""
    s, c = sin(p[2, 0] * angle), cos(p[2, 0] * angle)
    swing = p[0, 0] * c - p[1, 0] * s
    out[0] = p[0, 0] * s + p[1, 0] * c
    out[1] = p[2, 0] * swing
    out[3] = s
    out[4] = c
    out[5] = angle * swing


def stamp(assembly, body):
    """At the body's own angle; the tool searches for it at the motor only."""
    for ripple in RIPPLES:
        if assembly.acts(body, f"{ripple}_sine") or assembly.acts(body, f"{ripple}_cosine"):
            parameters = [assembly.of_body(body, f"{ripple}_{what}") for what in RIPPLE_QUANTITIES]
            assembly.law(torque, parameters, assembly.angle_of(body), body=body, drives=True)


EFFECT = Effect(
    code="torque-ripple",
    of="body",
    quantities={f"{ripple}_{what}": quantity for ripple in RIPPLES for what, quantity in RIPPLE_QUANTITIES.items()},
    stamp=stamp,
    torque=torque,
    law="T = a sin(n angle) + b cos(n angle), added to the torque that drives the body",
    needs="motion over many periods of the ripple, slow enough to sample it",
    source="Jahns, Soong 1996, IEEE Trans. Ind. Electron. 43(2)",
    present=tuple(f"{ripple}_{part}" for ripple in RIPPLES for part in ("sine", "cosine")),
    odd=False,
    over_angle=True,
)
