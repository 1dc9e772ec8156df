"""The main job in a SciPy notebook: solve_ivp for every segment. One residual is timed, the rest reckoned."""

from __future__ import annotations

import math
import time

import numpy as np
from scipy.integrate import solve_ivp

from tests.bench.descent import LENGTH, SMOOTHING, STEP, Job


def rates(t, x, torque, p):
    """The law of the main job."""
    inertia, load, stiffness, damping, viscous, idle, coulomb, gap = p
    z = x[2] + damping / stiffness * (x[0] - x[1])
    shaft = stiffness * (z - gap if z > gap else z + gap if z < -gap else 0.0)
    u = torque[min(int(t / STEP + 1e-9), LENGTH - 1)]
    return ((u - viscous * x[0] - coulomb * math.tanh(x[0] / SMOOTHING) - shaft) / inertia,
            (shaft - idle) / load, x[0] - x[1])


def seconds_per_residual(job: Job) -> float:
    """One segment of two seconds at rtol 1e-6 and steps up to a sample, times the segments."""
    times = np.arange(LENGTH) * STEP
    began = time.process_time()
    known = (job.torque[:LENGTH].tolist(), job.start.tolist())
    solve_ivp(rates, (0.0, times[-1]), job.starts[0], t_eval=times, args=known, method="RK45", rtol=1e-6, atol=1e-8,
              max_step=STEP)
    return (time.process_time() - began) * job.segments
