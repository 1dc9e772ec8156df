"""A unit that is wrong throughout: all inertias and stiffnesses come out off by one factor."""

from __future__ import annotations

import numpy as np

from drivetool.drive.chain import Drive
from drivetool.errors import Finding
from drivetool.identify.rough import KNOWN, totals
from drivetool.identify.task import Task

FAR = 3.0  # by which start values are never off all together
ALIKE = 1.8  # between the factors of two parameters, which start values may be off by
NEAR = 1.4  # to a factor of a unit
SIZES = (".inertia", ".stiffness")
# What was logged over what it was taken for.
UNITS = (
    (60.0 / (2.0 * np.pi), "a speed in rpm taken for rad/s"), (180.0 / np.pi, "a motion in degrees taken for rad"),
    (1.0 / (2.0 * np.pi), "a motion in turns taken for rad"),
    (1000.0, "a motion in mm taken for m, or a torque in kNm for Nm"), (1e-3, "a torque in mNm taken for Nm"))


def doubted_unit(start: Task, after: Drive) -> list[Finding]:
    """What to say where the drive is heavier or lighter than it was said to be by a large factor.

    start  the task with its start values; after: the fitted drive, which counts where the record itself does not
           tell the sum of the inertias
    """
    factor = _of_record(start) or _of_fit(start, after)
    if factor is None or 1.0 / FAR < factor < FAR:
        return []
    known = [text for size, text in UNITS if 1.0 / NEAR < factor * size < NEAR]
    such = f", as {known[0]} would make it" if known else ""
    return [Finding(
        "warning", "unit-doubted",
        f"By its records the drive has {factor:.2g} times the inertia that it starts with{such}.",
        {"factor": factor}, "Check the units of torque and motion in the channel map, or the start values.")]


def _of_record(start: Task) -> float | None:
    """Sum of the inertias by the slow motion over that of the start; None where it is not told."""
    found = totals(start)
    value, std = found["inertia"] if found else (0.0, np.inf)
    given = sum(start.drive.value(f"{b}.inertia") or 0.0 for b in start.drive.bodies)
    return value / given if std < KNOWN * value and given > 0.0 else None


def _of_fit(start: Task, after: Drive) -> float | None:
    """Common factor of all fitted inertias and stiffnesses; None where they left their starts by several."""
    before = start.drive
    ratios = np.array([after.value(n) / before.value(n) for n in start.free
                       if n.endswith(SIZES) and (before.value(n) or 0.0) > 0.0 and (after.value(n) or 0.0) > 0.0])
    alike = len(ratios) > 1 and ratios.max() < ALIKE * ratios.min()
    return float(np.exp(np.mean(np.log(ratios)))) if alike else None
