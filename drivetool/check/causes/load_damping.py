"""Damping that grows with load."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, is_present, start_with
from drivetool.quantity import names_of

if TYPE_CHECKING:
    from drivetool.check.fit import Model


def _starts(base: Model) -> list[Start]:
    names = names_of(base.task.drive.shafts, "load_damping")
    return [start_with(base, {n: 0.0}, (n,)) for n in names if not is_present(base, n)]


CAUSES = (Cause(
    "load-dependent-damping", "damping that grows with load",
    "Vibrations of the shaft decay faster under higher torque.",
    "Tune for the unloaded shaft, where the vibration lasts longest.", "load-dependent-damping", starts=_starts,
    imposed=_starts, sizes=("load_damping",), bodies=2),)
