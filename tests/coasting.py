"""Coast-downs of a motor without torque as experiments, for estimators that are called without files."""

from __future__ import annotations

import numpy as np

from drivetool.logs import Experiment
from tests.simulator.coasting import PULSES, RPM, STEP, Motor, counts, driven, motion

__all__ = ["PULSES", "RPM", "STEP", "Motor", "coast_down", "counts", "driven_then_off", "motion", "recording"]


def recording(seed: int, name: str = "coast.parquet", step: float = STEP, **signals: np.ndarray) -> Experiment:
    """The signals as an experiment."""
    size = len(next(iter(signals.values())))
    return Experiment(name, f"{seed:064x}", step, 0.0, signals, ((0, size),))


def coast_down(seed: int, motor: Motor | None = None, fast: float = 2240 * RPM, end: float = 80 * RPM,
             pulses: int = PULSES) -> Experiment:
    """A coast-down by counts, no torque logged."""
    angle, _ = motion(motor or Motor(), lambda t: 0.0, fast, end, 5.0)
    return recording(seed, f"coast-{seed}.parquet", motor_angle=counts(angle, seed, pulses))


def driven_then_off(seed: int, scale: float = 1.0, torque: float = 0.06) -> Experiment:
    """Half a second under a constant torque from 100 rad/s, then off; scale: of the logged torque."""
    logged, angle, _ = driven(Motor(), torque, 100.0, 80 * RPM)
    return recording(seed, f"driven-{seed}.parquet", motor_torque=scale * logged, motor_angle=counts(angle, seed))
