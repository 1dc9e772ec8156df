"""Kinds of parameters: unit, meaning, bounds, scale and the value without effect; their names."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

ELECTRIC_UNITS = ("A", "V", "%")  # units in which a motor's input may be logged; its torque constant converts it
RPM_PER_RAD_S = 30.0 / math.pi  # 60 s/min over 2 pi rad per revolution
RECORD_MARK = "@"  # NAME@RECORD is the value of NAME in that recording alone

# A chain is the same for Nm and rad, N and m, or A and rad; units follow from these two.
_SPELLING = {
    ("{T} s^2/{q}", "Nm", "rad"): "kg m^2",
    ("{T} s^2/{q}", "N", "m"): "kg",
    ("{T} s^2/{q}/m^2", "Nm", "rad"): "kg",
    ("{T}/{q}", "Nm", "rad"): "Nm/rad",
}


@dataclass(frozen=True)
class Quantity:
    """A kind of parameter.

    unit     template over {T} (torque unit: Nm or N, or that of the input), {q} (motion unit: rad or m) and {u}
             (unit of a motor's input: A, V or %)
    meaning  a few words for tables
    bounds   lowest and highest value that is physical, in the unit
    scale    a typical size in a record whose torque and speed are one, used where a value of zero gives none
    neutral  the value at which the effect is absent; None if it always acts
    choice   the allowed values, if it is a discrete choice that cannot be fitted
    """

    unit: str
    meaning: str
    bounds: tuple[float, float]
    scale: float
    neutral: float | None = None
    choice: tuple[float, ...] = ()

    def unit_for(self, torque_unit: str, motion_unit: str, input_unit: str = "A") -> str:
        """The unit in words, for example 'kg m^2' or 'A s^2/rad'."""
        special = _SPELLING.get((self.unit, torque_unit, motion_unit))
        return special or self.unit.format(T=torque_unit, q=motion_unit, u=input_unit)

    def size(self, torque: float, speed: float) -> float:
        """A typical size in a record with such a torque and speed: it changes with them as the unit says."""
        over, *under = self.unit.split("/")
        size = self.scale
        for symbol, each in (("{T}", torque), ("{q}", speed)):
            power = _power(symbol, over) - sum(_power(symbol, part) for part in under)
            size *= each**power
        return size


def _power(symbol: str, factor: str) -> int:
    """Power of a symbol in a product."""
    return 2 if f"{symbol}^2" in factor else int(symbol in factor)


class ParameterName(NamedTuple):
    """A parameter's name in its parts; text in files and as a key, `str(name)`.

    owner     the body, shaft or signal path that has it, or total
    quantity  what it is of it, as coulomb
    record    the recording in which it has a value of its own; empty: in all
    """

    owner: str
    quantity: str
    record: str = ""

    def __str__(self) -> str:
        """OWNER.QUANTITY or OWNER.QUANTITY@RECORD."""
        return f"{self.owner}.{self.quantity}{RECORD_MARK * bool(self.record)}{self.record}"


@cache
def parse_name(name: str) -> ParameterName:
    """The parts of a parameter's name."""
    shared, _, record = name.partition(RECORD_MARK)
    owner, _, quantity = shared.rpartition(".")
    return ParameterName(owner, quantity, record)


def name_of(owner: str, quantity: str, record: str = "") -> str:
    """The name of a parameter as text."""
    return str(ParameterName(owner, quantity, record))


def with_parts(name: str, **parts: str) -> str:
    """The name with another owner, quantity or record."""
    return str(parse_name(name)._replace(**parts))


def names_of(owners: Iterable[str], quantity: str) -> list[str]:
    """The names of one quantity of several bodies or shafts."""
    return [name_of(owner, quantity) for owner in owners]


def owner_of(name: str) -> str:
    """The body, shaft or signal path of a parameter."""
    return parse_name(name).owner


def quantity_of(name: str) -> str:
    """The quantity of a parameter, as coulomb."""
    return parse_name(name).quantity


def record_of(name: str) -> str:
    """The recording in which a parameter has a value of its own; empty: in all."""
    return parse_name(name).record


def shared(name: str) -> str:
    """The name of a parameter without the recording in which it has a value of its own."""
    return str(parse_name(name)._replace(record=""))
