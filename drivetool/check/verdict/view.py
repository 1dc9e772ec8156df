"""A record as the plots of a diagnosis show it: measured, and simulated before and after."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drivetool.check.validation import ModelRun


@dataclass(frozen=True)
class View:
    """One record measured and as simulated before and after; arrays (n,) on one increasing time.

    name       of the record
    time       [s]; `breaks`: index of the first sample of each free run
    measured   the first output; before, after: simulated by the base and by the extended drive
    torque     of the motor, logged
    speed      of the motor; angle: of the motor, or None
    shaft      simulated torque of the first shaft of the extended drive, None without a shaft
    output     role of the first output; units: of output, torque and motion
    """

    name: str
    time: np.ndarray
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    torque: np.ndarray
    speed: np.ndarray
    angle: np.ndarray | None
    shaft: np.ndarray | None
    breaks: tuple[int, ...]
    output: str
    units: tuple[str, str, str]

    @property
    def errors(self) -> dict[str, np.ndarray]:
        """Measured minus simulated, before and after."""
        return {"before": self.measured - self.before, "after": self.measured - self.after}

    @property
    def words(self) -> tuple[str, str, str]:
        """Output, torque and angle in words: a linear axis has a force and a position."""
        linear = self.units[2] == "m"
        output = self.output.replace("angle", "position").replace("torque", "force") if linear else self.output
        return output.replace("_", " "), "force" if linear else "torque", "position" if linear else "angle"

    def pieces(self) -> list[slice]:
        """The free runs."""
        edges = [*self.breaks, len(self.time)]
        return [slice(a, b) for a, b in pairwise(edges)]


def view_of(name: str, before: ModelRun, after: ModelRun) -> View:
    """The record from the runs of the base and of the extended drive over it."""
    output = next(iter(before.measured))
    return View(
        name, before.time, before.measured[output], before.simulated[output], after.simulated[output],
        before.inputs["motor_torque"], after.simulated["motor_speed"], after.simulated["motor_angle"],
        after.simulated.get("shaft_torque"), tuple(a for a, _ in before.pieces), output,
        (before.unit(output), before.torque_unit, before.motion_unit))
