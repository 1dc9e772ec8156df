"""Whether a load that changes several times does so with the speed, as friction of another law does."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.ndimage import uniform_filter1d

from drivetool.check.fit import Model
from drivetool.check.starts import speeds
from drivetool.drive.effects import TIMES, TORQUES, felt_in

SMOOTH = 0.04  # s over which a speed is averaged: shorter than a reversal, longer than its noise


def share_by_speed(model: Model) -> float:
    """Share of the variance of the loads that set in which some function of the motor's speed has, too.

    That function is a polynomial of third order on either side of standstill. Loads that set in at instants drawn
    at random have a share of a third, hardly ever more than 0.8.
    """
    loads, rates = [], []
    for trace, speed in zip(model.problem.traces, speeds(model), strict=True):
        values = felt_in(model.fitted.drive.values, trace.record)
        time = trace.origin + trace.step * np.arange(trace.size)
        changes = [(values[f"{body}{torque}"], values[f"{body}{at}"]) for body, (torque, at) in product(
            model.task.drive.bodies, zip(TORQUES, TIMES, strict=True)) if f"{body}{torque}" in model.task.free]
        loads.append(sum(torque * (time >= at) for torque, at in changes) + np.zeros(trace.size))
        rates.append(uniform_filter1d(speed, max(1, round(SMOOTH / trace.step))))
    load, rate = np.concatenate(loads), np.concatenate(rates)
    rate = rate / max(float(np.abs(rate).max()), 1e-300)
    powers = [np.where(side * rate > 0.0, rate**k, 0.0) for side in (1.0, -1.0) for k in range(4)]
    law = np.stack([*powers, np.ones(len(rate))], axis=1)
    left = load - law @ np.linalg.lstsq(law, load, rcond=None)[0]
    return float(1.0 - left.var() / load.var()) if load.var() > 0.0 else 0.0
