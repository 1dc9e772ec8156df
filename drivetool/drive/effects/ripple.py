"""Torque ripple of the motor: a torque that repeats with its angle."""

from math import cos, sin

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


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
    """At the body's own angle: that of the motor, where the tool looks for it."""
    if assembly.acts(body, "ripple_sine") or assembly.acts(body, "ripple_cosine"):
        parameters = [assembly.of_body(body, s) for s in ("ripple_sine", "ripple_cosine", "ripple_order")]
        assembly.law("ripple", parameters, assembly.angle_of(body), body=body)


EFFECT = Effect(
    code="torque-ripple",
    of="body",
    quantities={
        "ripple_sine": Quantity("{T}", "torque ripple, sine of the angle", (-1e12, 1e12), 1e-3, 0.0),
        "ripple_cosine": Quantity("{T}", "torque ripple, cosine of the angle", (-1e12, 1e12), 1e-3, 0.0),
        "ripple_order": Quantity("1/{q}", "order of the ripple: periods in 2 pi", (1e-6, 1e6), 1e-3, 1.0),
    },
    stamp=stamp,
    law="T = a sin(n angle) + b cos(n angle), added to the torque that drives the body",
    needs="motion over many periods of the ripple, slow enough to sample it",
    source="Jahns, Soong 1996, IEEE Trans. Ind. Electron. 43(2)",
    present=("ripple_sine", "ripple_cosine"),
    odd=False,
)
