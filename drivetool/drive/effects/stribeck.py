"""Stribeck friction: breakaway takes more torque than sliding, and the surplus decreases with speed."""

from math import exp, log

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def torque(w, _, time, side, p, out):
    """-side Ts exp(-(|w|/ws)^n); Ts, ws, n = p[0..2]."""
    ratio = abs(w) / p[1, 0]
    power = ratio ** p[2, 0]
    share = -side * exp(-power)
    out[0] = p[0, 0] * share
    out[3] = share
    if ratio == 0.0:
        return
    out[1] = -p[2, 0] * power / w * out[0]
    out[4] = p[2, 0] * power / p[1, 0] * out[0]
    out[5] = -power * log(ratio) * out[0]


def stamp(assembly, body):
    """The surplus while the body slides; a sticking body is held by up to Tc + Ts."""
    if (body, "stribeck") in assembly.replaced:
        return
    assembly.friction(body, assembly.number(0.0))
    parameters = [assembly.of_body(body, s) for s in ("stribeck", "stribeck_speed", "stribeck_power")]
    assembly.law(torque, parameters, {assembly.speed(body): assembly.number(1.0)}, body=body, slides=True)


EFFECT = Effect(
    code="stribeck",
    of="body",
    quantities={
        "stribeck": Quantity("{T}", "breakaway torque above Coulomb friction", (0.0, 1e12), 1e-3, 0.0),
        "stribeck_speed": Quantity("{q}/s", "Stribeck speed", (1e-6, 1e6), 1e-3, 1.0),
        "stribeck_power": Quantity("", "power by which the surplus fades with speed; 2 is a bell, 1 an exponential",
                                   (1.0, 4.0), 0.1, 2.0),
    },
    stamp=stamp,
    torque=torque,
    law="T = (Tc + Ts exp(-(|w|/ws)^n)) sgn(w); |T| <= Tc + Ts at w = 0",
    needs="many slow reversals: speeds of the order of the Stribeck speed",
    source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7)",
    present=("stribeck",),
    friction=("stribeck",),
)
