"""Whether a load that changes several times is a function of speed, as friction of another law is."""

from __future__ import annotations

from itertools import product

import numpy as np
import scipy

from drivetool.check.fit import Model
from drivetool.check.starts import speeds
from drivetool.drive.effects import STEP_TIMES, STEP_TORQUES, values_in_record
from drivetool.quantity import name_of

# S over which a speed is averaged: shorter than a reversal, longer than the noise's correlation.
SPEED_AVERAGING_TIME = 0.04


def share_by_speed(model: Model) -> float:
    """Share of the variance of the load steps that a function of the motor speed explains (R squared).

    That function is a polynomial of third order on either side of standstill. Load steps at random instants
    have a share of a third, hardly ever more than 0.8.
    """
    loads, rates = [], []
    for trace, speed in zip(model.problem.traces, speeds(model), strict=True):
        values = values_in_record(model.fitted.drive.values, trace.record)
        time = trace.origin + trace.step * np.arange(trace.size)
        changes = [(values[name_of(body, torque)], values[name_of(body, at)]) for body, (torque, at) in product(
            model.task.drive.bodies, zip(STEP_TORQUES, STEP_TIMES, strict=True))
                   if name_of(body, torque) in model.task.free]
        loads.append(sum(torque * (time >= at) for torque, at in changes) + np.zeros(trace.size))
        rates.append(scipy.ndimage.uniform_filter1d(speed, max(1, round(SPEED_AVERAGING_TIME / trace.step))))
    load, rate = np.concatenate(loads), np.concatenate(rates)
    rate = rate / max(float(np.abs(rate).max()), 1e-300)
    powers = [np.where(side * rate > 0.0, rate**k, 0.0) for side in (1.0, -1.0) for k in range(4)]
    law = np.stack([*powers, np.ones(len(rate))], axis=1)
    residual = load - law @ np.linalg.lstsq(law, load, rcond=None)[0]
    return float(1.0 - residual.var() / load.var()) if load.var() > 0.0 else 0.0
