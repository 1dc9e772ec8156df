"""A unit that is wrong throughout: every inertia and every stiffness comes out off by one factor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive.chain import Drive
from drivetool.errors import Finding

FAR = 3.0  # by which start values are never off all together
ALIKE = 1.8  # between the factors of two parameters, which start values may be off by
NEAR = 1.4  # to a factor of a unit
SIZES = (".inertia", ".stiffness")
# What was logged over what it was taken for.
UNITS = (
    (60.0 / (2.0 * np.pi), "a speed in rpm taken for rad/s"), (180.0 / np.pi, "a motion in degrees taken for rad"),
    (1.0 / (2.0 * np.pi), "a motion in turns taken for rad"),
    (1000.0, "a motion in mm taken for m, or a torque in kNm for Nm"), (1e-3, "a torque in mNm taken for Nm"))


def doubted_unit(before: Drive, after: Drive, free: Sequence[str]) -> list[Finding]:
    """What to say where all inertias and stiffnesses that were fitted left their starts by one large factor."""
    ratios = np.array([after.value(n) / before.value(n) for n in free
                       if n.endswith(SIZES) and (before.value(n) or 0.0) > 0.0 and (after.value(n) or 0.0) > 0.0])
    if len(ratios) < 2 or ratios.max() > ALIKE * ratios.min():
        return []
    factor = float(np.exp(np.mean(np.log(ratios))))
    if 1.0 / FAR < factor < FAR:
        return []
    known = [text for size, text in UNITS if 1.0 / NEAR < factor * size < NEAR]
    such = f", as {known[0]} would make them" if known else ""
    return [Finding(
        "warning", "unit-doubted",
        f"All inertias and stiffnesses came out at {factor:.3g} of their start values{such}.",
        {"factor": factor}, "Check the units of torque and motion in the channel map, or the start values.")]
