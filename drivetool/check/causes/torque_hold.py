"""A torque that is no step between its samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drivetool.check.causes.cause import Cause
from drivetool.check.starts import Start, is_present, likeliest_start, start_with

if TYPE_CHECKING:
    from drivetool.check.fit import Model

NAME = "converter.interpolation"
# Shares of a straight line between torques; a choice: steps of a tenth.
INTERPOLATION_SHARES = tuple(np.round(np.arange(0.1, 1.01, 0.1), 1).tolist())


def _starts(base: Model) -> list[Start]:
    if is_present(base, NAME):
        return []
    return likeliest_start(base,
                           [start_with(base, {NAME: share}, (), fixed=(NAME,)) for share in INTERPOLATION_SHARES])


CAUSES = (Cause(
    "torque-hold", "torque interpolation between samples",
    "The logged torque does not stay constant between samples but changes towards the next sample. It acts up to "
    "half a sample earlier than a held torque.",
    "Keep converter.interpolation in the parameters, and set torque_is: measurement in the channel map.",
    "torque-hold", starts=_starts, sizes=("interpolation",)),)
