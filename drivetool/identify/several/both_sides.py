"""Parameters of one drive by two files, identified from its two ends: names, values and differences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from drivetool.drive import GEAR_RATIO_EXPONENTS, TOTALS, Drive
from drivetool.drive.effects import load_step
from drivetool.identify.estimate import Covariance
from drivetool.identify.several.sections import SwapLineSection
from drivetool.quantity import name_of, parse_name, record_of

# Joint standard deviations from which on a parameter differs: by chance one of 370 does.
MIN_SIGNIFICANT_RATIO = 3.0
FILE_ROUNDING = 1e-8  # relative difference below which two values are one: ten digits are written

OTHER_MOTOR = "belongs to the converter or sensor of one motor; the two files have different motors"
DIFFERENT_LOADS = "the anti-resonance is that of the load, and the two files have different loads"
ONE_RECORD = "of one recording alone"
PHASE = "it depends on where the recording's angle is zero"
EQUAL = "the same value in both files, not fitted in both: no comparison"
COPIED_VALUE = "the same value and interval in both files, so from one source: no independent comparison"


@dataclass(frozen=True)
class Figure:
    """A value in `unit`; std: None where there is none, and then `reason` may say why."""

    value: float
    unit: str
    std: float | None = None
    reason: str = ""


@dataclass(frozen=True)
class Side:
    """Estimate of a drive from one of its motors.

    name        of the file
    drive       with its values
    reasons     parameter -> why it has no interval
    covariance  of the parameters that have one; None: none has
    derived     name -> figure that follows from the parameters
    """

    name: str
    drive: Drive
    reasons: Mapping[str, str] = field(default_factory=dict)
    covariance: Covariance | None = None
    derived: Mapping[str, Figure] = field(default_factory=dict)

    def figures(self) -> dict[str, Figure]:
        """Every parameter that has a value."""
        known = self.covariance
        stds = {} if known is None else dict(zip(known.names, np.sqrt(np.diag(known.matrix)), strict=True))
        return {n: Figure(v, self.drive.unit(n), float(stds[n]) if n in stds else None, self.reasons.get(n, ""))
                for n, v in self.drive.values.items()}


def counterpart(name: str, first: Drive, second: Drive) -> tuple[str, float]:
    """(name in the second drive, factor that refers its value to the first one); no name for what it lacks.

    A shaft's torque and twist are those behind its gear: behind one of ratio n its stiffness is n^2 times that in
    front of it. Sums are referred to the motor. Parameters of a body are not referred.
    """
    owner, suffix, _ = parse_name(name)
    if record_of(name) or owner in ("converter", "sensor"):
        return "", 1.0
    if owner in first.bodies:
        return name_of(second.bodies[-1 - first.bodies.index(owner)], suffix), 1.0
    if owner in first.shafts:
        other = second.shafts[-1 - first.shafts.index(owner)]
        ratio, quantity = second.value(name_of(other, "ratio")) or 1.0, first.quantity(name)
        if suffix == "ratio":
            return name_of(other, "ratio"), ratio**-2.0  # of n and 1/n
        return name_of(other, suffix), quantity.size(1.0 / ratio, ratio) / quantity.scale
    return name, second.gear_ratios()[-1] ** GEAR_RATIO_EXPONENTS[TOTALS[name]] if name in TOTALS else 1.0


def swap_lines(first: Side, second: Side) -> Iterator[SwapLineSection]:
    """Every parameter that one of the files has, in the order of the first drive."""
    mine, its, taken = first.figures(), second.figures(), set()
    for name in first.drive.quantities:
        other, factor = counterpart(name, first.drive, second.drive)
        taken.add(other)
        if name in mine or other in its:
            why_not = _why_not_compared(name)
            yield swap_line(name, other, factor, mine.get(name), its.get(other), first.name, second.name, why_not)
    for name in its:
        if name not in taken:
            yield swap_line("", name, 1.0, None, its[name], first.name, second.name, _why_not_compared(name))


def _why_not_compared(name: str) -> str:
    """Why a parameter of two recordings is not one of the drive; empty if it is."""
    owner, suffix, _ = parse_name(name)
    if record_of(name) or suffix in (*load_step.STEP_TORQUES, *load_step.STEP_TIMES,
                                               *load_step.STEP_RECORDS):
        return ONE_RECORD
    if owner in ("converter", "sensor"):
        return OTHER_MOTOR
    return PHASE if suffix.endswith(("_sine", "_cosine")) else ""


def derived_swap_lines(first: Side, second: Side) -> Iterator[SwapLineSection]:
    """Figures of both files that follow from the parameters; resonances are those of the whole drive.

    A sum of parameters is compared with that of their counterparts.
    """
    others = {name: _figure_counterpart(name, first.drive, second.drive) for name in first.derived}
    taken = [other for other, _ in others.values()]
    others |= {name: (name, 1.0) for name in second.derived if name not in taken}
    for name, (other, factor) in others.items():
        notch = DIFFERENT_LOADS if name.startswith("anti_resonance") else ""
        yield swap_line(name, other, factor, first.derived.get(name), second.derived.get(other), first.name,
                        second.name, notch)


def _figure_counterpart(name: str, first: Drive, second: Drive) -> tuple[str, float]:
    """The same as `counterpart`, of a figure that follows from the parameters."""
    if "." not in name:
        return name, second.gear_ratios()[-1] ** 2.0 if name.startswith("total_inertia") else 1.0
    words = [counterpart(word, first, second) if "." in word else (word, 1.0) for word in name.split()]
    return " ".join(word for word, _ in words), words[0][1]


def swap_line(name: str, other: str, factor: float, mine: Figure | None, its: Figure | None, first: str,
              second: str,
              why_not: str = "") -> SwapLineSection:
    """One figure on both sides.

    factor         of the second value
    mine, its      None where a file has none
    first, second  names of the files, for the reason
    why_not        why the two are not compared, if they are not
    """
    one, two = mine or Figure(np.nan, ""), its or Figure(np.nan, "")
    values = (None if mine is None else one.value, None if its is None else two.value * factor)
    stds = (one.std, None if two.std is None else two.std * factor)
    line = SwapLineSection(name, other, one.unit if mine else two.unit, factor, values, stds, None, None, None,
                           False,
                           why_not)
    if why_not:
        return line
    if mine is None or its is None:
        return line.replace(reason=f"only in {second if mine is None else first}")
    if one.unit != two.unit:
        return line.replace(reason=f"in {one.unit} and in {two.unit}", values=(one.value, None),
                            stds=(one.std, None))
    change = two.value * factor - one.value
    line = line.replace(difference=change)
    equal = abs(change) <= FILE_ROUNDING * abs(one.value)
    if stds[0] is None or stds[1] is None:
        if equal:
            return line.replace(reason=EQUAL)
        unidentified = [f"no interval in {file}{f': {figure.reason}' if figure.reason else ''}"
                        for file, figure in ((first, one), (second, two)) if figure.std is None]
        return line.replace(reason="; ".join(unidentified))
    if equal and abs(stds[0] - stds[1]) <= FILE_ROUNDING * stds[0]:
        return line.replace(reason=COPIED_VALUE)
    std = float(np.hypot(*stds))
    return line.replace(std=std, ratio=change / std, differs=abs(change / std) > MIN_SIGNIFICANT_RATIO)
