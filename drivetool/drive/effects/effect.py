"""The form in which every physical effect declares itself, once, in its own file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from drivetool.quantity import Quantity

if TYPE_CHECKING:
    from drivetool.drive import Assembly


def _nothing(assembly: Assembly, index: int) -> None:
    """What an effect stamps that acts elsewhere; its file says where."""


@dataclass(frozen=True)
class Effect:
    """A physical effect of a drive.

    code        name in lists and findings
    of          what it belongs to: every body, every shaft, the motor, the torque path, the motor speed sensor,
                or the friction of all bodies together
    quantities  parameter suffix -> Quantity; `<owner>.<suffix>` is the parameter's name
    law         the equation, in the words of the field
    needs       what a record must contain to identify it
    source      literature
    stamp       adds the law to the equations where the effect acts; called with the assembly and the owner's
                index (0 for motor, path, sensor and friction)
    present     parameters that must differ from neutral for the effect to act; empty
                if it always acts
    odd         whether torque(-motion) = -torque(motion)
    friction    parameters that are friction, which `friction.factor` multiplies
    over_angle  whether the law takes the angle of a body, which is then a state whatever is measured
    """

    code: str
    of: Literal["body", "shaft", "motor", "path", "sensor", "friction"]
    quantities: Mapping[str, Quantity]
    law: str
    needs: str
    source: str
    stamp: Callable[[Assembly, int], None] = _nothing
    present: tuple[str, ...] = ()
    odd: bool = True
    friction: tuple[str, ...] = ()
    over_angle: bool = False
