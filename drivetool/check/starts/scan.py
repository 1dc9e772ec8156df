"""Cheap looks at a whole range: third masses, orders of a ripple."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from drivetool.check.fit import (
    BROKEN,
    Model,
    begun,
    carried,
    everything,
    few_steps,
    judge,
    may_have_tip,
    with_large_tip,
    with_middle,
    with_tip,
)
from drivetool.drive import state_space
from drivetool.identify.backlash import valleys
from drivetool.identify.laws import grown, tip_names
from drivetool.identify.noise import Noise, filtered
from drivetool.identify.setup import Task, problem_of

TIMES = np.geomspace(0.4, 8.0, 14)  # frequencies of a third mass over that of the first resonance
TRACE = 0.01  # share of the last inertia at which the effect of a third mass is in proportion to it
BROAD = 0.1  # its damping ratio there: a sharper one would be missed between the frequencies
SPLIT = (0.05, 0.4)  # least and largest share to start a fit from
TIPS = 2  # frequencies that are worth a fit
SHARES, PLACES = (0.1, 0.3, 0.6), (0.2, 0.5, 0.8)  # of the load and of the twist, for a mass between motor and load
LARGE, SHARP = 0.3, 0.05  # share and damping ratio of a third mass that is no trace
MIDDLING = 4  # steps after which they are compared
KEEP = 3  # places that are worth a fit
ORDERS = 6000  # most orders looked at
PERIODS = 2.0  # of a ripple that the motion must go through, for it to repeat
HIGHEST = 0.45  # of the sampling rate, up to which a ripple is followed
FOLLOWED = 0.5  # share of the samples, the slow ones, in which an order must be followed to be looked for
# Times the score of an order that a fixed frequency must have, to be what stands behind it. At a steady speed both
# explain the same, and half a step of the grid between two orders, or two frequencies, costs up to a fifth.
BETTER = 1.5
TAIL = 0.1  # share of the score of an order that the slowest samples, and the fastest, may add for chance
LINES = 2000  # frequencies up to there at which its trace is known
CELLS, SPEEDS = 1 << 17, 256  # of the angle and of the speed, in which orders are looked for


def likely_tips(base: Model) -> list[Task]:
    """Third masses at the frequencies where a trace of one would gain most as it grows.

    Split off with a whole share the fit would begin thousands of units of log likelihood below the base,
    and end anywhere. A trace hardly changes the motion, and one linear step, its inertia, stiffness and
    damping growing together, says how large it should be.
    """
    if not may_have_tip(base.task.drive):
        return []
    found = []
    for times in TIMES:
        task = with_tip(base, TRACE, times, BROAD)
        if task is not None:
            promise, growth = _grown(base, task)
            share = np.clip(TRACE * (1.0 + growth), *SPLIT)
            found.append((growth > 0.0, promise, with_tip(base, share, times, BROAD)))
    found.sort(key=lambda f: f[:2], reverse=True)
    return [task for _, _, task in found[:TIPS]]


def likely_large_tips(base: Model) -> list[Task]:
    """Large third masses that are likeliest after a few steps; from a trace no way may lead to them."""
    if not may_have_tip(base.task.drive):
        return []
    tasks = [with_large_tip(base, LARGE, times, SHARP) for times in TIMES]
    return _after_steps(base, [task for task in tasks if task is not None])


def likely_middles(base: Model) -> list[Task]:
    """Third masses between motor and load that are likeliest after a few steps, where a sensor is behind them.

    Without one a body in front of the last and one behind it are the same.
    """
    if not may_have_tip(base.task.drive) or not any(r.startswith("load_") for r in base.task.roles.outputs):
        return []
    return _after_steps(base, [with_middle(base, share, place) for share in SHARES for place in PLACES])


def _after_steps(base: Model, tasks: Sequence[Task]) -> list[Task]:
    """The tasks that are likeliest after a few steps, at what these lead to."""
    found = []
    for task in tasks:
        problem = problem_of(task.drive, task.free, task.roles, base.problem.traces)
        try:
            model = few_steps(begun(base.code, task, problem, carried(base, task, problem), base.noise),
                              everything(base.problem), MIDDLING)
        except BROKEN:
            continue
        found.append((model.value, len(found), model.fitted))
    return [task for _, _, task in sorted(found)[:TIPS]]


def _grown(base: Model, task: Task) -> tuple[float, float]:
    """(log likelihood over the base after a linear step, relative growth of the third mass in it)."""
    problem = problem_of(task.drive, task.free, task.roles, base.problem.traces)
    point = carried(base, task, problem)
    gain, growth = grown(problem, point, base.noise, tip_names(base.task.drive))
    return gain - judge(problem, point, base.noise, everything(problem)), growth


def likely_orders(base: Model) -> list[float]:
    """Orders of the motor angle at which the innovations repeat.

    A torque sin(n angle) reaches the innovations through the drive and its steady-state filter: its
    response at the frequency n times the speed gives size and phase from sample to sample, and the
    score of an order is what that shape explains. What a fixed frequency explains better is a hum, and no order.
    """
    z, angles, speeds = innovations(base)
    reach = max(float(np.ptp(a)) for a in angles)
    usual = float(np.quantile(np.abs(np.concatenate(speeds)), FOLLOWED))
    if reach <= 0.0 or usual <= 0.0:
        return []
    step = base.problem.traces[0].step
    spacing = np.pi / reach
    high = HIGHEST * 2.0 * np.pi / step / usual
    grid = PERIODS * 2.0 * np.pi / reach + spacing * np.arange(ORDERS)
    grid = grid[grid < high]
    if not len(grid):  # it shakes faster than a ripple could be followed
        return []
    lines = np.linspace(0.0, HIGHEST / step, LINES + 1)[1:]
    response = disturbance_response(base, lines)
    first = round(float(grid[0]) / spacing)
    upper, lower = np.zeros(len(grid), complex), np.zeros(len(grid))
    asked = [asked_for(e, response, lines, step) for e in z]
    for torque, angle, speed in zip(asked, angles, speeds, strict=True):
        upper += _over_angle(torque, angle, reach)[first:first + len(grid)]
        lower += left_by(grid, speed, response, lines)
    scores = np.abs(upper) ** 2 / np.maximum(lower, 1e-300)
    fixed = FixedLines(asked, lines, response, step)
    found = (i for i in valleys(-scores) if not fixed.explains(grid[i], scores[i], asked, angles, speeds))
    return [float(grid[i]) for i in islice(found, KEEP)]


class FixedLines:
    """What each fixed frequency explains of the torque that innovations ask for, in the unit of a score."""

    def __init__(self, torque: Sequence[np.ndarray], lines: np.ndarray, response: np.ndarray, step: float) -> None:
        """torque (n,) per trace; response (LINES, outputs) of innovations to it at lines (LINES,) [Hz]"""
        size = 1 << (2 * max(len(t) for t in torque) - 1).bit_length()
        self.frequency = np.fft.rfftfreq(size, step)
        self.frequency = self.frequency[self.frequency <= lines[-1]]
        power = np.interp(self.frequency, lines, (np.abs(response) ** 2).sum(axis=1))
        spectra = [np.abs(np.fft.rfft(t, size)[:len(power)]) ** 2 / len(t) for t in torque]
        score = sum(spectra) / np.maximum(power, 1e-300)
        # Each trace has a phase of its own, with which noise alone explains one part more.
        self.score = score - (1.0 - 1.0 / len(spectra)) * np.median(score)

    def explains(self, order: float, score: float, torque: Sequence[np.ndarray], angles: Sequence[np.ndarray],
                 speeds: Sequence[np.ndarray]) -> bool:
        """Whether one frequency explains more than an order does, among those at which the order explains it."""
        asked = [t * np.exp(-1j * order * a) for t, a in zip(torque, angles, strict=True)]
        total = sum(complex(a.sum()) for a in asked)
        speed = np.abs(np.concatenate(speeds))
        at = np.argsort(speed, kind="stable")
        grown = np.cumsum((np.concatenate(asked) * np.conj(total)).real[at]) / abs(total) ** 2
        low, high = speed[at[np.argmax(grown >= TAIL)]], speed[at[np.flatnonzero(grown <= 1.0 - TAIL)[-1]]]
        inside = slice(*np.searchsorted(self.frequency, order / (2.0 * np.pi) * np.array([low, high]) + np.array(
            [-1.0, 1.0]) * (self.frequency[1] - self.frequency[0])))
        return bool(len(self.score[inside]) and self.score[inside].max() > BETTER * score)


def asked_for(e: np.ndarray, response: np.ndarray, lines: np.ndarray, step: float) -> np.ndarray:
    """(n,) torque on the motor that innovations (n, outputs) ask for: the adjoint of the filter over them.

    response  (LINES, outputs) of innovations to such a torque at the frequencies (LINES,)
    """
    n, size = len(e), 1 << (2 * len(e) - 1).bit_length()
    frequencies, torque = np.fft.rfftfreq(size, step), np.zeros(n)
    for own, answer in zip(e.T, response.T, strict=True):
        at = np.interp(frequencies, lines, answer.real, right=0.0) + 1j * np.interp(
            frequencies, lines, answer.imag, right=0.0)
        torque += np.fft.irfft(np.fft.rfft(own, size) * np.conj(at), size)[:n]
    return torque


def _over_angle(torque: np.ndarray, angle: np.ndarray, reach: float) -> np.ndarray:
    """What a torque (n,) has of each order of an angle: one transform over twice its reach, so that lines of the
    transform are pi / reach apart.
    """
    place = (angle - angle.min()) / (2.0 * reach) * CELLS
    cell = np.floor(place).astype(int)
    part = place - cell
    cells = np.bincount(cell, torque * (1.0 - part), CELLS + 1) + np.bincount(cell + 1, torque * part, CELLS + 1)
    cells[0] += cells[CELLS]
    return np.conj(np.fft.rfft(cells[:CELLS]))


def left_by(grid: np.ndarray, speed: np.ndarray, response: np.ndarray, lines: np.ndarray,
            weight: np.ndarray | None = None) -> np.ndarray:
    """(k,) how much a torque of each order of a grid would leave in the innovations, by how often each speed is.

    weight  (n,) of the samples of speed (n,); None: one each
    """
    power = np.concatenate(([0.0], (np.abs(response) ** 2).sum(axis=1), [0.0]))
    count, edge = np.histogram(np.abs(speed) / (2.0 * np.pi * lines[0]), SPEEDS, weights=weight)
    at = np.clip(np.rint(np.outer(grid, 0.5 * (edge[1:] + edge[:-1]))), 0, LINES + 1).astype(int)
    return power[at] @ count


def innovations(base: Model) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    """Per trace: whitened innovations (n, outputs), motor angle and motor speed (n,)."""
    passes = filtered(base.problem, base.point, base.noise)
    z, angles, speeds = [], [], []
    for f, t in zip(passes, base.problem.traces, strict=True):
        e = f.innovations / np.sqrt(f.variance)
        z.append(np.where(np.isfinite(e), e, 0.0))
        speed = f.states[:, 0]
        speeds.append(speed)
        angles.append(np.concatenate(([0.0], np.cumsum(speed[:-1] * t.step))))
    return z, angles, speeds


def disturbance_response(base: Model, frequencies: np.ndarray) -> np.ndarray:
    """(n, outputs) complex response of whitened innovations to a torque on the motor, drive closed and linear."""
    a, gamma, c = steady_filter(base)
    z = np.exp(2j * np.pi * frequencies * base.problem.traces[0].step)
    x = np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a,
                        np.broadcast_to(gamma[:, None], (len(z), len(a), 1)))
    return x[:, :, 0] @ c.T


def steady_filter(base: Model, at_load: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a torque leaves in the whitened innovations (outputs,) of the closed linear drive and its noise.

    at_load  whether it acts on the last body; else on the motor
    returns  (A (n, n), Gamma (n,), C (outputs, n)) of the errors x[k+1] = A x[k] + Gamma T[k], z[k] = C x[k], by
             the steady Kalman filter; sensors are whitened one after the other, as the passes of the fit do
    """
    from scipy.linalg import expm, solve_discrete_are

    task: Task = base.fitted
    roles = ("motor_torque", "load_torque") if at_load and len(task.drive.bodies) > 1 else ("motor_torque",)
    a, b, c, _ = state_space(task.drive, roles, task.roles.outputs)
    seen = _seen(a, c)
    a, b, c = a[np.ix_(seen, seen)], b[seen], c[:, seen]
    n, step = len(a), base.problem.traces[0].step
    whole = np.zeros((n + b.shape[1], n + b.shape[1]))
    whole[:n, :n], whole[:n, n:] = a * step, b * step
    whole = expm(whole)
    phi, motor, acts = whole[:n, :n], whole[:n, n], whole[:n, -1]
    phi, q = _with_noise(phi, motor, base.noise)
    more = len(phi) - n
    c, acts = np.pad(c, ((0, 0), (0, more))), np.pad(acts, (0, more))
    q = max(base.noise.ratio, 1e-6) ** 2 * (q + 1e-14 * q.trace() * np.eye(len(q)))
    r = np.diag((base.noise.scale / base.noise.scale[0]) ** 2)
    p = solve_discrete_are(phi.T, c.T, q, r)
    variance = c @ p @ c.T + r
    gain = np.linalg.solve(variance, c @ p).T
    return phi @ (np.eye(len(phi)) - gain @ c), acts, np.linalg.solve(np.linalg.cholesky(variance), c)


def _with_noise(phi: np.ndarray, gamma: np.ndarray, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
    """(Phi, covariance of what a sample brings for a ratio of one), a memory of the noise as a state."""
    if noise.memory is None:
        return phi, np.outer(gamma, gamma)
    n = len(phi)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n], whole[n, n] = phi, gamma, noise.memory
    brings = np.zeros(n + 1)
    if noise.slow is None:
        brings[n] = np.sqrt(1.0 - noise.memory**2)
    else:
        brings[:n], brings[n] = gamma, (noise.slow - 1.0) * (1.0 - noise.memory)
    return whole, np.outer(brings, brings)


def _seen(a: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Indices of the states that reach an output: an angle that is not measured has no steady filter."""
    seen = np.any(c != 0.0, axis=0)
    for _ in range(len(a)):
        seen = seen | np.any(a[seen] != 0.0, axis=0)
    return np.flatnonzero(seen)
