"""The main job in Numba: RK4 at the sample interval, forward sensitivities in the same loop."""

from __future__ import annotations

import numpy as np
from numba import njit

from tests.bench.descent import LENGTH, SMOOTHING, STEP, Job

COLUMNS = 11


@njit(cache=True, fastmath=True)
def rates(x, s, u, p, ws, dx, ds, columns):
    """dx/dt and, for `columns` > 0, its derivatives."""
    inertia, load, stiffness, damping, viscous, idle, coulomb, gap = p
    w = x[0] - x[1]
    z = x[2] + damping / stiffness * w
    side = 1.0 if z > gap else (-1.0 if z < -gap else 0.0)
    on = side * side
    shaft = on * (stiffness * (x[2] - side * gap) + damping * w)
    sign = np.tanh(x[0] / ws)
    slope = viscous + coulomb / ws * (1.0 - sign * sign)
    dx[0] = (u - viscous * x[0] - coulomb * sign - shaft) / inertia
    dx[1] = (shaft - idle) / load
    dx[2] = w
    for q in range(columns):
        t = on * (stiffness * s[2, q] + damping * (s[0, q] - s[1, q]))
        ds[0, q] = -slope * s[0, q] - t
        ds[1, q] = t
        ds[2, q] = s[0, q] - s[1, q]
    if columns > 0:
        a, b, c = on * (x[2] - side * gap), on * w, -side * stiffness
        ds[0, 2] -= a
        ds[1, 2] += a
        ds[0, 3] -= b
        ds[1, 3] += b
        ds[0, 4] -= x[0]
        ds[1, 5] -= 1.0
        ds[0, 6] -= sign
        ds[0, 7] -= c
        ds[1, 7] += c
        for q in range(columns):
            ds[0, q] /= inertia
            ds[1, q] /= load
        ds[0, 0] -= dx[0] / inertia
        ds[1, 1] -= dx[1] / load


@njit(cache=True, fastmath=True)
def segment(u, y, k, h, p, start, ws, out, jac):
    """One segment; jac (n, 11) or (0, 11)."""
    columns = COLUMNS if jac.shape[0] > 0 else 0
    x, s = start.copy(), np.zeros((3, COLUMNS))
    for j in range(3):
        s[j, 8 + j] = 1.0
    dx, ds = np.zeros((4, 3)), np.zeros((4, 3, COLUMNS))
    xt, st = np.zeros(3), np.zeros((3, COLUMNS))
    for i in range(u.size):
        out[i] = x[0]
        e = y[i] - x[0]
        for q in range(columns):
            jac[i, q] = s[0, q]
        for j in range(2, -1, -1):
            x[j] += k[j] * e
            for q in range(columns):
                s[j, q] -= k[j] * s[0, q]
        rates(x, s, u[i], p, ws, dx[0], ds[0], columns)
        for m in range(1, 4):
            f = h if m == 3 else 0.5 * h
            for j in range(3):
                xt[j] = x[j] + f * dx[m - 1, j]
                for q in range(columns):
                    st[j, q] = s[j, q] + f * ds[m - 1, j, q]
            rates(xt, st, u[i], p, ws, dx[m], ds[m], columns)
        for j in range(3):
            x[j] += h / 6.0 * (dx[0, j] + 2.0 * dx[1, j] + 2.0 * dx[2, j] + dx[3, j])
            for q in range(columns):
                s[j, q] += h / 6.0 * (ds[0, j, q] + 2.0 * ds[1, j, q] + 2.0 * ds[2, j, q] + ds[3, j, q])


class NumbaPeer:
    """RK4 compiled by Numba."""

    def __init__(self, job: Job):
        self.job, self.none = job, np.empty((0, COLUMNS))

    def _run(self, p, starts, gain, out, jac):
        for i, start in enumerate(starts):
            part = slice(i * LENGTH, (i + 1) * LENGTH)
            segment(self.job.torque[part], self.job.speed[part], gain, STEP, p, start, SMOOTHING, out[part],
                    jac[part])

    def outputs(self, p, starts, gain):
        out = np.empty(len(self.job.speed))
        self._run(p, starts, gain, out, self.none)
        return out

    def sensitivities(self, p, starts, gain):
        out = np.empty(len(self.job.speed))
        jac = np.empty((len(out), COLUMNS))
        self._run(p, starts, gain, out, jac)
        return out, jac
