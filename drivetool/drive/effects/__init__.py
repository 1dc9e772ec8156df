"""The catalogue: every effect, in the order in which they are stamped."""

from drivetool.drive.effects import (
    backlash,
    converter,
    coulomb,
    dead_time,
    idle_torque,
    inertia,
    shaft,
    viscous,
)
from drivetool.drive.effects.effect import Effect

EFFECTS: tuple[Effect, ...] = (
    inertia.EFFECT,
    viscous.EFFECT,
    coulomb.EFFECT,
    idle_torque.EFFECT,
    shaft.EFFECT,
    backlash.EFFECT,
    converter.EFFECT,
    dead_time.EFFECT,
)

__all__ = ["EFFECTS", "Effect"]
