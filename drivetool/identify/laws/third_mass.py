"""A two-mass drive whose load is split in two by one more shaft, and the score test of its third mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drivetool.drive import END_MASS, Drive
from drivetool.identify.noise import Noise, filtered_normal_equations
from drivetool.identify.problem import Point, Problem, schur
from drivetool.identify.setup import Task
from drivetool.quantity import name_of, owner_of

# Of the sampling rate. A choice below the Nyquist limit of 0.5: a faster mode leaves no trace in the samples.
MAX_MODE_RATE_SHARE = 0.4


def third_mass_names(drive: Drive, at: str = END_MASS) -> tuple[str, str, str]:
    """Inertia, stiffness and damping of a third mass, behind the load or between motor and load."""
    shaft = f"shaft{len(drive.bodies)}"
    return name_of(at, "inertia"), name_of(shaft, "stiffness"), name_of(shaft, "damping")


def with_split_load(task: Task, step: float, share: float, frequency_ratio: float, zeta: float) -> Task | None:
    """The task with its last body split in two by one more shaft, None if that resonance would be too fast.

    step   sample interval [s]
    share  of the last body's inertia that goes to the new one
    times  frequency of the new one over that of the first resonance; zeta: its damping ratio
    """
    drive = task.drive
    last, first = drive.bodies[-1], drive.bodies[0]
    jl, jm, ks = (drive.value(n) for n in (name_of(last, "inertia"), name_of(first, "inertia"),
                                           name_of(drive.shafts[0], "stiffness")))
    rate = frequency_ratio * np.sqrt(ks * (jl + jm) / (jl * jm))
    if rate > 2.0 * np.pi * MAX_MODE_RATE_SHARE / step:
        return None
    names = third_mass_names(drive)
    inertia, stiffness, damping = names
    values = {**drive.values, name_of(last, "inertia"): (1.0 - share) * jl, inertia: share * jl,
              stiffness: rate**2 * share * (1.0 - share) * jl, damping: 2.0 * zeta * rate * share * jl}
    longer = replace(drive, name="three-mass with a tip", bodies=(*drive.bodies, END_MASS),
                     shafts=(*drive.shafts, owner_of(stiffness)), values=values)
    # The load's sensors stay where they were.
    return replace(task, drive=longer).with_free({*task.free, *names})


def third_mass_score_test(problem: Problem, point: Point, noise: Noise,
                          names: tuple[str, str, str]) -> tuple[float, float]:
    """(expected log-likelihood gain of one Gauss-Newton step, relative growth of the third mass in it).

    names  of the third mass, whose inertia, stiffness and damping grow together
    """
    normal = filtered_normal_equations(problem, point, noise)
    matrix, slope, _ = schur(normal)
    of_third_mass = np.array([n in names for n in problem.names])
    transform = np.column_stack([np.eye(len(of_third_mass))[:, ~of_third_mass],
                                 np.where(of_third_mass, point.values, 0.0)])
    matrix, slope = transform.T @ matrix @ transform, transform.T @ slope
    # The rest is compensated by start states: rounding, of any sign.
    identifiable = np.flatnonzero(np.diag(matrix) > 0.0)
    size, step = np.sqrt(np.diag(matrix)[identifiable]), np.zeros(len(slope))
    inverse = np.linalg.pinv(matrix[np.ix_(identifiable, identifiable)] / np.outer(size, size), rcond=1e-10,
                             hermitian=True)
    step[identifiable] = -(inverse @ (slope[identifiable] / size)) / size
    gain = float(-0.5 * slope @ step) / problem.variance(normal.cost)
    return gain, float(step[-1])
