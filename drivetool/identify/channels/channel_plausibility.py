"""Channels with a suspect sign, unit or role, judging by the inertias they imply.

A unit that is wrong throughout changes all inertias and stiffnesses by one factor, a torque of the wrong sign makes
the sum of the inertias negative, and with channels exchanged everything is off by orders of magnitude.
"""

from __future__ import annotations

import numpy as np

from drivetool.drive import Drive
from drivetool.finding import Finding
from drivetool.identify.setup import Task
from drivetool.identify.starts import MAX_RELATIVE_STD, regressed_totals
from drivetool.quantity import quantity_of

# Common factor of all parameters to their start values. A choice: start values are not all wrong by as much.
MAX_COMMON_FACTOR = 3.0
# Ratio of the factors of two parameters. A choice: start values of one drive differ by it among themselves.
MAX_FACTOR_RATIO = 1.8
# Ratio to the factor of a unit. A choice: the error of a start value; the units differ by more.
UNIT_FACTOR_TOLERANCE = 1.4
ABSURD_FACTOR = 10.0  # factor to a start value. A choice: no start value of a known drive is that wrong
# Relative std below which a negative inertia counts: ten standard deviations from zero.
MAX_NEGATIVE_RELATIVE_STD = 0.1
FACTOR_QUANTITIES = ("inertia", "stiffness")
# What was logged over what it was taken for.
UNITS = (
    (60.0 / (2.0 * np.pi), "a speed in", "rpm", "rad/s"), (180.0 / np.pi, "a motion in", "degrees", "rad"),
    (1.0 / (2.0 * np.pi), "a motion in", "turns", "rad"),
    (1000.0, "a motion in", "mm", "m"), (1000.0, "a torque in", "kNm", "Nm"), (1e-3, "a torque in", "mNm", "Nm"))


def suspect_channel_findings(start: Task, after: Drive, explained: bool = False) -> list[Finding]:
    """Findings where the drive has a negative inertia, or one that differs from its start by a large factor.

    start  the task with its start values; after: the fitted drive, used where the record itself does not identify
           the sum of the inertias, or where the fit is `explained`: a direct regression of the record is biased by
           the laws that the drive lacks
    """
    inertia_ratio = _inertia_ratio_of_record(start)
    if inertia_ratio is not None and inertia_ratio < 0.0:
        return [Finding(
            "warning", "suspect-sign",
            "In the records the drive decelerates under the torque that should accelerate it: torque and "
            "motion have opposite sign conventions.",
            {"factor": inertia_ratio}, "Invert one of them in the channel map, with sign: -1.")]
    if explained and start.drive.referred_inertia > 0.0:
        factor = after.referred_inertia / start.drive.referred_inertia
    else:
        factor = inertia_ratio or _common_factor_of_fit(start, after)
    return [] if factor is None else suspect_unit_findings(factor)


def suspect_unit_findings(factor: float) -> list[Finding]:
    """Findings where all inertias of a drive differ from their given values by one factor."""
    if 1.0 / MAX_COMMON_FACTOR < factor < MAX_COMMON_FACTOR:
        return []
    both = [pair for size, what, one, other in UNITS for pair in (
        (size, f"{what} {one} taken for {other}"), (1.0 / size, f"{what} {other} taken for {one}"))]
    distances = {text: abs(np.log(factor * size)) for size, text in both}
    likely = [text for text, off in distances.items()
              if off < min(np.log(UNIT_FACTOR_TOLERANCE), 1.01 * min(distances.values()))]
    likely = f"; a possible cause is {' or '.join(likely)}" if likely else ""
    return [Finding(
        "warning", "suspect-unit",
        f"The inertia estimated from the records is {factor:.2g} times its start value{likely}.",
        {"factor": factor}, "Check the units of torque and motion in the channel map, or the start values.")]


def _inertia_ratio_of_record(start: Task) -> float | None:
    """Sum of the inertias by the slow motion over that of the start; None where it is not identifiable.

    A negative one has to be significant, and as large as an inertia is: closed loops bias a small one.
    """
    found = regressed_totals(start)
    value, std = found["inertia"] if found else (0.0, np.inf)
    given = start.drive.referred_inertia
    if given <= 0.0 or (value < 0.0 and value * MAX_COMMON_FACTOR > -given):
        return None
    return value / given if std < (MAX_RELATIVE_STD * value if value > 0.0
                                   else -MAX_NEGATIVE_RELATIVE_STD * value) else None


def _common_factor_of_fit(start: Task, after: Drive) -> float | None:
    """Common factor of all fitted inertias and stiffnesses; None where their factors differ.

    Where all are absurd, the least absurd of their factors.
    """
    before = start.drive
    ratios = np.array([after.value(n) / before.value(n) for n in start.free
                       if quantity_of(n) in FACTOR_QUANTITIES
                       and (before.value(n) or 0.0) > 0.0 and (after.value(n) or 0.0) > 0.0])
    if len(ratios) < 2:
        return None
    if ratios.max() < MAX_FACTOR_RATIO * ratios.min():
        return float(np.exp(np.mean(np.log(ratios))))
    if ratios.min() > ABSURD_FACTOR:
        return float(ratios.min())
    return float(ratios.max()) if ratios.max() < 1.0 / ABSURD_FACTOR else None
