"""A drive identified from both of its motors: the bodies of the second estimate exchanged, then compared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from drivetool.errors import BadParameters
from drivetool.finding import Finding
from drivetool.identify.estimate import PlotData
from drivetool.identify.several.both_sides import (
    MIN_SIGNIFICANT_RATIO,
    Side,
    derived_swap_lines,
    swap_lines,
)
from drivetool.identify.several.sections import SwapLineSection, SwapSection
from drivetool.quantity import ELECTRIC_UNITS, name_of

# Of the chi-square, as rare as one parameter beyond that.
SIDES_SIGNIFICANCE = float(2.0 * scipy.special.ndtr(-MIN_SIGNIFICANT_RATIO))
# Relative, to which two ratios are each other's reciprocal: one may be written as 0.333.
RECIPROCAL_TOLERANCE = 1e-3
# Eigenvalue of a correlation matrix below which it is rounding to the ten digits of a file.
MIN_CORRELATION_EIGENVALUE = 1e-8
MAX_LISTED_PARAMETERS = 3  # parameters that a sentence lists, a choice for readability


class Swap(SwapSection):
    """The comparison with what a file has elsewhere."""

    outcome: str = ""
    findings: tuple[Finding, ...] = ()
    exhibits: tuple[PlotData, ...] = ()


def swap(first: Side, second: Side) -> Swap:
    """Whether a drive is the same from both of its motors.

    first, second  of independent recordings; the last body of the first file is the motor of the second one
    returns        Swap
    raises         BadParameters: no shaft, other numbers of bodies, other units, laws of the gap that differ, or
                   gear ratios that are not known or not each other's reciprocal
    source         Wald test of equal parameters, Casella, Berger 2002, sec. 10.3
    """
    _check_same_drive(first, second)
    lines = list(swap_lines(first, second))
    derived = list(derived_swap_lines(first, second))
    compared = [line for line in lines if line.ratio is not None]
    chi_square, degrees = _chi_square(compared, first, second)
    p = float(scipy.stats.chi2.sf(chi_square, degrees)) if compared else None
    differ = [line for line in (*lines, *derived) if line.differs]
    agree = None if p is None else not differ and p >= SIDES_SIGNIFICANCE
    found = Swap(first.name, second.name, lines, derived, chi_square if compared else None, degrees, p, agree)
    found = found.replace(outcome=_swap_outcome_sentence(found, differ), exhibits=_ratio_plots(found))
    return found.replace(findings=tuple(_swap_findings(found, differ)))


def _check_same_drive(first: Side, second: Side) -> None:
    """Raise BadParameters unless both files can be of one drive."""
    one, other = first.drive, second.drive
    if not one.shafts or len(one.bodies) != len(other.bodies):
        raise BadParameters(
            "two files of one chain with a shaft, from its two ends",
            f"the bodies {', '.join(one.bodies)} in {first.name} and {', '.join(other.bodies)} in {second.name}",
            "Identify the same drive from both of its motors, with the same number of bodies.")
    for what, mine, its in (("torque", one.torque_unit, other.torque_unit),
                            ("motion", one.motion_unit, other.motion_unit)):
        if mine != its:
            raise BadParameters(f"one unit of {what} in both files",
                                f"{mine} in {first.name} and {its} in {second.name}",
                                "Write both channels in the same unit, by the channel map or a torque constant.")
    if one.torque_unit in ELECTRIC_UNITS:
        raise BadParameters("parameters in Nm or N: the inputs of two motors have no common unit otherwise",
                            f"{one.torque_unit} in {first.name} and {second.name}",
                            "Give each motor's torque constant, with --set motor.torque_constant=VALUE.")
    opens = any((d.value(name_of(s, what)) or 0.0) > 0.0 for d in (one, other) for s in d.shafts
                for what in ("half_gap", "gap_damping"))
    if opens and one.damping_law != other.damping_law:
        raise BadParameters("one damping_law of the gap in both files", f"{one.damping_law} in {first.name} and "
                            f"{other.damping_law} in {second.name}", "Fit both sides by the same law.")
    for mine, its in zip(one.shafts, reversed(other.shafts), strict=True):
        _check_reciprocal_ratios(name_of(mine, "ratio"), first, name_of(its, "ratio"), second)


def _check_reciprocal_ratios(mine: str, first: Side, its: str, second: Side) -> None:
    """Raise BadParameters unless the ratio of a shaft is known, and one over that of the other file."""
    for name, side in ((mine, first), (its, second)):
        if side.covariance is not None and name in side.covariance.names:
            raise BadParameters(f"a known {name}, by which the other side is converted",
                                f"a fitted one in {side.name}", "Hold the gear ratio.")
    one, other = first.drive.value(mine) or 1.0, second.drive.value(its) or 1.0
    if abs(one * other - 1.0) > RECIPROCAL_TOLERANCE:
        raise BadParameters(f"{its} of {1.0 / one:.6g} in {second.name}, the reciprocal of that in {first.name}",
                            f"{other:g}", "Correct the gear ratio of one of the two files, and fit it again.")


def _chi_square(lines: Sequence[SwapLineSection], first: Side, second: Side) -> tuple[float, int]:
    """(sum, degrees of freedom) of the differences over the sum of both covariances."""
    if not lines or first.covariance is None or second.covariance is None:
        return 0.0, 0
    factors = np.array([line.factor for line in lines])
    joint = first.covariance.part(line.first for line in lines).matrix
    joint = joint + second.covariance.part(line.second for line in lines).matrix * np.outer(factors, factors)
    stds = np.sqrt(np.diag(joint))
    sizes, directions = np.linalg.eigh(joint / np.outer(stds, stds))
    kept = sizes > MIN_CORRELATION_EIGENVALUE
    parts = directions[:, kept].T @ (np.array([line.difference for line in lines], float) / stds)
    return float(np.sum(parts**2 / sizes[kept])), int(np.count_nonzero(kept))


def _swap_outcome_sentence(found: Swap, differ: Sequence[SwapLineSection]) -> str:
    if found.p is None:
        return "No parameter has an interval in both files, so the two sides cannot be compared."
    test = f"chi-square {found.chi_square:.3g} of {found.degrees}, p {found.p:.2g}"
    if found.agree:
        return f"The estimates from the two motors agree: {test}."
    if not differ:
        return (f"The estimates from the two motors differ, although no single parameter differs by more than "
                f"{MIN_SIGNIFICANT_RATIO:g} joint standard deviations: {test}.")
    worst = sorted(differ, key=lambda line: -abs(line.ratio or 0.0))
    text = ", ".join(f"{line.first} ({_percent_change(line)}{line.ratio:+.2g} std)"
                     for line in worst[:MAX_LISTED_PARAMETERS])
    more = f" and {len(worst) - MAX_LISTED_PARAMETERS} more" if len(worst) > MAX_LISTED_PARAMETERS else ""
    return f"The estimates from the two motors differ in {text}{more}: {test}."


def _percent_change(line: SwapLineSection) -> str:
    """The difference in per cent of the first value, where there is one."""
    value, change = line.values[0], line.difference
    return f"{100.0 * change / abs(value):+.2g} %, " if value and change is not None else ""


def _swap_findings(found: Swap, differ: Sequence[SwapLineSection]) -> list[Finding]:
    if found.agree is None:
        return [Finding("warning", "sides-not-compared", found.outcome, {},
                        "Give the files that greybox, backlash or blackbox wrote, and free the same parameters.")]
    if found.agree:
        return []
    evidence = {"chi_square": float(found.chi_square or 0.0), "degrees": found.degrees, "p": float(found.p or 0.0)}
    return [Finding("warning", "parameters-differ", found.outcome,
                    evidence | {line.first: float(line.ratio or 0.0) for line in differ},
                    "Check sign, scale and clock of the torque channels; run diagnose on both recordings.")]


def _ratio_plots(found: Swap) -> tuple[PlotData, ...]:
    """Difference over joint std of every line that has one, the first on top."""
    lines = [line for line in (*found.lines, *found.derived) if line.ratio is not None]
    if not lines:
        return ()
    curves = {line.first: (np.array([line.ratio], float), np.array([float(-k)])) for k, line in enumerate(lines)}
    return (PlotData("ratios", f"{found.second} less {found.first}", "difference over joint standard deviation", "",
                    curves),)
