"""The main job and the descent that every peer is given: same start, continuation, steps, tolerance.

Unknowns: eight parameters and three start states in each of twelve segments of two seconds. A peer
brings the simulation, with an observer gain, and its sensitivities; the Levenberg-Marquardt on
block-arrow normal equations here is NumPy, and the continuation that of drivetool/identify/starts/cooling.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from tests.bench.records import CASES, STEP

NAMES = ("motor.inertia", "load.inertia", "shaft.stiffness", "shaft.damping", "motor.viscous",
         "load.idle_torque", "motor.coulomb", "shaft.half_gap")
SIGNS = np.array([1, -1, 1, -1, -1, 1, 1, -1])
START_ERROR = 0.15
LENGTH = 2000  # samples in a segment
SMOOTHING = 0.005  # rad/s in tanh(speed / smoothing); RK4 at 1 ms is stable from 0.004
# The noise ratio falls from a multiple of the natural one to a share of that; damping is held in the first stages.
START_RATIO_FACTOR, END_RATIO_SHARE = 10.0, 1e-5
STEPS_PER_STAGE, HELD_DAMPING_STAGES, MAX_WORSE_STAGES, BOUND_FACTOR = 3, 4, 5, 3.0
DAMPING_COLUMN = 3
SHAPE = np.array([0, 1, 2, 3, 7])
TOLERANCE = 1e-7


class Peer(Protocol):
    """A simulation of all segments: p (8,), starts (segments, 3), observer gain (3,)."""

    def outputs(self, p: np.ndarray, starts: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Motor speed (n,)."""

    def sensitivities(self, p: np.ndarray, starts: np.ndarray, gain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(motor speed (n,), its derivatives (n, 11) over parameters and start states)."""


@dataclass(frozen=True)
class Job:
    """torque, speed (n,); truth, start (8,); starts (segments, 3) to begin with."""

    torque: np.ndarray
    speed: np.ndarray
    truth: np.ndarray
    start: np.ndarray
    starts: np.ndarray

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.starts)


@dataclass(frozen=True)
class Reached:
    """Where a descent ended and what it took."""

    values: np.ndarray
    cost: float
    jacobians: int
    simulations: int


@cache
def main_job() -> Job:
    """The first record, eight parameters 15 % off."""
    case = CASES["main"]
    record = case.record()
    torque, speed = record.signals["motor_torque"], record.signals["motor_speed"]
    truth = np.array([case.truth[n] for n in NAMES])
    start = truth * (1.0 + START_ERROR * SIGNS)
    return Job(torque, speed, truth, start, _states(torque, speed, start)[::LENGTH])


def natural(p: np.ndarray) -> float:
    """Torque noise that moves the speed by its sensor noise in one sample, over that."""
    return p[0] / STEP


def observer(p: np.ndarray, ratio: float) -> np.ndarray:
    """(3,) steady Kalman gain of the drive without gap and friction, torque noise on both bodies."""
    a = np.array([[-(p[4] + p[3]) / p[0], p[3] / p[0], -p[2] / p[0]],
                  [p[3] / p[1], -p[3] / p[1], p[2] / p[1]], [1.0, -1.0, 0.0]])
    f, c = expm(a * STEP), np.array([[1.0, 0.0, 0.0]])
    noise = np.diag([ratio * STEP / p[0], ratio * STEP / p[1], 1e-9]) ** 2
    s = solve_discrete_are(f.T, c.T, noise, np.eye(1))
    return (s @ c.T / (c @ s @ c.T + 1.0))[:, 0]


def _states(torque: np.ndarray, speed: np.ndarray, p: np.ndarray) -> np.ndarray:
    """(n, 3) states from an observer over the record, small steps of Euler's method."""
    inertia, load, stiffness, damping, viscous, idle, coulomb, gap = p.tolist()
    k = observer(p, 0.1 * natural(p)).tolist()
    x, found, h = [float(speed[0]), float(speed[0]), gap + idle / stiffness], [], STEP / 10
    for u, y in zip(torque.tolist(), speed.tolist(), strict=True):
        e = y - x[0]
        x = [v + g * e for v, g in zip(x, k, strict=True)]
        found.append(tuple(x))
        for _ in range(10):
            z = x[2] + damping / stiffness * (x[0] - x[1])
            shaft = stiffness * (z - gap if z > gap else z + gap if z < -gap else 0.0)
            a0 = (u - viscous * x[0] - coulomb * np.tanh(x[0] / 0.05) - shaft) / inertia
            a1 = (shaft - idle) / load
            x = [x[0] + h * a0, x[1] + h * a1, x[2] + h * (x[0] - x[1])]
    return np.array(found)


def descend(peer: Peer, job: Job) -> Reached:
    """From the start values through the cooling observers to the free run."""
    p, starts, count = job.start.copy(), job.starts.copy(), np.zeros(2, int)
    low, high = np.zeros(8), np.full(8, np.inf)
    low[SHAPE], high[SHAPE] = p[SHAPE] / BOUND_FACTOR, p[SHAPE] * BOUND_FACTOR
    ratio, lowest, best, worse, flat, stage = START_RATIO_FACTOR * natural(p), np.inf, None, 0, 0, 0
    first = natural(p)
    while ratio > END_RATIO_SHARE * first and worse < MAX_WORSE_STAGES and flat < 2:
        gain = observer(p, ratio)
        hold = DAMPING_COLUMN if stage < HELD_DAMPING_STAGES else None
        p, starts, cost = _marquardt(peer, job, p, starts, gain, STEPS_PER_STAGE, 1e-6, (low, high), hold, count)
        value = 0.5 * len(job.speed) * np.log(cost)  # a steady observer's innovations have one variance
        flat = flat + 1 if lowest - 2.0 < value < lowest else 0
        worse = 0 if value < lowest else worse + 1
        if value < lowest:
            lowest, best = value, (p, starts)
        ratio, stage = ratio / 2.0, stage + 1
    p, starts = best
    anywhere = (np.zeros(8), np.full(8, np.inf))
    p, starts, cost = _marquardt(peer, job, p, starts, np.zeros(3), 30, TOLERANCE, anywhere, None, count)
    return Reached(p, cost, *count.tolist())


def _marquardt(peer, job, p, starts, gain, most, relative, bounds, hold, count):
    """Levenberg-Marquardt with the start states eliminated.

    As in the tool, the first trial comes with its sensitivities at once while trials are accepted; after
    a rejected one trials cost a simulation only.
    """
    damping, cost, found, first = 1e-3, np.inf, None, True
    for turn in range(most):
        y, jac = found or _sensitivities(peer, p, starts, gain, count)
        found, ahead, first = None, first and turn + 1 < most, True
        r, d = (y - job.speed).reshape(job.segments, LENGTH), jac.reshape(job.segments, LENGTH, 11)
        g, b = np.matmul(d.transpose(0, 2, 1), d), np.einsum("skq,sk->sq", d, r)
        before, better = float(np.vdot(r, r)), False
        while damping < 1e12:
            new, moved = _step(p, starts, g, b, damping, bounds, hold)
            if np.all(np.abs(new - p) < 0.5 * np.abs(p)) and np.all(np.isfinite(moved)):
                if ahead and first:
                    found = _sensitivities(peer, new, moved, gain, count)
                    e = found[0] - job.speed
                else:
                    e = peer.outputs(new, moved, gain) - job.speed
                    count[1] += 1
                cost = float(e @ e)
                if cost < before:
                    better = True
                    break
                found, first = None, False
            damping *= 4.0
        if not better:
            return p, starts, before
        p, starts, damping = new, moved, max(damping / 8.0, 1e-12)
        if before - cost < relative * before:
            break
    return p, starts, cost


def _sensitivities(peer, p, starts, gain, count):
    count[0] += 1
    return peer.sensitivities(p, starts, gain)


def _step(p, starts, g, b, damping, bounds, hold):
    free = np.arange(8) != (8 if hold is None else hold)
    cross, own = g[:, :8, 8:], g[:, 8:, 8:]
    inverse = np.linalg.inv(own + damping * np.einsum("sii,ij->sij", own, np.eye(3)) + 1e-9 * np.eye(3))
    product = cross @ inverse
    left = g[:, :8, :8].sum(axis=0) - np.einsum("sij,skj->ik", product, cross)
    left = left + damping * np.diag(np.einsum("sii->i", g[:, :8, :8]))
    right = b[:, :8].sum(axis=0) - np.einsum("sij,sj->i", product, b[:, 8:])
    change = np.zeros(8)
    change[free] = -np.linalg.solve(left[np.ix_(free, free)], right[free])
    new = np.clip(p + change, *bounds)
    moved = starts - np.einsum("sij,sj->si", inverse, b[:, 8:] + np.einsum("sij,i->sj", cross, new - p))
    return new, moved
