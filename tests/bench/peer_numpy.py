"""The main job in NumPy: RK4 over all segments and all forward differences as one batch of 144 runs."""

from __future__ import annotations

import numpy as np

from tests.bench.descent import LENGTH, SMOOTHING, STEP, Job

SHARE, DIFFERENCE_STEP = 1e-6, 1e-6  # steps of the differences: of a parameter, of a start state


class NumpyPeer:
    """RK4, vectorised over runs."""

    def __init__(self, job: Job):
        self.u, self.y = (np.ascontiguousarray(v.reshape(-1, LENGTH).T) for v in (job.torque, job.speed))

    def _run(self, p, x, gain):
        """p (8, runs, 1), x (3, runs, segments) -> speed (samples, runs, segments)."""
        inertia, load, stiffness, damping, viscous, idle, coulomb, gap = p
        ratio, out = damping / stiffness, np.empty((LENGTH, *x.shape[1:]))
        k = gain[:, None, None]
        rates = np.empty((4, *x.shape))

        def slope(x, u, into):
            w = x[0] - x[1]
            z = x[2] + ratio * w
            shaft = stiffness * (z - np.minimum(np.maximum(z, -gap), gap))
            into[0] = (u - viscous * x[0] - coulomb * np.tanh(x[0] / SMOOTHING) - shaft) / inertia
            into[1] = (shaft - idle) / load
            into[2] = w

        for i in range(LENGTH):
            out[i] = x[0]
            x = x + k * (self.y[i] - x[0])
            u = self.u[i]
            slope(x, u, rates[0])
            slope(x + 0.5 * STEP * rates[0], u, rates[1])
            slope(x + 0.5 * STEP * rates[1], u, rates[2])
            slope(x + STEP * rates[2], u, rates[3])
            x = x + STEP / 6.0 * (rates[0] + 2.0 * rates[1] + 2.0 * rates[2] + rates[3])
        return out

    def outputs(self, p, starts, gain):
        return self._run(p[:, None, None], starts.T[:, None, :].copy(), gain)[:, 0].T.ravel()

    def sensitivities(self, p, starts, gain):
        values, states = np.tile(p[:, None, None], (1, 12, 1)), np.tile(starts.T[:, None, :], (1, 12, 1))
        steps = np.r_[SHARE * p, np.full(3, DIFFERENCE_STEP)]
        for q in range(8):
            values[q, 1 + q] += steps[q]
        for j in range(3):
            states[j, 9 + j] += DIFFERENCE_STEP
        out = self._run(values, states, gain)
        jac = (out[:, 1:] - out[:, :1]) / steps[:, None]
        return out[:, 0].T.ravel(), np.ascontiguousarray(jac.transpose(2, 0, 1)).reshape(-1, 11)
