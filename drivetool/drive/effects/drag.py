"""Quadratic drag: fans, churning oil, anything that throws a fluid about."""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def torque(w, _, time, side, p, out):
    """-c2 w |w|, c2 = p[0]."""
    out[0] = -p[0, 0] * w * abs(w)
    out[1] = -2.0 * p[0, 0] * abs(w)
    out[3] = -w * abs(w)


def stamp(assembly, body):
    """-c2 w |w| on the body."""
    assembly.law(torque, [assembly.of_body(body, "drag")], {assembly.speed(body): assembly.number(1.0)}, body=body)


EFFECT = Effect(
    code="quadratic-drag",
    of="body",
    quantities={"drag": Quantity("{T} s^2/{q}^2", "quadratic drag", (0.0, 1e12), 1e-3, 0.0)},
    stamp=stamp,
    torque=torque,
    law="T = c2 w |w|",
    needs="at least three speeds, one of them high; in one record it is confused with a drift",
    source="White, Fluid Mechanics, ch. 7",
    present=("drag",),
    friction=("drag",),
)
