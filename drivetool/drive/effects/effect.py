"""The form in which every physical effect declares itself, once, in its own file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from drivetool.quantity import Quantity

# The assembly has no type here: it knows the effects through the catalogue.
Stamp = Callable[..., None]


def _nothing(assembly, index: int) -> None:
    """What an effect stamps that acts elsewhere; its file says where."""


def _no_states(assembly, index: int) -> tuple[str, ...]:
    return ()


@dataclass(frozen=True)
class Effect:
    """A physical effect of a drive.

    Its functions take the assembly and the index of the owner, 0 for motor, path, sensor and friction.

    code        name in lists and findings
    of          what it belongs to: every body, every shaft, the motor, the torque path, the motor speed sensor,
                or the friction of all bodies together
    quantities  parameter suffix -> Quantity; `<owner>.<suffix>` is the parameter's name
    law         the equation, in the words of the field
    needs       what a record must contain to identify it
    source      literature
    prepare     gives the assembly what other effects need for their stamps
    stamp       adds the law to the equations where the effect acts; raises ImpossibleValues where values contradict
                each other
    torque      its smooth law, which `stamp` adds by `Assembly.law`: (a, b, time, side, p, out) writes into out the
                torque, its derivatives over both arguments a and b, then those over its parameters p[:, 0]
    states      names of the states that it adds, none where it does not act
    start       start values of these states if nothing is known of them: over the drive, the owner's index, the
                speeds of the bodies, and role -> the first value of each input
    inputs      roles whose signals its stamp uses; any other input is a torque on a body
    mass        what it adds to the inertia of a body, over a function that gives the value of a suffix
    present     parameters that must differ from neutral for the effect to act; empty
                if it always acts
    odd         whether torque(-motion) = -torque(motion)
    friction    parameters that are friction, which `friction.factor` multiplies
    referred    parameter -> power of the gear ratio by which it is divided when it is referred to the motor
    total       parameter -> how the sum over all bodies, `total.<suffix>`, is distributed if it alone is known: in
                proportion to the inertias, or all to the last body
    required    whether a drive lacks the parameters that have no neutral value and are not given
    over_angle  whether the law takes the angle of a body, which is then a state whatever is measured
    """

    code: str
    of: Literal["body", "shaft", "motor", "path", "sensor", "friction"]
    quantities: Mapping[str, Quantity]
    law: str
    needs: str
    source: str
    prepare: Stamp = _nothing
    stamp: Stamp = _nothing
    torque: Callable[..., None] | None = None
    states: Callable[..., Sequence[str]] = _no_states
    start: Callable[..., Sequence[float]] | None = None
    inputs: tuple[str, ...] = ()
    mass: Callable | None = None
    present: tuple[str, ...] = ()
    odd: bool = True
    friction: tuple[str, ...] = ()
    referred: Mapping[str, int] = field(default_factory=dict)
    total: Mapping[str, Literal["inertia", "last"]] = field(default_factory=dict)
    required: bool = True
    over_angle: bool = False

    @property
    def has_states(self) -> bool:
        """Whether it adds states to a drive on which it acts."""
        return self.states is not _no_states
