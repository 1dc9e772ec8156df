"""The main job in CasADi: the step with its sensitivities as one function, compiled by gcc -O3."""

from __future__ import annotations

import os
import tempfile

import numpy as np

from tests.bench.descent import LENGTH, SMOOTHING, STEP, Job


def _step(ca):
    """(states, [torque, speed, gains], parameters) -> states one sample later, symbolically."""
    x, w, p = ca.SX.sym("x", 3), ca.SX.sym("w", 5), ca.SX.sym("p", 8)
    inertia, load, stiffness, damping, viscous, idle, coulomb, gap = (p[i] for i in range(8))

    def rates(s):
        z = s[2] + damping / stiffness * (s[0] - s[1])
        shaft = stiffness * (ca.if_else(z > gap, z - gap, 0) + ca.if_else(z < -gap, z + gap, 0))
        return ca.vertcat((w[0] - viscous * s[0] - coulomb * ca.tanh(s[0] / SMOOTHING) - shaft) / inertia,
                          (shaft - idle) / load, s[0] - s[1])

    at = x + w[2:5] * (w[1] - x[0])
    a = rates(at)
    b = rates(at + 0.5 * STEP * a)
    c = rates(at + 0.5 * STEP * b)
    d = rates(at + STEP * c)
    return x, w, p, at + STEP / 6.0 * (a + 2.0 * b + 2.0 * c + d)


class CasadiPeer:
    """RK4 as C code from CasADi."""

    def __init__(self, job: Job):
        import casadi as ca

        self.job = job
        x, w, p, new = _step(ca)
        before = ca.SX.sym("s", 3, 11)
        after = ca.jacobian(new, x) @ before + ca.horzcat(ca.jacobian(new, p), ca.SX.zeros(3, 3))
        here = os.getcwd()
        os.chdir(tempfile.mkdtemp())  # its compiler works in the current folder
        try:
            options = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O3", "-march=native"]}}
            plain = ca.Function("plain", [x, w, p], [new], options)
            full = ca.Function("full", [ca.vertcat(x, ca.vec(before)), w, p], [ca.vertcat(new, ca.vec(after))],
                               options)
            start, inputs, values = ca.MX.sym("x0", 3), ca.MX.sym("W", 5, LENGTH), ca.MX.sym("p", 8)
            many = ca.repmat(values, 1, LENGTH)
            states = ca.horzcat(start, plain.mapaccum("chain", LENGTH)(start, inputs, many)[:, :-1])
            self.run = ca.Function("run", [values, start, inputs], [states[0, :]]).map(job.segments, "serial")
            begin = ca.vertcat(start, ca.DM.zeros(24), ca.vec(ca.DM.eye(3)))
            states = ca.horzcat(begin, full.mapaccum("chain2", LENGTH)(begin, inputs, many)[:, :-1])
            self.both = ca.Function("both", [values, start, inputs], [states[0, :], states[3::3, :]]).map(
                job.segments, "serial")
        finally:
            os.chdir(here)

    def _inputs(self, gain):
        return np.vstack([self.job.torque, self.job.speed, np.tile(gain[:, None], (1, len(self.job.speed)))])

    def outputs(self, p, starts, gain):
        return self.run(p, starts.T, self._inputs(gain)).full().ravel()

    def sensitivities(self, p, starts, gain):
        out, jac = self.both(p, starts.T, self._inputs(gain))
        return out.full().ravel(), np.ascontiguousarray(jac.full().T)
