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
    """Where the fit of a cause starts: the task with all that is free, and what is worth a first step.

    amplitudes  of the free names, those whose first guess a linear step gives
    quiet       the base under a quieter noise, where the fit is to begin; None: it begins under the base's
    """

    task: Task
    amplitudes: tuple[str, ...]
    quiet: Model | None = None
