"""What each estimator says of a record: the command line by its criteria, and plain least squares."""

from __future__ import annotations

import time

import numpy as np

from tests.study.missing_laws.record import Record, draw
from tests.study.missing_laws.regression import least_squares
from tests.study.shared.command import greybox

REGRESSION = "regression"
NAMES = ("motor.inertia", "motor.viscous", "motor.coulomb", "motor.idle_torque")


def start_values(record: Record, seed: int) -> dict[str, float]:
    """Name -> a value 15 to 50 % off the machine's own, above or below it."""
    rng = np.random.default_rng([seed, 40503])
    off = rng.choice([-1.0, 1.0], 4) * rng.uniform(0.15, 0.5, 4)
    return {name: float(value) for name, value in
            zip(NAMES, record.machine.numbers() * (1.0 + off), strict=True)}


def fit(record: Record, seed: int, criterion: str) -> dict:
    """`drivetool greybox` in this process; values, stds and intervals in the order of NAMES.

    criterion  of the command line, or REGRESSION
    returns    value, std, ci95 (None where the tool states none), correlation (4 x 4), seconds of
               processor time; where it failed only failed and seconds
    """
    if criterion == REGRESSION:
        began = time.process_time()
        try:
            found = _plain(record)
        except ValueError as problem:
            found = {"failed": str(problem)}
        return found | {"seconds": time.process_time() - began}
    return greybox(record.step, {"motor_torque": record.torque, record.role: record.measured},
                   start_values(record, seed), NAMES, ["--drive", "one-body", "--criterion", criterion])


def warm_up(criteria: tuple[str, ...]) -> None:
    """One fit of each, so that no row counts the loading of compiled code."""
    record = draw("quiet", "", 7, 1)
    for criterion in criteria:
        fit(record, 1, criterion)


def _plain(record: Record) -> dict:
    found = least_squares(record.step, record.torque, record.measured, record.role == "motor_angle")
    std = np.sqrt(np.diag(found.covariance))
    half = found.factor * std
    return {"value": found.value.tolist(), "std": std.tolist(),
            "ci95": np.column_stack([found.value - half, found.value + half]).tolist(),
            "status": ["fitted"] * 4, "findings": [],
            "correlation": (found.covariance / np.outer(std, std)).tolist()}
