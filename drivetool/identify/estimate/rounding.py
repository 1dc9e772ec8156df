"""Rounding errors of a record: a free-run error that is no larger is no evidence of a model error.

A simulated record has no noise. The residual of the right drive is then rounding: correlated from sample to sample
and with the torque, and of varying size. Tests of noise would reject it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivetool.drive.simulation import Trace
from drivetool.finding import Finding
from drivetool.logs import UNIT_TABLE

SINGLE_EPS, DOUBLE_EPS = (float(np.finfo(kind).eps) for kind in (np.float32, np.float64))
# From a unit that was logged to SI
UNIT_FACTORS = tuple(dict.fromkeys(factor for _, _, factor, _ in UNIT_TABLE.values()))
# Of the largest value: convergence tolerance of the torques of smooth laws in the simulation
SIMULATION_TOLERANCE = 1e-10
# Times the rms of one rounding. Rounding of torque and sensor add up; where neither signal changes, both stay
# constant, at worst the last digit itself, which is sqrt(12) of its rms.
ROUNDING_MARGIN = float(np.sqrt(12.0))


def relative_resolution(values: np.ndarray) -> float:
    """Relative size of the last digit of a format: single precision where all values are single.

    They may have been single in another unit: converted back to that unit they are again.
    """
    with np.errstate(over="ignore"):
        logged = ((factor, (values / factor).astype(np.float32).astype(float)) for factor in UNIT_FACTORS)
        single = any(np.array_equal(single * factor, values, equal_nan=True) for factor, single in logged)
    return SINGLE_EPS if single else DOUBLE_EPS


def only_rounding(measured: np.ndarray, simulated: np.ndarray, inputs: np.ndarray) -> bool:
    """Whether free runs (n,) differ from what was measured (n,) by rounding alone; inputs: (n, nu) of the drive.

    The motion is proportional to the torque, so that the rounding of the torque counts as a share of the motion.
    """
    known = np.isfinite(measured)
    y, e = measured[known], (measured - simulated)[known]
    share = np.hypot(relative_resolution(y),
                     max(relative_resolution(u) for u in inputs.T)) / np.sqrt(12.0) + SIMULATION_TOLERANCE
    return bool(len(y) and np.sqrt(np.mean(e**2)) <= ROUNDING_MARGIN * share * np.abs(y).max())


def explains_to_rounding(traces: Sequence[Trace], runs: Sequence[np.ndarray]) -> bool:
    """Whether the residual of free runs (n, ny) of all traces is rounding alone in the first output."""
    return only_rounding(np.concatenate([t.outputs[:, 0] for t in traces]),
                         np.concatenate([run[:, 0] for run in runs]), np.concatenate([t.inputs for t in traces]))


def rounding_finding(what: str, rms: float, unit: str) -> Finding:
    """The finding that the residual of a model is rounding alone."""
    return Finding(
        "note", "residual-not-testable",
        f"The residual of {what} is not testable: the free-run error, rms {rms:.2g} {unit}, is no larger than "
        "the rounding of the record and of the simulation.", {"rms": rms})
