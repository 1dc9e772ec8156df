"""The drive: a chain of bodies joined by shafts, and the values of its parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import accumulate
from operator import mul
from types import MappingProxyType
from typing import Literal, TypeVar

from drivetool.drive.dual import Dual
from drivetool.drive.effects import EFFECTS, GEAR_RATIO_EXPONENTS, OPTIONAL_SUFFIXES, TOTAL_RULES, TOTALS, Effect
from drivetool.errors import BadParameters, nearest
from drivetool.quantity import Quantity, name_of, names_of, owner_of, quantity_of, record_of, shared

KNOWN_TORQUE = Quantity("{T}", "factor of a known torque", (-1e12, 1e12), 1e-2, 0.0)
END_MASS = "tip"  # a body behind the load that diagnose has added: the load's sensors and names stay with the load
Number = TypeVar("Number", float, Dual)

DampingLaw = Literal["inside", "always", "contact"]


@dataclass(frozen=True)
class Drive:
    """A chain of inertias and the effects that act on them.

    name         for example two-mass
    bodies       from the motor outwards; shafts joins neighbours, one fewer than bodies
    values       parameter name -> value in the units of `unit(name)`; a missing one is neutral, or
                 unknown if the effect has no neutral value
    damping_law  "inside": the shaft damping is part of the contact, which then never pulls
                 (Tallfors 2005, 5.17); "always": it acts in the gap too (chapter 6); "contact": likewise in contact
                 only, but in the gap the shaft relaxes, and touches at the half gap (Nordin, Galic, Gutman 1997)
    known_torques  names like motor.law1 of inputs that brake a body; each is also a parameter, its factor
    records      recording -> sha256, of which some parameters have a value of their own, NAME@RECORD
    input_unit   of the motors' inputs, A, V or %, if torque constants convert them to torques; else empty
    constants    torque constants by which the inputs of recordings in that unit were multiplied; `values` has those
                 that may differ
    """

    name: str
    bodies: tuple[str, ...]
    shafts: tuple[str, ...]
    values: Mapping[str, float] = field(default_factory=dict)
    torque_unit: str = "Nm"
    motion_unit: str = "rad"
    damping_law: DampingLaw = "inside"
    known_torques: tuple[str, ...] = ()
    records: Mapping[str, str] = field(default_factory=dict)
    input_unit: str = ""
    constants: Mapping[str, float] = field(default_factory=dict)

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """Every parameter this chain can have, in a fixed order, each followed by those of single recordings."""
        own = tuple(n for n in self.values if record_of(n)) if self.records else ()
        return _quantities(self.bodies, self.shafts, self.known_torques, own)

    def effects(self) -> tuple[tuple[Effect, str, int], ...]:
        """(effect, owner, index of the owner) for every effect that can act on this drive."""
        return _effects(self.bodies, self.shafts)

    def quantity(self, name: str) -> Quantity:
        """The kind of a parameter; BadParameters suggests the nearest name."""
        kind, record = shared(name), record_of(name)
        if record and record not in self.records:
            raise BadParameters("a recording that has parameters of its own", f"'{record}' in {name}",
                                "Declare it with --record, or name it under records.", tuple(self.records))
        try:
            return _quantities(self.bodies, self.shafts, self.known_torques, ())[kind]
        except KeyError:
            raise BadParameters(
                f"a parameter of the {self.name} drive", f"'{name}'",
                nearest(name, self.quantities)) from None

    def unit(self, name: str) -> str:
        """The unit of a parameter, in words."""
        return self.quantity(name).unit_for(self.torque_unit, self.motion_unit, self.input_unit or "A")

    def value(self, name: str) -> float | None:
        """The value, the neutral value, or None if it is not known."""
        return self.values.get(name, self.quantity(name).neutral)

    @property
    def load(self) -> str:
        """The body that recordings call the load: the last, or the one before an end mass of diagnose."""
        return self.bodies[-2 if self.bodies[-1] == END_MASS else -1]

    def gear_ratios(self) -> list[float]:
        """(n,) gear ratios: turns of the motor per turn of each body."""
        ratios = [self.value(name_of(shaft, "ratio")) for shaft in self.shafts]
        return list(accumulate([1.0, *ratios], mul))

    def inertias(self) -> list[float]:
        """(n,) inertia of each body with added inertia and carried mass; an unknown one is zero."""
        return [mass_of(lambda suffix, b=b: self.value(name_of(b, suffix)) or 0.0) for b in self.bodies]

    @property
    def referred_inertia(self) -> float:
        """Inertia of all bodies referred to the motor: behind a reduction n it counts 1/n^2."""
        return float(sum(j / n**2 for j, n in zip(self.inertias(), self.gear_ratios(), strict=True)))

    def referred_to_motor(self, suffix: str, bodies: Iterable[str] | None = None) -> float:
        """Sum of a friction parameter over the bodies, referred to the motor; an unknown one counts as zero."""
        names = names_of(self.bodies if bodies is None else bodies, suffix)
        return float(sum((self.value(n) or 0.0) * self.referred_share(n) for n in names))

    def referred_share(self, name: str) -> float:
        """Factor that refers a body's friction parameter to the motor."""
        body = self.bodies.index(owner_of(name))
        return self.gear_ratios()[body] ** -GEAR_RATIO_EXPONENTS[quantity_of(name)]

    def parts(self, total: str, whole: float) -> dict[str, float]:
        """The bodies' own parameters if a sum is distributed by the rule of its effect."""
        names, each = names_of(self.bodies, TOTALS[total]), body_shares(
            TOTALS[total], self.inertias(), self.gear_ratios())
        return {n: whole * s for n, s in zip(names, each, strict=True)}

    def known_value(self, name: str) -> float | None:
        """The value; else a body's part by rule if only the sum is known; else the neutral value, or None."""
        for total, suffix in TOTALS.items():
            if total in self.values and name not in self.values and quantity_of(name) == suffix:
                return self.parts(total, self.values[total])[name]
        return self.value(name)

    def with_values(self, values: Mapping[str, float]) -> Drive:
        """The drive with some values replaced; a total and its parts displace each other."""
        merged = dict(self.values)
        for name, value in values.items():
            (low, high), choice = self.quantity(name).bounds, self.quantity(name).choice
            if choice and value not in choice:
                raise BadParameters(f"{name} of {' or '.join(f'{v:g}' for v in choice)}", f"{value:g}",
                                    "Correct it.")
            if not low <= value <= high:
                raise BadParameters(
                    f"{name} between {low:g} and {high:g} {self.unit(name)}",
                    f"{value:g}", "Correct the value in the parameter file or after --set.")
        for total, suffix in TOTALS.items():
            parts = names_of(self.bodies, suffix)
            if total in values:
                for part in parts:
                    merged.pop(part, None)
            elif any(part in values for part in parts):
                merged.pop(total, None)
        merged.update(values)
        order = {name: i for i, name in enumerate(replace(self, values=merged).quantities)}
        return replace(self, values={k: merged[k] for k in sorted(merged, key=order.__getitem__)})

    def missing(self) -> list[str]:
        """Parameters without which the drive cannot be simulated."""
        return [n for n, q in self.quantities.items()
                if q.neutral is None and n not in self.values and quantity_of(n) not in OPTIONAL_SUFFIXES]

    def require(self, names: Iterable[str], why: str) -> None:
        """Raise BadParameters unless all the names have a value."""
        missing = [n for n in names if self.value(n) is None]
        if missing:
            raise BadParameters(
                f"values of {', '.join(missing)} for {why}",
                f"only {', '.join(self.values)}" if self.values else "none",
                "Run the step before this one and pass its file with --params, or use --set.")


