"""The gap as a measured shaft torque shows it, without any simulation: the stretches in which it carries nothing.

While the torque is known the load's speed follows from its equation of motion, and each time the shaft is in
contact the change of its torque tells how far it was twisted: that takes away what the integral has drifted.
Between leaving one side and meeting the other the shaft turns through the whole gap. What torque it still carries
on the way, over the speed of the twist, is damping that acts in the gap.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drivetool.drive import Drive
from drivetool.identify.setup import Task, sensor_stds

LOUD = (0.1, 0.3)  # of the largest torque, above which a shaft is in contact: high where the gap is damped
NOISY = 6.0  # standard deviations of the sensor, likewise
INNER = 0.25  # of a stretch, left off at each end: there the contact begins
FEW = 3  # crossings of which a median is worth something
SHORTEST = 3  # samples of a stretch


@dataclass(frozen=True)
class Crossings:
    """What the dead stretches of the records tell.

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
    if len(drive.bodies) != 2 or not torque or not speeds or drive.turns()[-1] != 1.0:
        return []
    traces = task.traces()
    at = [roles.outputs.index(r) for r in (speeds[0], torque[0])]
    noise = sensor_stds(traces)[at[1]]
    loads = [i for i, role in enumerate(roles.inputs) if role == "load_torque"]
    signals = [(_filled(t.outputs[:, at[0]]), _filled(t.outputs[:, at[1]]), t.inputs[:, loads].sum(axis=1), t.step)
               for t in traces]
    found = [_by_bar(drive, signals, loud, NOISY * noise) for loud in LOUD]
    return sorted((c for c in found if c.count >= FEW and c.half_gap > 0.0), key=lambda c: c.spread / c.half_gap)


def _by_bar(drive: Drive, signals: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, float]], loud: float,
            least: float) -> Crossings:
    """What the stretches below a share of the largest torque tell."""
    inside, touching, ends = Regression(), Regression(), []
    for w, s, against, step in signals:
        bar = max(loud * float(np.quantile(np.abs(s), 0.99)), least)
        rate = _twist_rate(drive, w, s, against, bar, step)
        for a, b in _dead(s, bar):
            edge = round(INNER * (b - a))
            inside.add(s[a + edge:b - edge], rate[a + edge:b - edge])
            if s[a - 1] * s[b] < 0.0:
                way = float(np.trapezoid(rate[a - 1:b + 1], dx=step))
                ends.append((np.sign(s[b]), way, s[b] - s[a - 1], rate[b] - rate[a - 1]))
        for a, b in _contacts(s, bar):
            twist = np.concatenate([[0.0], step * np.cumsum(0.5 * (rate[a + 1:b] + rate[a:b - 1]))])
            touching.add(s[a:b], rate[a:b], twist, np.ones(b - a), np.arange(b - a))
    if not ends:
        return Crossings(0.0, 0.0, inside.factor(), touching.factor(), 0)
    # What the spring was wound at both ends is no gap.
    side, way, torque, rates = np.array(ends).T
    wound = (torque - touching.factor() * rates) / drive.values[f"{drive.shafts[0]}.stiffness"]
    half = 0.5 * side * (way - wound)
    middle = float(np.median(half))
    return Crossings(middle, float(np.median(np.abs(half - middle))), inside.factor(), touching.factor(), len(ends))


class Regression:
    """Least squares over stretches: one factor for all of them, of the first column, beside others of each."""

    def __init__(self) -> None:
        self.square = self.product = 0.0

    def add(self, target: np.ndarray, column: np.ndarray, *own: np.ndarray) -> None:
        """A stretch: what is explained (n,), the column (n,), and columns with factors of this stretch alone."""
        if own:
            base = np.linalg.qr(np.column_stack(own))[0]
            column, target = (v - base @ (base.T @ v) for v in (column, target))
        self.square += float(column @ column)
        self.product += float(column @ target)

    def factor(self) -> float:
        """Not below zero."""
        return max(self.product / self.square, 0.0) if self.square > 0.0 else 0.0


def _filled(values: np.ndarray) -> np.ndarray:
    """(n,) with a line through what was not measured."""
    known = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), known, values[known]) if len(known) else np.zeros(len(values))


def _twist_rate(drive: Drive, speed: np.ndarray, torque: np.ndarray, against: np.ndarray, bar: float,
                step: float) -> np.ndarray:
    """(n,) speed of the twist: the motor's less the load's, which the shaft torque drives against a load torque."""
    load = drive.bodies[1]
    inertia, viscous = drive.inertias()[1], drive.told(f"{load}.viscous") or 0.0
    idle = (drive.told(f"{load}.idle_torque") or 0.0) + np.sign(speed) * (drive.told(f"{load}.coulomb") or 0.0)
    net = (torque - viscous * speed - idle - against) / inertia
    found = speed - np.concatenate([[speed[0]], speed[0] + step * np.cumsum(0.5 * (net[1:] + net[:-1]))])
    at, off = [], []
    for a, b in _contacts(torque, bar):
        span = step * (b - 1 - a)
        at.append(0.5 * (a + b - 1))
        off.append(float(np.trapezoid(found[a:b], dx=step)) / span
                   - (torque[b - 1] - torque[a]) / drive.values[f"{drive.shafts[0]}.stiffness"] / span)
    if not at:
        return found
    order = np.argsort(at)
    return found - np.interp(np.arange(len(found)), np.array(at)[order], np.array(off)[order])


def _runs(mask: np.ndarray) -> Iterator[tuple[int, int]]:
    """[first, past the last) of the runs of a mask."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8))) + 1
    bounds = [0, *edges.tolist(), len(mask)]
    return ((a, b) for a, b in pairwise(bounds) if mask[a])


def _contacts(torque: np.ndarray, bar: float) -> list[tuple[int, int]]:
    return [(a, b) for side in (1.0, -1.0) for a, b in _runs(side * torque > bar) if b - a >= SHORTEST]


def _dead(torque: np.ndarray, bar: float) -> Sequence[tuple[int, int]]:
    """Stretches between two contacts."""
    return [(a, b) for a, b in _runs(np.abs(torque) <= bar) if a > 0 and b < len(torque) and b - a >= SHORTEST]
