"""Idle torque of a body: a constant torque that opposes positive motion."""

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity


def stamp(assembly, body):
    """-T0 on the body."""
    assembly.torque(body, assembly.constant, -assembly.of_body(body, "idle_torque"))


EFFECT = Effect(
    code="idle-torque",
    of="body",
    quantities={"idle_torque": Quantity("{T}", "idle torque", (-1e12, 1e12), 1e-2, 0.0)},
    stamp=stamp,
    law="T = T0",
    needs="a steady speed; an offset of the torque channel is the same, and so is Coulomb friction "
          "without a reversal",
    source="Tallfors 2005, (2.1)",
    present=("idle_torque",),
    referred={"idle_torque": 1},
    total={"idle_torque": "last"},  # where a rolling mill has most of it
    odd=False,
)
