"""Channels that are not what they are taken for, as the drive itself shows.

A unit that is wrong throughout puts all inertias and stiffnesses off by one factor, a torque upside down makes
the sum of the inertias negative, and with channels exchanged everything is off by orders of magnitude.
"""

from __future__ import annotations

import numpy as np

from drivetool.drive import Drive
from drivetool.errors import Finding
from drivetool.identify.setup import Task
from drivetool.identify.starts import KNOWN, totals

FAR = 3.0  # by which start values are never off all together
ALIKE = 1.8  # between the factors of two parameters, which start values may be off by
NEAR = 1.4  # to a factor of a unit
ABSURD = 10.0  # by which no start value of a drive that somebody knows is off
SURE = 0.1  # relative std of a negative inertia that is believed
SIZES = (".inertia", ".stiffness")
# What was logged over what it was taken for.
UNITS = (
    (60.0 / (2.0 * np.pi), "a speed in", "rpm", "rad/s"), (180.0 / np.pi, "a motion in", "degrees", "rad"),
    (1.0 / (2.0 * np.pi), "a motion in", "turns", "rad"),
    (1000.0, "a motion in", "mm", "m"), (1000.0, "a torque in", "kNm", "Nm"), (1e-3, "a torque in", "mNm", "Nm"))


def doubted_channels(start: Task, after: Drive, explained: bool = False) -> list[Finding]:
    """What to say where the drive has a negative inertia, or one off its start by a large factor.

    start  the task with its start values; after: the fitted drive, which counts where the record itself does not
           tell the sum of the inertias, or where it is `explained`: what the record tells at once has in it the
           laws that the drive lacks
    """
    told = _of_record(start)
    if told is not None and told < 0.0:
        return [Finding(
            "warning", "sign-doubted",
            "By its records the drive slows down under the torque that should drive it: torque and motion count "
            "in opposite directions.",
            {"factor": told}, "Turn one of them round in the channel map, with sign: -1.")]
    if explained and start.drive.referred_inertia > 0.0:
        factor = after.referred_inertia / start.drive.referred_inertia
    else:
        factor = told or _of_fit(start, after)
    return [] if factor is None else doubted_units(factor)


def doubted_units(factor: float) -> list[Finding]:
    """What to say of a drive whose inertias are all off what they were said to be by a factor."""
    if 1.0 / FAR < factor < FAR:
        return []
    both = [pair for size, what, one, other in UNITS for pair in (
        (size, f"{what} {one} taken for {other}"), (1.0 / size, f"{what} {other} taken for {one}"))]
    known = {text: abs(np.log(factor * size)) for size, text in both}
    such = [text for text, off in known.items() if off < min(np.log(NEAR), 1.01 * min(known.values()))]
    such = f", as {' or '.join(such)} would make it" if such else ""
    return [Finding(
        "warning", "unit-doubted",
        f"By its records the drive has {factor:.2g} times the inertia that it starts with{such}.",
        {"factor": factor}, "Check the units of torque and motion in the channel map, or the start values.")]


def _of_record(start: Task) -> float | None:
    """Sum of the inertias by the slow motion over that of the start; None where it is not told.

    A negative one has to be clear, and as large as an inertia is: closed loops bend what is small.
    """
    found = totals(start)
    value, std = found["inertia"] if found else (0.0, np.inf)
    given = start.drive.referred_inertia
    if given <= 0.0 or (value < 0.0 and value * FAR > -given):
        return None
    return value / given if std < (KNOWN * value if value > 0.0 else -SURE * value) else None


def _of_fit(start: Task, after: Drive) -> float | None:
    """Common factor of all fitted inertias and stiffnesses; None where they left their starts by several.

    Where all are absurd, the least absurd of their factors.
    """
    before = start.drive
    ratios = np.array([after.value(n) / before.value(n) for n in start.free
                       if n.endswith(SIZES) and (before.value(n) or 0.0) > 0.0 and (after.value(n) or 0.0) > 0.0])
    if len(ratios) < 2:
        return None
    if ratios.max() < ALIKE * ratios.min():
        return float(np.exp(np.mean(np.log(ratios))))
    if ratios.min() > ABSURD:
        return float(ratios.min())
    return float(ratios.max()) if ratios.max() < 1.0 / ABSURD else None
