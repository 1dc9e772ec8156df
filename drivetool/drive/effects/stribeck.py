"""Stribeck friction: breakaway takes more than sliding does, and the surplus fades with speed."""

from math import exp

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def torque(w, _, time, side, p, out):
    """-side Ts exp(-(w/ws)^2), Ts = p[0], ws = p[1]."""
    ratio = w / p[1, 0]
    share = -side * exp(-ratio * ratio)
    out[0] = p[0, 0] * share
    out[1] = -2.0 * ratio / p[1, 0] * out[0]
    out[3] = share
    out[4] = 2.0 * ratio * ratio / p[1, 0] * out[0]


def stamp(assembly, body):
    """The surplus while the body slides; it holds with Tc + Ts when it sticks."""
    if assembly.acts(body, "stribeck"):
        assembly.friction(body, assembly.number(0.0))
        parameters = [assembly.of_body(body, s) for s in ("stribeck", "stribeck_speed")]
        assembly.law("stribeck", parameters, {assembly.speed(body): assembly.number(1.0)}, body=body, slides=True)


EFFECT = Effect(
    code="stribeck",
    of="body",
    quantities={
        "stribeck": Quantity("{T}", "breakaway torque above Coulomb friction", (0.0, 1e12), 1e-3, 0.0),
        "stribeck_speed": Quantity("{q}/s", "Stribeck speed", (1e-6, 1e6), 1e-3, 1.0),
    },
    stamp=stamp,
    law="T = (Tc + Ts exp(-(w/ws)^2)) sgn(w); |T| <= Tc + Ts at w = 0",
    needs="many slow reversals: speeds of the order of the Stribeck speed",
    source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7)",
    present=("stribeck",),
    friction=("stribeck",),
)
