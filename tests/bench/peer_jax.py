"""The main job in JAX: RK4 in a scan, forward mode, segments by vmap, compiled; both cores if it likes."""

from __future__ import annotations

import os

import numpy as np

from tests.bench.descent import LENGTH, SMOOTHING, STEP, Job

os.environ.setdefault("JAX_PLATFORMS", "cpu")


def _rates(x, u, p):
    import jax.numpy as jnp

    inertia, load, stiffness, damping, viscous, idle, coulomb, gap = p
    z = x[2] + damping / stiffness * (x[0] - x[1])
    shaft = stiffness * (z - jnp.clip(z, -gap, gap))
    return jnp.stack([(u - viscous * x[0] - coulomb * jnp.tanh(x[0] / SMOOTHING) - shaft) / inertia,
                      (shaft - idle) / load, x[0] - x[1]])


def _segment(p, start, u, y, gain):
    import jax

    def step(x, now):
        u, y = now
        out, x = x[0], x + gain * (y - x[0])
        a = _rates(x, u, p)
        b = _rates(x + 0.5 * STEP * a, u, p)
        c = _rates(x + 0.5 * STEP * b, u, p)
        d = _rates(x + STEP * c, u, p)
        return x + STEP / 6.0 * (a + 2.0 * b + 2.0 * c + d), out

    return jax.lax.scan(step, start, (u, y))[1]


class JaxPeer:
    """RK4 compiled by XLA."""

    def __init__(self, job: Job):
        import jax
        import jax.numpy as jnp

        jax.config.update("jax_enable_x64", True)

        def both(p, start, u, y, gain):
            point = jnp.concatenate([p, start])

            def run(v):
                return _segment(v[:8], v[8:], u, y, gain)

            return jax.vmap(lambda t: jax.jvp(run, (point,), (t,)), out_axes=(None, 1))(jnp.eye(11))

        axes = (None, 0, 0, 0, None)
        self.u, self.y = (jnp.asarray(v.reshape(-1, LENGTH)) for v in (job.torque, job.speed))
        self.run, self.both = jax.jit(jax.vmap(_segment, axes)), jax.jit(jax.vmap(both, axes))

    def outputs(self, p, starts, gain):
        return np.asarray(self.run(p, starts, self.u, self.y, gain)).ravel()

    def sensitivities(self, p, starts, gain):
        out, jac = self.both(p, starts, self.u, self.y, gain)
        return np.asarray(out).ravel(), np.asarray(jac).reshape(-1, 11)
