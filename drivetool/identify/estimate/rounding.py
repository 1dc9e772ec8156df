"""What digits leave of a motion: an error of free runs that is no larger is no evidence of anything.

A record that was simulated has no noise. What a right drive leaves of it repeats from sample to sample, follows the
torque and differs from place to place, as rounding does; tests of noise would find all of that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive.simulation import Trace
from drivetool.errors import Finding
from drivetool.logs import TABLE

SINGLE, DOUBLE = (float(np.finfo(kind).eps) for kind in (np.float32, np.float64))
FACTORS = tuple(dict.fromkeys(factor for _, _, factor, _ in TABLE.values()))  # from a unit that was logged to SI
KERNEL = 1e-10  # of the largest value: to that share of them the torques of smooth laws converge in the simulation
# Times the rms of one rounding: that of the torque adds to that of the sensor, and where neither changes both are
# the same for long, at worst as large as the last digit, sqrt(12) of it.
ROOM = float(np.sqrt(12.0))


def digits(values: np.ndarray) -> float:
    """Share of a value that the last digit of its format is worth: single precision where all values are such.

    They may have been so in another unit: back in that one they are again.
    """
    with np.errstate(over="ignore"):
        logged = ((factor, (values / factor).astype(np.float32).astype(float)) for factor in FACTORS)
        single = any(np.array_equal(single * factor, values, equal_nan=True) for factor, single in logged)
    return SINGLE if single else DOUBLE


def only_rounding(measured: np.ndarray, simulated: np.ndarray, inputs: np.ndarray) -> bool:
    """Whether free runs (n,) differ from what was measured (n,) by rounding alone; inputs: (n, nu) of the drive.

    The motion answers the torque in proportion, so that the rounding of the torque counts as a share of the motion.
    """
    known = np.isfinite(measured)
    y, e = measured[known], (measured - simulated)[known]
    share = np.hypot(digits(y), max(digits(u) for u in inputs.T)) / np.sqrt(12.0) + KERNEL
    return bool(len(y) and np.sqrt(np.mean(e**2)) <= ROOM * share * np.abs(y).max())


def explains(traces: Sequence[Trace], runs: Sequence[np.ndarray]) -> bool:
    """Whether free runs (n, ny) of all traces leave rounding alone of the first output."""
    return only_rounding(np.concatenate([t.outputs[:, 0] for t in traces]),
                         np.concatenate([run[:, 0] for run in runs]), np.concatenate([t.inputs for t in traces]))


def rounding_alone(what: str, rms: float, unit: str) -> Finding:
    """That a model leaves nothing but rounding."""
    return Finding(
        "note", "explained-to-rounding",
        f"The model explains {what} to rounding: what a free run leaves, rms {rms:.2g} {unit}, is no more than the "
        "digits of the record and of the simulation make.", {"rms": rms})