# Cached, for every trial point of a fit is a new drive of the same bodies and shafts.
@cache
def _effects(bodies: tuple[str, ...], shafts: tuple[str, ...]) -> tuple[tuple[Effect, str, int], ...]:
    owners = {"body": bodies, "shaft": shafts, "motor": bodies[:1], "path": ("converter",), "sensor": ("sensor",),
              "friction": ("friction",)}
    return tuple((effect, owner, index) for effect in EFFECTS for index, owner in enumerate(owners[effect.of]))


@cache
def _quantities(bodies: tuple[str, ...], shafts: tuple[str, ...], known_torques: tuple[str, ...],
                own: tuple[str, ...]) -> Mapping[str, Quantity]:
    found = {name_of(owner, suffix): quantity for effect, owner, _ in _effects(bodies, shafts)
             for suffix, quantity in effect.quantities.items()}
    for total, suffix in TOTALS.items():
        found[total] = found[name_of(bodies[0], suffix)]
    found |= dict.fromkeys(known_torques, KNOWN_TORQUE)
    if own:
        found = {n: quantity for name, quantity in found.items()
                 for n in (name, *sorted(o for o in own if shared(o) == name))}
    return MappingProxyType(found)


def mass_of(value: Callable[[str], Number]) -> Number:
    """What the torques of a body accelerate: the parts of all effects.

    value  suffix -> value of the body's parameter
    """
    first, *more = (effect.mass(value) for effect in EFFECTS if effect.mass is not None)
    return sum(more, first)


def body_shares(suffix: str, masses: Sequence[Number], ratios: Sequence[Number]) -> list[Number]:
    """(n,) each body's own parameter for a sum of one, referred to the motor.

    masses  (n,) inertias of the bodies
    ratios  (n,) gear ratios: turns of the motor per turn of each body
    """
    if TOTAL_RULES[suffix] == "last":
        return [0.0 * ratios[0]] * (len(ratios) - 1) + [1.0 * ratios[-1]]
    referred = [mass / n / n for mass, n in zip(masses, ratios, strict=True)]
    total = sum(referred[1:], referred[0])
    return [mass / total for mass in masses]


def one_body(torque_unit: str = "Nm", motion_unit: str = "rad", input_unit: str = "") -> Drive:
    """A single rotor or carriage."""
    return Drive("one-body", ("motor",), (), {}, torque_unit, motion_unit, input_unit=input_unit)


def two_mass(torque_unit: str = "Nm", motion_unit: str = "rad", input_unit: str = "") -> Drive:
    """Motor, shaft, load."""
    return Drive("two-mass", ("motor", "load"), ("shaft",), {}, torque_unit, motion_unit, input_unit=input_unit)


def three_mass(torque_unit: str = "Nm", motion_unit: str = "rad", input_unit: str = "") -> Drive:
    """Motor, gear, arm; the shafts are called shaft and shaft2."""
    return Drive("three-mass", ("motor", "gear", "arm"), ("shaft", "shaft2"), {},
                 torque_unit, motion_unit, input_unit=input_unit)


def vehicle(torque_unit: str = "Nm", motion_unit: str = "rad", input_unit: str = "") -> Drive:
    """Motor, drive shaft behind a gear (shaft.ratio), wheels that carry wheels.carried_mass at wheels.radius."""
    return Drive("vehicle", ("motor", "wheels"), ("shaft",), {}, torque_unit, motion_unit, input_unit=input_unit)


KNOWN_DRIVES = {"one-body": one_body, "two-mass": two_mass, "three-mass": three_mass, "vehicle": vehicle}
