"""The least that a sample can cost: a linear recursion of three states, bare and with sensitivities."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit
from scipy.linalg import expm

from tests.bench.records import MAIN, STEP


@njit(fastmath=True)
def _recursion(a, b, g, u, out):
    x, y, z = 0.0, 0.0, 0.0
    for i in range(u.size):
        out[i] = x
        v = u[i]
        x, y, z = ((a[0, 2] * z + (b[0] * v + g[0])) + (a[0, 1] * y + a[0, 0] * x),
                   (a[1, 2] * z + (b[1] * v + g[1])) + (a[1, 1] * y + a[1, 0] * x),
                   (a[2, 2] * z + (b[2] * v + g[2])) + (a[2, 1] * y + a[2, 0] * x))


def _matrices() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    (jm, jl), k, c = MAIN.inertia, MAIN.stiffness[0], MAIN.damping[0]
    v, load = MAIN.viscous[0], MAIN.idle_torque[1]
    rates = np.zeros((5, 5))
    rates[0] = [-(v + c) / jm, c / jm, -k / jm, 1 / jm, 0]
    rates[1] = [c / jl, -c / jl, k / jl, 0, -load / jl]
    rates[2] = [1, -1, 0, 0, 0]
    step = expm(rates * STEP)
    return np.ascontiguousarray(step[:3, :3]), step[:3, 3].copy(), step[:3, 4].copy()


def recursion(n: int) -> Callable[[], None]:
    """A call that runs the bare recursion over n samples."""
    a, b, g = _matrices()
    u, out = np.random.default_rng(1).standard_normal(n), np.empty(n)
    return lambda: _recursion(a, b, g, u, out)


def with_sensitivities(n: int) -> Callable[[], None] | None:
    """A call that runs the vectorised C loop over n samples; None without gcc."""
    if shutil.which("gcc") is None:
        return None
    library = Path(tempfile.mkdtemp()) / "floor.so"
    subprocess.run(["gcc", "-O3", "-march=native", "-ffast-math", "-shared", "-fPIC",
                    str(Path(__file__).with_name("floor.c")), "-o", str(library)], check=True)
    call = ctypes.CDLL(str(library)).sensitivities
    a, b, g = _matrices()
    rng = np.random.default_rng(1)
    slopes, u = 1e-3 * rng.standard_normal((3, 5, 12)), rng.standard_normal(n)
    arrays = [a, b, g, slopes, u, np.empty(n), np.empty((n, 12))]

    def run() -> None:
        call(*(v.ctypes.data_as(ctypes.c_void_p) for v in arrays), ctypes.c_int(n))

    return run
