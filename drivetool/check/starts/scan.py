"""Scans over a whole range for starts: third masses, orders of a torque ripple."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from drivetool.check.fit import (
    FIT_ERRORS,
    Model,
    all_samples,
    gauss_newton_iterations,
    masked_loss,
    on_task,
    with_end_mass,
    with_intermediate_mass,
    with_large_end_mass,
)
from drivetool.drive import state_space
from drivetool.identify.backlash import local_minima
from drivetool.identify.laws import third_mass_names, third_mass_score_test
from drivetool.identify.noise import Noise, filtered
from drivetool.identify.setup import Task

# Frequencies over that of the first resonance. A choice: a third mass far below or above is not identifiable.
THIRD_MASS_FREQUENCY_RATIOS = np.geomspace(0.4, 8.0, 14)
# Of the last inertia: small enough for the effect of a third mass to be proportional to it.
TRACE_INERTIA_SHARE = 0.01
# Damping ratio there: a less damped one would be missed between the frequencies of the grid.
TRACE_DAMPING_RATIO = 0.1
# Least and largest share to start a fit from. A choice: the linear step is inaccurate beyond.
START_INERTIA_SHARES = (0.05, 0.4)
MAX_THIRD_MASS_STARTS = 2  # a choice: frequencies that are fitted, each costs a fit
# Of the load and of the twist, for a mass between motor and load. A choice: small, medium and large of each.
INTERMEDIATE_INERTIA_SHARES, INTERMEDIATE_TWIST_SHARES = (0.1, 0.3, 0.6), (0.2, 0.5, 0.8)
LARGE_INERTIA_SHARE, LARGE_DAMPING_RATIO = 0.3, 0.05  # a choice: share and damping ratio of a large third mass
COMPARISON_STEPS = 4  # a choice: Gauss-Newton steps after which starts are compared
MAX_SCAN_STARTS = 3  # a choice: starts of one scan that are fitted, each costs a fit
MAX_ORDERS = 6000  # a choice: bounds the time and memory of the scan
MIN_RIPPLE_PERIODS = 2.0  # in the whole travel. A choice: what repeats less than twice is no ripple
MAX_RIPPLE_FREQUENCY = 0.45  # of the sampling rate: near 0.5 a ripple aliases
# Share of the samples, the slow ones, in which an order must stay below that frequency. A choice: half of the
# record.
MIN_FOLLOWED_SHARE = 0.5
# Score of a fixed frequency over that of an order. At a steady speed both explain the same; half a grid step
# between two orders, or two frequencies, costs up to a fifth.
FIXED_LINE_SCORE_RATIO = 1.5
# Share of an order's score that the slowest and the fastest samples may contribute by chance (a choice).
CHANCE_SCORE_SHARE = 0.1
# A choice: grid of frequencies for the filter's response, fine against the width of a damped resonance.
RESPONSE_FREQUENCIES = 2000
# Cells of angle and of speed. A choice: angle cells are far finer than the shortest period.
ANGLE_CELLS, SPEED_CELLS = 1 << 17, 256


def likely_end_masses(base: Model) -> list[Task]:
    """Third masses at the frequencies where a very small one has the largest expected gain.

    With a large share split off the fit would start thousands of units of log likelihood below the base,
    and end in any optimum. A small one hardly changes the motion. One linear step, its inertia, stiffness and
    damping in proportion, predicts its size.

    base  of a drive that may have a third mass
    """
    found = []
    for times in THIRD_MASS_FREQUENCY_RATIOS:
        task = with_end_mass(base, TRACE_INERTIA_SHARE, times, TRACE_DAMPING_RATIO)
        if task is not None:
            expected_gain, growth = _linear_growth(base, task)
            share = np.clip(TRACE_INERTIA_SHARE * (1.0 + growth), *START_INERTIA_SHARES)
            found.append((growth > 0.0, expected_gain, with_end_mass(base, share, times, TRACE_DAMPING_RATIO)))
    found.sort(key=lambda f: f[:2], reverse=True)
    return [task for _, _, task in found[:MAX_THIRD_MASS_STARTS]]


def likely_large_end_masses(base: Model) -> list[Task]:
    """Large third masses that are likeliest after a few steps; a small one may not grow to them."""
    tasks = [with_large_end_mass(base, LARGE_INERTIA_SHARE, ratio, LARGE_DAMPING_RATIO)
             for ratio in THIRD_MASS_FREQUENCY_RATIOS]
    return _after_steps(base, [task for task in tasks if task is not None])


def likely_intermediate_masses(base: Model) -> list[Task]:
    """Third masses between motor and load that are likeliest after a few steps, where a sensor is behind them.

    Without such a sensor a body in front of the last and one behind it are not distinguishable.
    """
    if not any(r.startswith("load_") for r in base.task.roles.outputs):
        return []
    return _after_steps(base,
                        [with_intermediate_mass(base, share, twist_share) for share in INTERMEDIATE_INERTIA_SHARES
                         for twist_share in INTERMEDIATE_TWIST_SHARES])


def _after_steps(base: Model, tasks: Sequence[Task]) -> list[Task]:
    """The tasks that are likeliest after a few steps, with the values reached."""
    found = []
    for task in tasks:
        start = on_task(base, task)
        try:
            model = gauss_newton_iterations(start, all_samples(base.problem), COMPARISON_STEPS)
        except FIT_ERRORS:
            continue
        found.append((model.value, len(found), model.fitted))
    return [task for _, _, task in sorted(found)[:MAX_THIRD_MASS_STARTS]]


def _linear_growth(base: Model, task: Task) -> tuple[float, float]:
    """(log likelihood over the base after a linear step, relative growth of the third mass in it)."""
    split = on_task(base, task)
    at = split.problem, split.point, base.noise
    gain, growth = third_mass_score_test(*at, third_mass_names(base.task.drive))
    return gain - masked_loss(*at, all_samples(split.problem)), growth


def likely_orders(base: Model) -> list[float]:
    """Orders of the motor angle at which the innovations repeat.

    A torque sin(n angle) reaches the innovations through the drive and its steady-state filter: its
    response at the frequency n times the speed gives size and phase from sample to sample, and the
    score of an order is what that shape explains. What a fixed frequency explains better is a narrow-band
    disturbance, and no order.
    """
    z, angles, speeds = innovations(base)
    travel = max(float(np.ptp(a)) for a in angles)
    median_speed = float(np.quantile(np.abs(np.concatenate(speeds)), MIN_FOLLOWED_SHARE))
    if travel <= 0.0 or median_speed <= 0.0:
        return []
    step = base.problem.traces[0].step
    spacing = np.pi / travel
    high = MAX_RIPPLE_FREQUENCY * 2.0 * np.pi / step / median_speed
    grid = MIN_RIPPLE_PERIODS * 2.0 * np.pi / travel + spacing * np.arange(MAX_ORDERS)
    grid = grid[grid < high]
    if not len(grid):  # every order is beyond the largest frequency
        return []
    lines = np.linspace(0.0, MAX_RIPPLE_FREQUENCY / step, RESPONSE_FREQUENCIES + 1)[1:]
    response = disturbance_response(base, lines)
    first = round(float(grid[0]) / spacing)
    correlation, energy = np.zeros(len(grid), complex), np.zeros(len(grid))
    torques = [equivalent_motor_torque(e, response, lines, step) for e in z]
    for torque, angle, speed in zip(torques, angles, speeds, strict=True):
        correlation += _order_spectrum(torque, angle, travel)[first:first + len(grid)]
        energy += response_energy(grid, speed, response, lines)
    scores = np.abs(correlation) ** 2 / np.maximum(energy, 1e-300)
    fixed = FixedLines(torques, lines, response, step)
    found = (i for i in local_minima(-scores) if not fixed.explains(grid[i], scores[i], torques, angles, speeds))
    return [float(grid[i]) for i in islice(found, MAX_SCAN_STARTS)]


class FixedLines:
    """What each fixed frequency explains of the equivalent motor torque, in the unit of a score."""

    def __init__(self, torque: Sequence[np.ndarray], lines: np.ndarray, response: np.ndarray, step: float) -> None:
        """torque (n,) per trace; response (RESPONSE_FREQUENCIES, outputs) of innovations to it at lines [Hz]."""
        size = 1 << (2 * max(len(t) for t in torque) - 1).bit_length()
        self.frequency = np.fft.rfftfreq(size, step)
        self.frequency = self.frequency[self.frequency <= lines[-1]]
        power = np.interp(self.frequency, lines, (np.abs(response) ** 2).sum(axis=1))
        spectra = [np.abs(np.fft.rfft(t, size)[:len(power)]) ** 2 / len(t) for t in torque]
        score = sum(spectra) / np.maximum(power, 1e-300)
        # Each trace has a phase of its own, which adds one part of noise per trace.
        self.score = score - (1.0 - 1.0 / len(spectra)) * np.median(score)

    def explains(self, order: float, score: float, torque: Sequence[np.ndarray], angles: Sequence[np.ndarray],
                 speeds: Sequence[np.ndarray]) -> bool:
        """Whether one frequency explains more than an order does, among those at which the order explains it."""
        demodulated = [t * np.exp(-1j * order * a) for t, a in zip(torque, angles, strict=True)]
        total = sum(complex(a.sum()) for a in demodulated)
        speed = np.abs(np.concatenate(speeds))
        at = np.argsort(speed, kind="stable")
        grown = np.cumsum((np.concatenate(demodulated) * np.conj(total)).real[at]) / abs(total) ** 2
        low, high = (speed[at[np.argmax(grown >= CHANCE_SCORE_SHARE)]],
                     speed[at[np.flatnonzero(grown <= 1.0 - CHANCE_SCORE_SHARE)[-1]]])
        inside = slice(*np.searchsorted(self.frequency, order / (2.0 * np.pi) * np.array([low, high]) + np.array(
            [-1.0, 1.0]) * (self.frequency[1] - self.frequency[0])))
        return bool(len(self.score[inside]) and self.score[inside].max() > FIXED_LINE_SCORE_RATIO * score)


def equivalent_motor_torque(e: np.ndarray, response: np.ndarray, lines: np.ndarray, step: float) -> np.ndarray:
    """(n,) motor torque equivalent to innovations (n, outputs): the adjoint of the filter applied to them.

    response  (RESPONSE_FREQUENCIES, outputs) of innovations to such a torque at frequencies (RESPONSE_FREQUENCIES,)
    """
    n, size = len(e), 1 << (2 * len(e) - 1).bit_length()
    frequencies, torque = np.fft.rfftfreq(size, step), np.zeros(n)
    for own, answer in zip(e.T, response.T, strict=True):
        at = np.interp(frequencies, lines, answer.real, right=0.0) + 1j * np.interp(
            frequencies, lines, answer.imag, right=0.0)
        torque += np.fft.irfft(np.fft.rfft(own, size) * np.conj(at), size)[:n]
    return torque


def _order_spectrum(torque: np.ndarray, angle: np.ndarray, travel: float) -> np.ndarray:
    """Spectrum of a torque (n,) over the orders of an angle: one transform over twice its travel, so that lines of
    the transform are pi / travel apart.
    """
    place = (angle - angle.min()) / (2.0 * travel) * ANGLE_CELLS
    cell = np.floor(place).astype(int)
    part = place - cell
    cells = (np.bincount(cell, torque * (1.0 - part), ANGLE_CELLS + 1)
             + np.bincount(cell + 1, torque * part, ANGLE_CELLS + 1))
    cells[0] += cells[ANGLE_CELLS]
    return np.conj(np.fft.rfft(cells[:ANGLE_CELLS]))


def response_energy(grid: np.ndarray, speed: np.ndarray, response: np.ndarray, lines: np.ndarray,
            weight: np.ndarray | None = None) -> np.ndarray:
    """(k,) energy of a torque of each order of a grid in the innovations, weighted by the histogram of the speed.

    weight  (n,) of the samples of speed (n,); None: one each
    """
    power = np.concatenate(([0.0], (np.abs(response) ** 2).sum(axis=1), [0.0]))
    count, edge = np.histogram(np.abs(speed) / (2.0 * np.pi * lines[0]), SPEED_CELLS, weights=weight)
    at = np.clip(np.rint(np.outer(grid, 0.5 * (edge[1:] + edge[:-1]))), 0, RESPONSE_FREQUENCIES + 1).astype(int)
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
    """State space from a torque to the whitened innovations (outputs,) of the closed linear drive and its noise.

    at_load  whether it acts on the last body; else on the motor
    returns  (A (n, n), Gamma (n,), C (outputs, n)) of the errors x[k+1] = A x[k] + Gamma T[k], z[k] = C x[k], by
             the steady Kalman filter; sensors are whitened one after the other, as the passes of the fit do
    """
    from scipy.linalg import expm, solve_discrete_are

    task: Task = base.fitted
    roles = ("motor_torque", "load_torque") if at_load and len(task.drive.bodies) > 1 else ("motor_torque",)
    a, b, c, _ = state_space(task.drive, roles, task.roles.outputs)
    observed = _observed_states(a, c)
    a, b, c = a[np.ix_(observed, observed)], b[observed], c[:, observed]
    n, step = len(a), base.problem.traces[0].step
    whole = np.zeros((n + b.shape[1], n + b.shape[1]))
    whole[:n, :n], whole[:n, n:] = a * step, b * step
    whole = expm(whole)
    phi, motor, acts = whole[:n, :n], whole[:n, n], whole[:n, -1]
    phi, q = _with_noise_state(phi, motor, base.noise)
    more = len(phi) - n
    c, acts = np.pad(c, ((0, 0), (0, more))), np.pad(acts, (0, more))
    q = max(base.noise.ratio, 1e-6) ** 2 * (q + 1e-14 * q.trace() * np.eye(len(q)))
    r = np.diag((base.noise.scale / base.noise.scale[0]) ** 2)
    p = solve_discrete_are(phi.T, c.T, q, r)
    variance = c @ p @ c.T + r
    gain = np.linalg.solve(variance, c @ p).T
    return phi @ (np.eye(len(phi)) - gain @ c), acts, np.linalg.solve(np.linalg.cholesky(variance), c)


def _with_noise_state(phi: np.ndarray, gamma: np.ndarray, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
    """(Phi, process noise covariance for a ratio of one), with an AR(1) noise as a further state."""
    if noise.memory is None:
        return phi, np.outer(gamma, gamma)
    n = len(phi)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n], whole[n, n] = phi, gamma, noise.memory
    noise_input = np.zeros(n + 1)
    if noise.slow is None:
        noise_input[n] = np.sqrt(1.0 - noise.memory**2)
    else:
        noise_input[:n], noise_input[n] = gamma, (noise.slow - 1.0) * (1.0 - noise.memory)
    return whole, np.outer(noise_input, noise_input)


def _observed_states(a: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Indices of the states that reach an output: an angle that is not measured has no steady filter."""
    observed = np.any(c != 0.0, axis=0)
    for _ in range(len(a)):
        observed = observed | np.any(a[observed] != 0.0, axis=0)
    return np.flatnonzero(observed)
