"""A signal on the way from a recording to an experiment: in SI, not yet on the common grid."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Signal:
    """A role's signal on its own clock.

    time, values  (n,) [s], and in the SI unit `si`; finite
    empty_stamps  (k,) stamps of rows or messages without a value [s]; they are no samples
    broken        number of samples among them whose value is infinite or impossibly large
    """

    time: np.ndarray
    values: np.ndarray
    si: str
    empty_stamps: np.ndarray = field(default_factory=lambda: np.zeros(0))
    invalid_count: int = 0
