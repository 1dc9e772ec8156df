"""A two-mass drive whose load is split in two by one more shaft, and what a linear step says of its third mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.drive import TIP, Drive
from drivetool.identify.noise import Noise, normal_under
from drivetool.identify.problem import Point, Problem, schur
from drivetool.identify.setup import Task

FASTEST = 0.4  # of the sampling rate: what rings faster leaves no trace


def tip_names(drive: Drive, at: str = TIP) -> tuple[str, str, str]:
    """Inertia, stiffness and damping of a third mass behind the others, or in the shaft."""
    shaft = f"shaft{len(drive.bodies)}"
    return f"{at}.inertia", f"{shaft}.stiffness", f"{shaft}.damping"


def split_off(task: Task, step: float, share: float, times: float, zeta: float) -> Task | None:
    """The task with its last body split in two by one more shaft, None if that would ring too fast.

    step   sample interval [s]
    share  of the last body's inertia that goes to the new one
    times  frequency of the new one over that of the first resonance; zeta: its damping ratio
    """
    drive = task.drive
    last, first = drive.bodies[-1], drive.bodies[0]
    jl, jm, ks = (drive.value(n) for n in (f"{last}.inertia", f"{first}.inertia", f"{drive.shafts[0]}.stiffness"))
    rate = times * np.sqrt(ks * (jl + jm) / (jl * jm))
    if rate > 2.0 * np.pi * FASTEST / step:
        return None
    names = tip_names(drive)
    inertia, stiffness, damping = names
    values = {**drive.values, f"{last}.inertia": (1.0 - share) * jl, inertia: share * jl,
              stiffness: rate**2 * share * (1.0 - share) * jl, damping: 2.0 * zeta * rate * share * jl}
    longer = replace(drive, name="three-mass with a tip", bodies=(*drive.bodies, TIP),
                     shafts=(*drive.shafts, stiffness.split(".")[0]), values=values)
    free = tuple(n for n in longer.quantities if n in {*task.free, *names})
    # The load's sensors stay where they were.
    return replace(task, drive=longer, free=free)


def grown(problem: Problem, point: Point, noise: Noise, names: tuple[str, str, str]) -> tuple[float, float]:
    """(log likelihood that a linear step gains, relative growth of the third mass in it).

    names  of the third mass, whose inertia, stiffness and damping grow together
    """
    normal = normal_under(problem, point, noise)
    matrix, slope, _ = schur(normal)
    own = np.array([n in names for n in problem.names])
    turn = np.column_stack([np.eye(len(own))[:, ~own], np.where(own, point.values, 0.0)])
    matrix, slope = turn.T @ matrix @ turn, turn.T @ slope
    told = np.flatnonzero(np.diag(matrix) > 0.0)  # what only trades against start states is rounding, of any sign
    size, step = np.sqrt(np.diag(matrix)[told]), np.zeros(len(slope))
    inverse = np.linalg.pinv(matrix[np.ix_(told, told)] / np.outer(size, size), rcond=1e-10, hermitian=True)
    step[told] = -(inverse @ (slope[told] / size)) / size
    gain = float(-0.5 * slope @ step) / (normal.cost / max(problem.count - problem.unknowns, 1))
    return gain, float(step[-1])
