"""The gap from a measured shaft torque, without simulation: the stretches in which the shaft carries no torque.

With a known torque the load's speed follows from its equation of motion. Each time the shaft is in contact, the
change of its torque gives its twist, which corrects the drift of the integral. Between leaving one side and meeting
the other the shaft turns through the whole gap. The torque that it still carries there, over the speed of the
twist, is damping that acts in the gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivetool.drive import Drive
from drivetool.identify.setup import Task, sensor_stds
from drivetool.logs import true_runs
from drivetool.quantity import name_of

# Of the largest torque, above which a shaft is in contact. A choice: the low value for a free gap, the high one for
# a damped gap, which carries torque itself.
CONTACT_TORQUE_SHARES = (0.1, 0.3)
# Standard deviations of the sensor, likewise: noise alone exceeds them once in 5e8 samples.
CONTACT_NOISE_STDS = 6.0
STRETCH_END_SHARE = 0.25  # of a stretch, left out at each end, a choice: the contact begins there
MIN_CROSSINGS = 3  # crossings: a median of fewer is not robust
MIN_STRETCH_SAMPLES = 3  # samples of a stretch: fewer leave no residual beside two factors of its own


@dataclass(frozen=True)
class Crossings:
    """Estimates from the dead stretches of the records.

    half_gap  [rad] median over the crossings; spread: median distance from it
    open      [Nm s/rad] damping that acts in the gap; closed: that of the shaft in contact
    count     of passages from one side to the other
    """

    half_gap: float
    spread: float
    open: float
    closed: float
    count: int


def crossings(task: Task) -> list[Crossings]:
    """The gap of two bodies by the dead stretches of their shaft torque, the least scattered first.

    task     with inertias, stiffness and friction of its drive
    returns  none where speed or shaft torque were not measured, behind a gear, or where hardly anything crosses
    """
    drive, roles = task.drive, task.roles
    torque = [r for r in roles.outputs if r.endswith("_torque")]
    speeds = [r for r in roles.outputs if r in (f"{drive.bodies[0]}_speed", "motor_speed")]
    if len(drive.bodies) != 2 or not torque or not speeds or drive.gear_ratios()[-1] != 1.0:
        return []
    traces = task.traces()
    at = [roles.outputs.index(r) for r in (speeds[0], torque[0])]
    noise = sensor_stds(traces)[at[1]]
    loads = [i for i, role in enumerate(roles.inputs) if role == "load_torque"]
    signals = [(_interpolated(t.outputs[:, at[0]]), _interpolated(t.outputs[:, at[1]]),
                t.inputs[:, loads].sum(axis=1), t.step)
               for t in traces]
    found = [_crossings_at_threshold(drive, signals, loud, CONTACT_NOISE_STDS * noise)
             for loud in CONTACT_TORQUE_SHARES]
    return sorted((c for c in found if c.count >= MIN_CROSSINGS and c.half_gap > 0.0),
                  key=lambda c: c.spread / c.half_gap)


def _crossings_at_threshold(drive: Drive, signals: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, float]],
                            contact_share: float,
                            least: float) -> Crossings:
    """Estimates from the stretches below a share of the largest torque."""
    open_damping, closed_damping, ends = StretchRegression(), StretchRegression(), []
    for w, s, load_torque, step in signals:
        threshold = max(contact_share * float(np.quantile(np.abs(s), 0.99)), least)
        rate = _twist_rate(drive, w, s, load_torque, threshold, step)
        for a, b in _gap_passages(s, threshold):
            edge = round(STRETCH_END_SHARE * (b - a))
            open_damping.add(s[a + edge:b - edge], rate[a + edge:b - edge])
            if s[a - 1] * s[b] < 0.0:
                travel = float(np.trapezoid(rate[a - 1:b + 1], dx=step))
                ends.append((np.sign(s[b]), travel, s[b] - s[a - 1], rate[b] - rate[a - 1]))
        for a, b in _contact_stretches(s, threshold):
            twist = np.concatenate([[0.0], step * np.cumsum(0.5 * (rate[a + 1:b] + rate[a:b - 1]))])
            closed_damping.add(s[a:b], rate[a:b], twist, np.ones(b - a), np.arange(b - a))
    if not ends:
        return Crossings(0.0, 0.0, open_damping.factor(), closed_damping.factor(), 0)
    # The twist of the spring at both ends is not part of the gap.
    side, travel, torque, rates = np.array(ends).T
    spring_twist = (torque - closed_damping.factor() * rates) / drive.values[name_of(drive.shafts[0], "stiffness")]
    half = 0.5 * side * (travel - spring_twist)
    median = float(np.median(half))
    return Crossings(median, float(np.median(np.abs(half - median))), open_damping.factor(),
                     closed_damping.factor(), len(ends))


class StretchRegression:
    """Least squares over stretches: one common factor of the first column, the other factors for each stretch."""

    def __init__(self) -> None:
        self.square = self.product = 0.0

    def add(self, target: np.ndarray, column: np.ndarray, *own: np.ndarray) -> None:
        """A stretch: target (n,), common column (n,), and columns with factors of this stretch alone."""
        if own:
            base = np.linalg.qr(np.column_stack(own))[0]
            column, target = (v - base @ (base.T @ v) for v in (column, target))
        self.square += float(column @ column)
        self.product += float(column @ target)

    def factor(self) -> float:
        """Not below zero."""
        return max(self.product / self.square, 0.0) if self.square > 0.0 else 0.0


def _interpolated(values: np.ndarray) -> np.ndarray:
    """(n,) with missing values interpolated linearly."""
    known = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), known, values[known]) if len(known) else np.zeros(len(values))


def _twist_rate(drive: Drive, speed: np.ndarray, torque: np.ndarray, load_torque: np.ndarray, threshold: float,
                step: float) -> np.ndarray:
    """(n,) speed of the twist: the motor's less the load's, which the shaft torque drives against a load torque."""
    load = drive.bodies[1]
    inertia, viscous = drive.inertias()[1], drive.known_value(name_of(load, "viscous")) or 0.0
    idle = (drive.known_value(name_of(load, "idle_torque"))
            or 0.0) + np.sign(speed) * (drive.known_value(name_of(load, "coulomb")) or 0.0)
    net = (torque - viscous * speed - idle - load_torque) / inertia
    found = speed - np.concatenate([[speed[0]], speed[0] + step * np.cumsum(0.5 * (net[1:] + net[:-1]))])
    centres, offsets = [], []
    for a, b in _contact_stretches(torque, threshold):
        span = step * (b - 1 - a)
        centres.append(0.5 * (a + b - 1))
        offsets.append(float(np.trapezoid(found[a:b], dx=step)) / span
                       - (torque[b - 1] - torque[a]) / drive.values[name_of(drive.shafts[0], "stiffness")] / span)
    if not centres:
        return found
    order = np.argsort(centres)
    return found - np.interp(np.arange(len(found)), np.array(centres)[order], np.array(offsets)[order])


def _contact_stretches(torque: np.ndarray, threshold: float) -> list[tuple[int, int]]:
    return [(a, b) for side in (1.0, -1.0) for a, b in true_runs(side * torque > threshold)
            if b - a >= MIN_STRETCH_SAMPLES]


def _gap_passages(torque: np.ndarray, threshold: float) -> Sequence[tuple[int, int]]:
    """Stretches between two contacts."""
    return [(a, b) for a, b in true_runs(np.abs(torque) <= threshold) if a > 0 and b < len(torque)
            and b - a >= MIN_STRETCH_SAMPLES]
