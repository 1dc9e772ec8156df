"""Where the fit of a cause starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivetool.check.fit import Model
    from drivetool.identify.setup import Task

Bounds = Mapping[str, tuple[float, float]]  # parameter -> lowest and highest value


@dataclass(frozen=True)
class Start:
    """Where the fit of a cause starts: the task with its free parameters, and its amplitudes.

    amplitudes  of the free names, those whose start value a linear step gives
    quiet       the base under a smaller noise, for the start of the fit; None: it starts under the base's noise
    """

    task: Task
    amplitudes: tuple[str, ...]
    quiet: Model | None = None
