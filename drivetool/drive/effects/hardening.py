"""Hardening: a shaft that gets stiffer the further it is twisted."""

from math import log

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def torque(twist, _, time, side, p, out):
    """ks h twist (|twist|/r)^n; ks h, r, n = p[0..2]."""
    size = abs(twist)
    if size == 0.0:
        return
    ratio = size / p[1, 0]
    share = twist * ratio ** p[2, 0]
    out[0] = p[0, 0] * share
    out[1] = (1.0 + p[2, 0]) * out[0] / twist
    out[3] = share
    out[4] = -p[2, 0] * out[0] / p[1, 0]
    out[5] = out[0] * log(ratio)


def stamp(assembly, shaft):
    """Added to the linear stiffness; in a shaft with a gap over the twist beyond the gap."""
    extra = assembly.of_shaft(shaft, "stiffness") * assembly.of_shaft(shaft, "hardening")
    rest = [assembly.of_shaft(shaft, s) for s in ("hardening_twist", "hardening_power")]
    assembly.law(torque, [extra, *rest], assembly.twist(shaft), shaft=shaft)


EFFECT = Effect(
    code="hardening-stiffness",
    of="shaft",
    quantities={
        "hardening": Quantity("", "share by which the shaft torque is higher at the hardening twist",
                              (-0.99, 1e6), 1e-3, 0.0),
        "hardening_twist": Quantity("{q}", "hardening twist", (1e-12, 1e6), 1e-6, 1.0),
        "hardening_power": Quantity("", "power of the hardening; 2 is cubic", (0.1, 10.0), 0.1, 2.0),
    },
    stamp=stamp,
    torque=torque,
    law="Ts = ks twist (1 + h (|twist|/r)^n)",
    needs="torque levels from small to rated: the resonance rises with the preload",
    source="Nayfeh, Mook 1979, Nonlinear Oscillations; Duffing 1918",
    present=("hardening",),
)
