"""Start values of a black-box fit: for a given resonance and damping, the rest is linear.

For every resonance and damping of a grid the response to the exactly held torque is a sum of known
signals: rigid-body motion, the two parts of the oscillation, start states, friction. One linear
least squares each; the best few are refined and become starting points of the fit itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from drivetool.drive.simulation import Trace

MAX_START_SAMPLES, MAX_START_STRETCHES = 30000, 8  # used at most. A choice: they bound the time of the grid search
GRID_RATIO = 1.08  # of neighbouring resonances. A choice: at a damping ratio of 0.1 a peak is 20 % wide
# A choice: a factor of about five apart; the descent covers what lies between.
GRID_DAMPING_RATIOS = (0.02, 0.1, 0.4)
MIN_RESONANCE_CYCLES = 2.0  # of a resonance in the longest stretch: fewer look like a drift
# By friction, in time constants over the longest stretch. A choice: a faster one is no friction.
MAX_FRICTION_DECAY = 20.0


@dataclass(frozen=True)
class CoefficientStart:
    """(b2, b1, b0, a2, a1, offset, viscous) or (b, offset, viscous), and their residual sum of squares."""

    values: np.ndarray
    cost: float


class StartRegression:
    """The parts of a record that are linear once the resonance is given."""

    def __init__(self, traces: Sequence[Trace], angle: bool):
        self.angle = angle
        self.traces = _longest_stretches(traces)
        y = np.concatenate([t.outputs[:, 0] for t in self.traces])
        self.known = np.isfinite(y)
        rigid = np.concatenate([self._rigid(t) for t in self.traces])
        base = np.column_stack([rigid, self._per_trace(self._drift)])[self.known]
        self.size = np.linalg.norm(base, axis=0)
        self.size[self.size == 0.0] = 1.0
        self.q, self.r = np.linalg.qr(base / self.size)
        self.y = y[self.known]
        self.rest = self.y - self.q @ (self.q.T @ self.y)

    def _rigid(self, t: Trace) -> np.ndarray:
        """Integrals of the inputs and, last, of the output, whose coefficient is the viscous friction."""
        h = t.step
        one = _sum_before(h * t.inputs)
        two = _sum_before(h * one + 0.5 * h * h * t.inputs)
        y = t.outputs[:, :1]
        y = np.where(np.isfinite(y), y, np.nanmean(y) if np.isfinite(y).any() else 0.0)
        return np.column_stack(([two, one] if self.angle else [one]) + [_sum_before(h * y)])

    def _drift(self, t: Trace) -> np.ndarray:
        time = np.arange(t.size) * t.step
        return np.vander(time, 3 if self.angle else 2)

    def _per_trace(self, columns) -> np.ndarray:
        """Columns that are zero outside their own trace."""
        blocks = [columns(t) for t in self.traces]
        found = np.zeros((sum(map(len, blocks)), sum(b.shape[1] for b in blocks)))
        row = column = 0
        for b in blocks:
            found[row:row + len(b), column:column + b.shape[1]] = b
            row, column = row + len(b), column + b.shape[1]
        return found

    def _mode(self, pole: complex) -> np.ndarray:
        """(n, columns) responses of a complex pole: to the inputs, then to the start states."""
        forced = []
        for t in self.traces:
            step = np.exp(pole * t.step)
            gain = (step - 1.0) / pole
            x = scipy.signal.lfilter([0.0, gain], [1.0, -step], t.inputs.astype(complex), axis=0)
            forced.append(_real_and_imaginary(x))
        free = self._per_trace(lambda t: _real_and_imaginary(np.exp(pole * t.step * np.arange(t.size))))
        return np.column_stack([np.concatenate(forced), free])[self.known]

    def at(self, resonance: float, zeta: float) -> CoefficientStart:
        """The best coefficients at a resonance [rad/s] and damping ratio."""
        pole = resonance * complex(-zeta, np.sqrt(max(1.0 - zeta**2, 1e-6)))
        mode = self._mode(pole)
        part = self.q.T @ mode
        mode = mode - self.q @ part
        own = np.linalg.norm(mode, axis=0)
        own[own == 0.0] = 1.0
        scaled = mode / own
        found = np.linalg.lstsq(scaled.T @ scaled, scaled.T @ self.rest, rcond=1e-10)[0]
        residual = self.rest - scaled @ found
        return CoefficientStart(self._coefficients(pole, found / own, part), float(residual @ residual))

    def _coefficients(self, pole: complex, found: np.ndarray, part: np.ndarray) -> np.ndarray:
        """(b2, b1, b0, a2, a1, offset, viscous) from the residues of rigid body and oscillation."""
        rigid = np.linalg.lstsq(self.r, self.q.T @ self.y - part @ found, rcond=1e-12)[0] / self.size
        residue = complex(found[0], -found[self.traces[0].inputs.shape[1]])
        if self.angle:
            residue *= pole
        a2, a1, g = -2.0 * pole.real, abs(pole) ** 2, rigid[0]
        b1 = g * a2 - (residue * pole.conjugate()).real
        return np.array([g + residue.real, b1, g * a1, a2, a1, *self._resistance(rigid)])

    def rigid(self) -> CoefficientStart:
        """(b, offset, viscous) of one body."""
        found = np.linalg.lstsq(self.r, self.q.T @ self.y, rcond=1e-12)[0] / self.size
        return CoefficientStart(np.array([found[0], *self._resistance(found)]), float(self.rest @ self.rest))

    def _resistance(self, rigid: np.ndarray) -> tuple[float, float]:
        """(offset, viscous) from the drift of the longest stretch and from the integral of the output."""
        g, column = rigid[0], (1 + self.angle) * self.traces[0].inputs.shape[1]
        if not g:
            return 0.0, 0.0
        offset, viscous = -(1 + self.angle) * rigid[column + 1] / g, -rigid[column] / g
        # At nearly one speed the two are nearly collinear: the friction is limited to plausible values.
        longest = self.traces[0].size * self.traces[0].step
        limited = float(np.clip(viscous, 0.0, MAX_FRICTION_DECAY / abs(g) / longest))
        return float(offset + (viscous - limited) * mean_speed(self.traces, self.angle)), limited


def mean_speed(traces: Sequence[Trace], angle: bool) -> float:
    """Of the longest stretch."""
    t = max(traces, key=lambda t: t.size)
    good = np.flatnonzero(np.isfinite(t.outputs[:, 0]))
    y = t.outputs[good, 0]
    return float((y[-1] - y[0]) / ((good[-1] - good[0]) * t.step) if angle else y.mean())


def start_points(traces: Sequence[Trace], angle: bool, count: int) -> list[CoefficientStart]:
    """The best starting points of the two-mass model, best first, with different resonances.

    traces  motor torque and speed, or angle
    count   how many at most
    """
    regression = StartRegression(traces, angle)
    longest = max(t.size * t.step for t in regression.traces)
    low = 2.0 * np.pi * MIN_RESONANCE_CYCLES / longest
    high = 0.9 * np.pi / min(t.step for t in regression.traces)
    grid = np.geomspace(low, high, max(2, int(np.log(high / low) / np.log(GRID_RATIO))))
    cost = np.array([[regression.at(w, z).cost for z in GRID_DAMPING_RATIOS] for w in grid])
    best, where = cost.min(axis=1), cost.argmin(axis=1)
    around = np.concatenate([[np.inf], best, [np.inf]])
    local_optima = [i for i in range(len(grid)) if around[i + 1] <= min(around[i], around[i + 2])]
    found: list[CoefficientStart] = []
    for i in sorted(local_optima, key=lambda i: best[i])[:count]:
        start = _local_optimum(regression, grid[i], GRID_DAMPING_RATIOS[where[i]])
        if all(abs(np.log(start.values[4] / s.values[4])) > 0.05 for s in found):
            found.append(start)
    return sorted(found, key=lambda s: s.cost)


def _local_optimum(regression: StartRegression, resonance: float, zeta: float) -> CoefficientStart:
    """The local optimum from a grid point."""
    def at(x: np.ndarray) -> CoefficientStart:
        return regression.at(float(np.exp(np.clip(x[0], -20.0, 20.0))),
                             float(np.exp(np.clip(x[1], np.log(1e-3), np.log(0.95)))))

    x = np.log([resonance, zeta])
    around = x + np.array([[0.0, 0.0], [0.04, 0.0], [0.0, 0.7]])
    found = scipy.optimize.minimize(lambda x: at(x).cost, x, method="Nelder-Mead", options={
        "maxfev": 60, "xatol": 1e-3, "fatol": 0.0, "initial_simplex": around})
    return at(found.x)


def _longest_stretches(traces: Sequence[Trace]) -> list[Trace]:
    """The longest stretches, cut to the samples that a start needs."""
    found, room = [], MAX_START_SAMPLES
    for t in sorted(traces, key=lambda t: -t.size)[:MAX_START_STRETCHES]:
        n = min(t.size, room)
        if n >= 10:
            found.append(replace(t, inputs=t.inputs[:n], outputs=t.outputs[:n]))
        room -= n
    return found


def _sum_before(x: np.ndarray) -> np.ndarray:
    """Sum of everything before a sample."""
    return np.cumsum(x, axis=0) - x


def _real_and_imaginary(x: np.ndarray) -> np.ndarray:
    return np.column_stack([x.real, x.imag])
